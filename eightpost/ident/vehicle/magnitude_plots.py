"""Plots of the magnitudes of frequency responses."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from eightpost.ident.response import FrequencyResponse
from eightpost.report.pictures import Axes, Figure, new_figure, panels_of, save

#: Largest number of panels side by side.
COLUMNS = 4
#: Magnitude relative to the largest of a panel below which a curve is not drawn, as the channel does not respond [1].
_NOTHING = 1e-9


def plot_magnitudes(responses: Mapping[str, FrequencyResponse], output: str, path: str | Path) -> None:
    """Write a PNG of `20 log10 |H|` of one output: one panel per input, one line per response (Eq 4.8).

    Args:
        responses: Responses with the same channels, by label.
        output: Name of the output to plot.
        path: Path of the PNG. The file is replaced completely or not at all.
    """
    save(magnitudes(responses, output), path, format="png")


def magnitudes(responses: Mapping[str, FrequencyResponse], output: str) -> Figure:
    """Return the figure of `plot_magnitudes`."""
    first = next(iter(responses.values()))
    inputs = first.input_names
    columns = min(COLUMNS, len(inputs))
    figure = new_figure(4.2 * columns, 3.4 * -(-len(inputs) // columns))
    panels = panels_of(figure, len(inputs), columns, sharex=True)
    for axes, name in zip(panels, inputs, strict=True):
        _panel(axes, responses, output, name)
    if len(responses) > 1:
        figure.legend(*panels[0].get_legend_handles_labels(), loc="outside lower center", ncols=len(responses))
    return figure


def _panel(axes: Axes, responses: Mapping[str, FrequencyResponse], output: str, source: str) -> None:
    largest = max(float(np.abs(response.between(output, source)).max()) for response in responses.values())
    for label, response in responses.items():
        size = np.abs(response.between(output, source))
        shown = np.where(size > _NOTHING * max(largest, 1e-300), size, np.nan)
        axes.plot(response.frequency, 20.0 * np.log10(shown), label=label, linewidth=1.3)
    first = next(iter(responses.values()))
    unit = first.outputs[first.output_names.index(output)].unit
    per = first.inputs[first.input_names.index(source)].unit
    axes.set(title=f"{output} / {source}", xlabel="frequency [Hz]", ylabel=f"magnitude [dB re {unit} per {per}]")
    axes.grid(alpha=0.3)
