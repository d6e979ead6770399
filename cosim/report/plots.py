"""Plots of runs: time traces and spectra. Each is one figure in one file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from eightpost.report.packing import welch
from eightpost.report.pictures import (
    COLORS,
    display_unit,
    displayed,
    new_figure,
    panels_of,
    save,
    traces,
)
from eightpost.signals import TimeSeries


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
    save(traces(runs, channels, start=start, stop=stop, title=title), path)


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
            values = displayed(series, channel)
            block = min(values.size, int(4.0 * series.sample_rate))
            frequency, density = welch(values, series.sample_rate, block)
            within = (frequency > 0.0) & (frequency <= highest)
            panel.semilogy(frequency[within], density[within], lw=1.2, color=color, label=label)
        unit = display_unit(next(iter(runs.values())), channel)
        panel.set_title(channel, fontsize=9)
        panel.set_ylabel(f"({unit})²/Hz")
        panel.grid(alpha=0.3)
    for panel in panels[-2:]:
        panel.set_xlabel("frequency [Hz]")
        panel.tick_params(labelbottom=True)
    panels[0].legend(frameon=False)
    figure.suptitle(title)
    save(figure, path)
