"""Pictures of a fit: estimate, model over it, and coherence, a panel per input (Figs 4.10, 5.13, 6.20 to 6.24)."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from eightpost.files import atomic_path
from eightpost.ident.response import response_of

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from matplotlib.axes import Axes
    from numpy.typing import NDArray

    from eightpost.ident.response import FrequencyResponse
    from eightpost.ident.vehicle.vehicle_fit import VehicleFit

_COLUMNS = 4
#: Sizes [in]: a panel with its labels, left of its axes, and the strip below all panels.
_WIDE, _HIGH_ROW, _MARGIN, _STRIP = 3.9, 3.0, 0.72, 2.2
#: What the strip leaves free at its sides: its legend has twelve inputs of a car.
_LEGEND = 2.7
#: What is drawn [Hz].
_LOW, _HIGH = 0.3, 25.0


def plot_fits(fit: VehicleFit, outputs: Sequence[str], folder: Path) -> list[Path]:
    """Write a PNG for each output, of its responses to every input: estimate and model, coherence below.

    Args:
        fit: The fit.
        outputs: Which.
        folder: Where the PNGs go, each named as its output; replaced whole or not at all.
    """
    if not outputs:
        return []
    estimate = fit.response.select(outputs=outputs).band(_LOW, _HIGH)
    model = response_of(fit.vehicle.state_space.select(outputs=outputs), estimate.frequency)
    paths = [folder / f"{output}.png" for output in outputs]
    for output, path in zip(outputs, paths, strict=True):
        figure = _figure(estimate.select(outputs=[output]), model.select(outputs=[output]), fit.recipe)
        with atomic_path(path) as temporary:
            figure.savefig(temporary, format="png", dpi=90)
    return paths


def _figure(estimate: FrequencyResponse, model: FrequencyResponse, recipe: str) -> Figure:
    """Places are reckoned: laying out by what is drawn takes as long as drawing it."""
    columns = min(_COLUMNS, len(estimate.inputs))
    rows = -(-len(estimate.inputs) // columns)
    figure = Figure(figsize=(_WIDE * columns, _STRIP + _HIGH_ROW * rows + 0.25))
    FigureCanvasAgg(figure)
    for place in range(len(estimate.inputs)):
        row, column = divmod(place, columns)
        corner = (_WIDE * column + _MARGIN, _STRIP + _HIGH_ROW * (rows - 1 - row) + 0.5)
        _magnitude(_axes(figure, corner, (_WIDE - 0.85, _HIGH_ROW - 0.95)), estimate, model, place)
    _coherence(_axes(figure, (_MARGIN, 0.5), (_WIDE * columns - _LEGEND, _STRIP - 0.75)), estimate)
    title = f"{estimate.outputs[0].name}: estimate and model, {recipe}"
    figure.suptitle(title, y=1.0 - 0.12 / figure.get_figheight(), va="top")
    return figure


def _axes(figure: Figure, corner: tuple[float, float], size: tuple[float, float]) -> Axes:
    """Add axes; lower left corner and size in inches."""
    wide, high = figure.get_size_inches()
    return figure.add_axes((corner[0] / wide, corner[1] / high, size[0] / wide, size[1] / high))


def _magnitude(axes: Axes, estimate: FrequencyResponse, model: FrequencyResponse, column: int) -> None:
    decibels = [_decibels(response.H[0, column]) for response in (estimate, model)]
    axes.plot(estimate.frequency, decibels[0], color="0.6", linewidth=2.2, label="estimate")
    axes.plot(model.frequency, decibels[1], color="tab:red", linewidth=1.1, label="model")
    source, out = estimate.inputs[column], estimate.outputs[0]
    axes.set(title=source.name, ylabel=f"dB re {out.unit} per {source.unit}")
    axes.locator_params(nbins=5)
    axes.grid(alpha=0.3)
    if column == 0:
        axes.legend(fontsize="small")


def _decibels(path: NDArray[np.complex128]) -> NDArray[np.float64]:
    size = np.abs(path)
    return np.asarray(20.0 * np.log10(np.where(size > 0.0, size, np.nan)))


def _coherence(axes: Axes, estimate: FrequencyResponse) -> None:
    if estimate.partial_coherence is not None:
        for source, partial in zip(estimate.inputs, estimate.partial_coherence[0], strict=True):
            axes.plot(estimate.frequency, partial, linewidth=1.0, label=source.name)
    if estimate.coherence is not None:
        axes.plot(estimate.frequency, estimate.coherence[0], color="black", linewidth=1.2, label="all inputs")
    title = "coherence with all inputs" if estimate.partial_coherence is None else "coherence, partial by input"
    axes.set(title=title, ylim=(0.0, 1.05), xlabel="frequency [Hz]")
    axes.grid(alpha=0.3)
    axes.legend(fontsize="x-small", loc="center left", bbox_to_anchor=(1.005, 0.5), ncols=2)
