"""Figures of time series: traces over time, and one channel over another."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from eightpost import units
from eightpost.array_types import Array
from eightpost.errors import InputError, check_number
from eightpost.report.pictures import Axes, Figure, Picture, drawable, new_figure, panels_of, plain_text
from eightpost.report.series import Series

COLORS = ("#1f77b4", "#d95f02", "#1b9e77", "#7570b3")

#: Number of channels in the picture of a run, and the length that it shows of a long run [s].
PANELS, _SHOWN = 12, 4.0

#: Largest number of channels in a picture; matplotlib cannot save one of 65,536 pixels.
_MOST = 300


def traces(
    runs: Mapping[str, Series], channels: Sequence[str], *, start: float, stop: float, title: str = "Time traces"
) -> Figure:
    """Return channels over time, one panel each, one line per run.

    Args:
        runs: Series by label.
        channels: Names of the channels.
        start: Start of the shown part [s].
        stop: End of the shown part [s].
        title: Title of the figure.
    """
    # Margins in inches. A computed layout would draw all panels once more, which takes most of a short run's time.
    width, height = 11.0, 1.9 * len(channels) + 0.8
    margins = {"left": 1.0 / width, "right": 1.0 - 0.1 / width, "bottom": 0.5 / height, "top": 1.0 - 0.45 / height}
    figure = new_figure(width, height, layout=None)
    panels = panels_of(figure, len(channels), 1, sharex=True, gridspec_kw={**margins, "hspace": 0.12})
    for panel, channel in zip(panels, channels, strict=True):
        for (label, series), color in zip(runs.items(), COLORS, strict=False):
            shown = series.window(start, stop)
            values = drawable(displayed(shown, channel))
            panel.plot(shown.time, values, lw=1.0, color=color, label=plain_text(label))
        _label(panel, runs, channel)
    panels[-1].set_xlabel("time [s]")
    if len(runs) > 1:
        panels[0].legend(loc="upper right", ncols=len(runs), frameon=False)
    figure.suptitle(plain_text(title), y=1.0 - 0.1 / height, va="top")
    return figure


def excerpt(series: Series) -> tuple[float, float]:
    """Return start and end [s] of the middle of a long series, of the whole of one that is short or has few samples."""
    first, last = float(series.time[0]), float(series.time[-1])
    begin, end = 0.5 * (first + last - _SHOWN), 0.5 * (first + last + _SHOWN)
    inside = np.searchsorted(series.time, end, "right") - np.searchsorted(series.time, begin, "left")
    return (first, last) if last - first <= 2.0 * _SHOWN or inside < 2 else (begin, end)


def picture(
    series: Series,
    channels: str | Sequence[str] = (),
    *,
    start: float | None = None,
    stop: float | None = None,
    title: str = "",
) -> Picture:
    """Return a picture of channels over time.

    Args:
        series: Series to show.
        channels: Names of the channels; default: the first twelve.
        start: Start of the shown part [s].
        stop: End of the shown part [s]; default of both: the middle of a long series, all of a short one.
        title: Title of the figure.

    Raises:
        MissingChannelError: The series has no such channel.
        InputError: There is no sample between start and stop, or no channel, or only one sample, or too many channels.
    """
    for name, value in (("start", start), ("stop", stop)):
        check_number(name, value, "s")
    shown = tuple(dict.fromkeys([channels] if isinstance(channels, str) else channels)) or series.names[:PANELS]
    if not 0 < len(shown) <= _MOST or len(series) < 2:
        raise InputError(f"a picture over time needs two samples and 1 to {_MOST} channels; these are "
                         f"{len(series)} samples of {len(shown)} channels")  # fmt: skip
    series = series.select(shown)
    begin, end = excerpt(series) if start is None and stop is None else (float(series.time[0]), float(series.time[-1]))
    begin, end = begin if start is None else start, end if stop is None else stop
    if not (max(begin, series.time[0]) < min(end, series.time[-1])):
        span = f"{series.time[0]:g} to {series.time[-1]:g} s"
        raise InputError(f"start = {begin:g} s and stop = {end:g} s contain no sample; the channels cover {span}")
    return Picture(traces({title or "series": series}, shown, start=begin, stop=end, title=title))


def loop(series: Series, across: str, up: str, *, title: str = "") -> Picture:
    """Return a picture of one channel over another.

    Args:
        series: Series to show.
        across: Channel of the horizontal axis.
        up: Channel of the vertical axis.
        title: Title of the figure.
    """
    figure = new_figure(6.0, 4.5)
    axes = figure.subplots()
    axes.plot(drawable(displayed(series, across)), drawable(displayed(series, up)), lw=0.5, color=COLORS[0])
    axes.set_xlabel(f"{plain_text(across)} [{display_unit(series, across)}]")
    axes.set_ylabel(f"{plain_text(up)} [{display_unit(series, up)}]")
    axes.set_title(plain_text(title))
    axes.grid(alpha=0.3)
    return Picture(figure)


def display_unit(series: Series, channel: str) -> str:
    """Return the unit in which a channel is drawn."""
    return units.us_customary(series.unit(channel))


def displayed(series: Series, channel: str) -> Array:
    """Return a channel (N,) in the unit in which it is drawn."""
    with np.errstate(over="ignore"):  # a run that diverged
        return units.convert(series[channel], series.unit(channel), display_unit(series, channel))


def _label(panel: Axes, runs: Mapping[str, Series], channel: str) -> None:
    panel.set_ylabel(f"{plain_text(channel)}\n[{display_unit(next(iter(runs.values())), channel)}]", fontsize=9)
    panel.yaxis.set_label_coords(-0.055, 0.5)
    panel.grid(alpha=0.3)
