"""Base of objects whose content is a time series: their display, and their channels as tables."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from eightpost.display import Summarized

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

    from eightpost.report.pictures import Picture
    from eightpost.signals.timeseries import TimeSeries


class Recording(Summarized):
    """Object with channels over time, which a notebook shows in a few lines and turns into tables."""

    __slots__ = ()

    if TYPE_CHECKING:

        @property
        def series(self) -> TimeSeries:
            """Channels over time."""

    def _title(self) -> str:
        """Return the title of a picture of the channels."""
        return ""

    def plot(
        self, channels: str | Sequence[str] = (), *, start: float | None = None, stop: float | None = None
    ) -> Picture:
        """Return a picture of channels over time.

        Args:
            channels: Names of the channels; default: the first twelve.
            start: Start of the shown part [s]; default: so that a long recording shows its middle.
            stop: End of the shown part [s].

        Raises:
            MissingChannelError: There is no such channel.
            InputError: There is no sample between start and stop.
        """
        return self.series.plot(channels, start=start, stop=stop, title=self._title())

    def to_pandas(self) -> pd.DataFrame:
        """Return the channels, in SI, over the time [s]; units are in `attrs["units"]`.

        Raises:
            MissingExtraError: pandas is not installed.
        """
        return self.series.to_pandas()

    def to_xarray(self) -> xr.Dataset:
        """Return the channels, in SI, over the coordinate `time` [s].

        Raises:
            MissingExtraError: xarray is not installed.
        """
        return self.series.to_xarray()
