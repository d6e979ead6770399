"""Plots of frequency responses: magnitude over frequency, one panel per input (Figs 4.2 to 4.5, 5.3 to 5.5)."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from eightpost.files import atomic_path

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from matplotlib.axes import Axes

    from eightpost.ident.response import FrequencyResponse

_COLUMNS = 4
#: Magnitude relative to the largest of a panel below which a curve is not drawn, as the channel does not respond [1].
_NOTHING = 1e-9


def plot_magnitudes(responses: Mapping[str, FrequencyResponse], output: str, path: str | Path) -> None:
    """Write a PNG of `20 log10 |H|` of one output: one panel per input, one line per response (Eq 4.8).

    Args:
        responses: Responses with the same channels, by label.
        output: Name of the output to plot.
        path: Path of the PNG. The file is replaced completely or not at all.
    """
    first = next(iter(responses.values()))
    inputs = first.input_names
    columns = min(_COLUMNS, len(inputs))
    rows = -(-len(inputs) // columns)
    figure = Figure(figsize=(4.2 * columns, 3.4 * rows), layout="constrained")
    FigureCanvasAgg(figure)
    panels = figure.subplots(rows, columns, sharex=True, squeeze=False).ravel()
    for axes, name in zip(panels, inputs, strict=False):
        _panel(axes, responses, output, name)
    for axes in panels[len(inputs) :]:
        axes.set_visible(False)
    if len(responses) > 1:
        figure.legend(*panels[0].get_legend_handles_labels(), loc="outside lower center", ncols=len(responses))
    with atomic_path(path) as temporary:
        figure.savefig(temporary, format="png", dpi=110)


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
