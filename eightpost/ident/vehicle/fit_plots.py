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
    columns = min(_COLUMNS, len(estimate.inputs))
    rows = -(-len(estimate.inputs) // columns)
    figure = Figure(figsize=(3.9 * columns, 3.6 * rows + 0.25))
    FigureCanvasAgg(figure)
    for place in range(len(estimate.inputs)):
        upper, lower = _panel(figure, place, rows, columns)
        _magnitude(upper, estimate, model, place)
        _coherence(lower, estimate, place)
    title = f"{estimate.outputs[0].name}: estimate and model, {recipe}"
    figure.suptitle(title, y=1.0 - 0.12 / figure.get_figheight(), va="top")
    return figure


def _panel(figure: Figure, place: int, rows: int, columns: int) -> tuple[Axes, Axes]:
    """Add the axes of one input. Places are reckoned: laying out by what is drawn takes as long as drawing it."""
    row, column = divmod(place, columns)
    wide, high = 1.0 / figure.get_figwidth(), 1.0 / figure.get_figheight()  # of an inch
    left, bottom = (3.9 * column + 0.72) * wide, (3.6 * (rows - 1 - row) + 0.5) * high
    lower = figure.add_axes((left, bottom, 3.05 * wide, 0.62 * high))
    upper = figure.add_axes((left, bottom + 0.74 * high, 3.05 * wide, 1.86 * high), sharex=lower)
    upper.tick_params(labelbottom=False)
    upper.locator_params(axis="y", nbins=5)
    lower.set_yticks([0.0, 1.0])
    return upper, lower


def _magnitude(axes: Axes, estimate: FrequencyResponse, model: FrequencyResponse, column: int) -> None:
    decibels = [_decibels(response.H[0, column]) for response in (estimate, model)]
    axes.plot(estimate.frequency, decibels[0], color="0.6", linewidth=2.2, label="estimate")
    axes.plot(model.frequency, decibels[1], color="tab:red", linewidth=1.1, label="model")
    source, out = estimate.inputs[column], estimate.outputs[0]
    axes.set(title=source.name, ylabel=f"dB re {out.unit} per {source.unit}")
    axes.grid(alpha=0.3)
    if column == 0:
        axes.legend(fontsize="small")


def _decibels(path: NDArray[np.complex128]) -> NDArray[np.float64]:
    size = np.abs(path)
    return np.asarray(20.0 * np.log10(np.where(size > 0.0, size, np.nan)))


def _coherence(axes: Axes, estimate: FrequencyResponse, column: int) -> None:
    if estimate.partial_coherence is not None:
        axes.plot(estimate.frequency, estimate.partial_coherence[0, column], linewidth=1.0, label="partial")
    if estimate.coherence is not None:
        axes.plot(estimate.frequency, estimate.coherence[0], color="0.7", linewidth=0.8, label="of all inputs")
    axes.set(ylim=(0.0, 1.05), xlabel="frequency [Hz]")
    axes.set_ylabel("coherence", fontsize="small")
    axes.grid(alpha=0.3)
    if column == 0:
        axes.legend(fontsize="x-small", loc="lower right")
