"""Plots of runs: time traces and spectra. Each is one figure in one file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import scipy

from eightpost import units
from eightpost.report.pictures import Axes, new_figure, panels_of, save
from eightpost.signals import TimeSeries

COLORS = ("#1f77b4", "#d95f02", "#1b9e77", "#7570b3")


def plot_traces(
    runs: Mapping[str, TimeSeries],
    channels: Sequence[str],
    path: str | Path,
    *,
    start: float,
    stop: float,
    title: str = "Time traces",
) -> None:
    """Plot channels over time between `start` and `stop` [s], one panel each, one line per run."""
    # Margins in inches. A computed layout would draw all panels once more, which takes most of a short run's time.
    width, height = 11.0, 1.9 * len(channels) + 0.8
    margins = {"left": 1.0 / width, "right": 1.0 - 0.1 / width, "bottom": 0.5 / height, "top": 1.0 - 0.45 / height}
    figure = new_figure(width, height, layout=None)
    panels = panels_of(figure, len(channels), 1, sharex=True, gridspec_kw={**margins, "hspace": 0.12})
    for panel, channel in zip(panels, channels, strict=True):
        for (label, series), color in zip(runs.items(), COLORS, strict=False):
            shown = series.window(start, stop)
            panel.plot(shown.time, _displayed(shown, channel), lw=1.0, color=color, label=label)
        _label(panel, runs, channel)
    panels[-1].set_xlabel("time [s]")
    panels[0].legend(loc="upper right", ncols=len(runs), frameon=False)
    figure.suptitle(title, y=1.0 - 0.1 / height, va="top")
    save(figure, path)


#: Number of channels in the picture of a run, and the length that it shows of a long run [s].
_PANELS, _SHOWN = 12, 4.0


def plot_excerpt(series: TimeSeries, path: str | Path, *, title: str) -> str:
    """Plot the first channels of a run over the middle of a long run or the whole of a short one.

    Returns:
        A sentence about the part of the run that the picture shows.
    """
    last = float(series.time[-1])
    start, stop = (0.0, last) if last <= 2.0 * _SHOWN else (0.5 * (last - _SHOWN), 0.5 * (last + _SHOWN))
    shown = series.names[:_PANELS]
    plot_traces({title: series}, shown, path, start=start, stop=stop, title=title)
    return f"{Path(path).name} shows {len(shown)} of {len(series.names)} channels from {start:g} to {stop:g} s"


def plot_spectra(
    runs: Mapping[str, TimeSeries],
    channels: Sequence[str],
    path: str | Path,
    *,
    highest: float = 30.0,
    title: str = "Power spectral densities",
) -> None:
    """Plot power spectral densities (Welch, Hann, 4 s blocks) up to `highest` [Hz], one panel per channel."""
    figure = new_figure(11, 2.4 * ((len(channels) + 1) // 2) + 0.8)
    panels = panels_of(figure, len(channels), 2, sharex=True)
    for panel, channel in zip(panels, channels, strict=True):
        for (label, series), color in zip(runs.items(), COLORS, strict=False):
            values = _displayed(series, channel)
            block = min(values.size, int(4.0 * series.sample_rate))
            frequency, density = scipy.signal.welch(values, fs=series.sample_rate, nperseg=block, detrend="constant")
            kept = (frequency > 0.0) & (frequency <= highest)
            panel.semilogy(frequency[kept], density[kept], lw=1.2, color=color, label=label)
        unit = _display_unit(next(iter(runs.values())), channel)
        panel.set_title(channel, fontsize=9)
        panel.set_ylabel(f"({unit})²/Hz")
        panel.grid(alpha=0.3)
    for panel in panels[-2:]:
        panel.set_xlabel("frequency [Hz]")
        panel.tick_params(labelbottom=True)
    panels[0].legend(frameon=False)
    figure.suptitle(title)
    save(figure, path)


def _display_unit(series: TimeSeries, channel: str) -> str:
    return units.us_customary(series.unit(channel))


def _displayed(series: TimeSeries, channel: str) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    return units.convert(series[channel], series.unit(channel), _display_unit(series, channel))


def _label(panel: Axes, runs: Mapping[str, TimeSeries], channel: str) -> None:
    panel.set_ylabel(f"{channel}\n[{_display_unit(next(iter(runs.values())), channel)}]", fontsize=9)
    panel.yaxis.set_label_coords(-0.055, 0.5)
    panel.grid(alpha=0.3)
