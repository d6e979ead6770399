"""Base of objects whose content is a time series: their display, and their channels as tables."""

from __future__ import annotations

from typing import TYPE_CHECKING

from eightpost.display import Summarized

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

    from eightpost.signals.timeseries import TimeSeries


class Recording(Summarized):
    """Object with channels over time, which a notebook shows in a few lines and turns into tables."""

    __slots__ = ()

    if TYPE_CHECKING:

        @property
        def series(self) -> TimeSeries:
            """Channels over time."""

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
