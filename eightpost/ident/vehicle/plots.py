"""Plots of the identification of a vehicle."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Literal

import numpy as np

from eightpost.array_types import Array, Complex
from eightpost.ident.response import FrequencyResponse, response_of
from eightpost.ident.vehicle.common_poles.common_pole_fit import CLEAR_GAP
from eightpost.ident.vehicle.magnitude_plots import COLUMNS
from eightpost.ident.vehicle.trust import Orders
from eightpost.ident.vehicle.vehicle_fit import VehicleFit
from eightpost.report.pictures import Axes, Figure, new_figure, save, ticks_at_1_2_5

# ---- Plots of a fit -------------------------------------------------------------------------------------------------

#: Sizes [in]: width and height of a panel with its labels, left margin of its axes, height of the coherence plot.
_WIDE, _HIGH_ROW, _MARGIN, _STRIP = 3.9, 3.0, 0.72, 2.2
#: Width [in] beside the coherence plot for its legend, which has up to twelve inputs.
_LEGEND = 2.7
#: Plotted frequency band [Hz].
_LOW, _HIGH = 0.3, 25.0
#: Compression level of PNGs, 0 to 9; higher levels take longer and save little.
_COMPRESSION = 3


def plot_fits(fit: VehicleFit, outputs: Sequence[str], folder: Path) -> list[Path]:
    """Write a PNG for each output with its responses to every input (estimate and model) and the coherence below.

    Args:
        fit: Fit of the vehicle.
        outputs: Names of the outputs to plot.
        folder: Folder for the PNGs, each named after its output. A file is replaced completely or not at all.
    """
    if not outputs:
        return []
    estimate = fit.response.select(outputs=outputs).band(_LOW, _HIGH)
    model = response_of(fit.vehicle.state_space.select(outputs=outputs), estimate.frequency)
    sheet = _Sheet(estimate, fit.recipe)
    paths = [folder / f"{output}.png" for output in outputs]
    for row, path in enumerate(paths):
        sheet.show(estimate, model, row)
        save(sheet.figure, path, format="png", dpi=90, pil_kwargs={"compress_level": _COMPRESSION})
    return paths


class _Sheet:
    """Figure with the panels of one output, created once and filled for one output after another to save time.

    Positions are computed here, as an automatic layout would double the time.

    Args:
        estimate: Estimated response; each of its inputs has a panel.
        recipe: Name of the recipe for the title.
    """

    def __init__(self, estimate: FrequencyResponse, recipe: str) -> None:
        columns = min(COLUMNS, len(estimate.inputs))
        rows = -(-len(estimate.inputs) // columns)
        self.figure = new_figure(_WIDE * columns, _STRIP + _HIGH_ROW * rows + 0.25, layout=None)
        self._panels = []
        for place in range(len(estimate.inputs)):
            row, column = divmod(place, columns)
            corner = (_WIDE * column + _MARGIN, _STRIP + _HIGH_ROW * (rows - 1 - row) + 0.5)
            axes = _axes(self.figure, corner, (_WIDE - 0.85, _HIGH_ROW - 0.95))
            self._panels.append(_Panel(axes, estimate.frequency, estimate.inputs[place].name, is_first=place == 0))
        self._strip = _Strip(_axes(self.figure, (_MARGIN, 0.5), (_WIDE * columns - _LEGEND, _STRIP - 0.75)), estimate)
        high = self.figure.get_figheight()
        self._title = self.figure.suptitle("", y=1.0 - 0.12 / high, va="top")
        self._recipe = recipe

    def show(self, estimate: FrequencyResponse, model: FrequencyResponse, row: int) -> None:
        """Fill the panels with the data of an output."""
        out = estimate.outputs[row]
        for panel, source, paths in zip(
            self._panels, estimate.inputs, zip(estimate.H[row], model.H[row], strict=True), strict=True
        ):
            panel.show(*paths, f"dB re {out.unit} per {source.unit}")
        self._strip.show(estimate, row)
        self._title.set_text(f"{out.name}: estimate and model, {self._recipe}")


class _Panel:
    """Panel with estimate and model of one path."""

    def __init__(self, axes: Axes, frequency: Array, name: str, *, is_first: bool) -> None:
        self._axes = axes
        empty = np.full(frequency.size, np.nan)
        self._lines = (
            axes.plot(frequency, empty, color="0.6", linewidth=2.2, label="estimate")[0],
            axes.plot(frequency, empty, color="tab:red", linewidth=1.1, label="model")[0],
        )
        axes.set_title(name, y=1.0)
        axes.locator_params(nbins=5)
        axes.grid(alpha=0.3)
        if is_first:
            axes.legend(fontsize="small")

    def show(self, estimate: Complex, model: Complex, label: str) -> None:
        for line, path in zip(self._lines, (estimate, model), strict=True):
            line.set_ydata(_decibels(path))
        self._axes.set_ylabel(label)
        self._axes.relim()
        self._axes.autoscale_view()


class _Strip:
    """Plot of the coherence with each input and with all inputs."""

    def __init__(self, axes: Axes, estimate: FrequencyResponse) -> None:
        empty = np.full(estimate.frequency.size, np.nan)
        self._lines = []
        if estimate.partial_coherence is not None:
            for source in estimate.inputs:
                self._lines += axes.plot(estimate.frequency, empty, linewidth=1.0, label=source.name)
        if estimate.coherence is not None:
            self._lines += axes.plot(estimate.frequency, empty, color="black", linewidth=1.2, label="all inputs")
        title = "coherence with all inputs" if estimate.partial_coherence is None else "coherence, partial by input"
        axes.set_title(title, y=1.0)
        axes.set(ylim=(0.0, 1.05), xlabel="frequency [Hz]")
        axes.grid(alpha=0.3)
        if self._lines:
            axes.legend(fontsize="x-small", loc="center left", bbox_to_anchor=(1.005, 0.5), ncols=2)
        self._axes = axes

    def show(self, estimate: FrequencyResponse, row: int) -> None:
        partial = () if estimate.partial_coherence is None else estimate.partial_coherence[row]
        every = () if estimate.coherence is None else (estimate.coherence[row],)
        for line, values in zip(self._lines, (*partial, *every), strict=True):
            line.set_ydata(values)
        self._axes.relim()
        self._axes.autoscale_view(scaley=False)


def _axes(figure: Figure, corner: tuple[float, float], size: tuple[float, float]) -> Axes:
    """Add axes with the given lower left corner and size [in]."""
    wide, high = figure.get_size_inches()
    return figure.add_axes((corner[0] / wide, corner[1] / high, size[0] / wide, size[1] / high))


def _decibels(path: Complex) -> Array:
    size = np.abs(path)
    return np.asarray(20.0 * np.log10(np.where(size > 0.0, size, np.nan)))


# ---- Stabilisation diagram: poles of models of increasing order, and which of them are stable ------------------------


def _plot_stabilisation(orders: Orders, path: Path) -> None:
    """Write a PNG of the poles over frequency and order, and of the gaps of the singular values."""
    figure = new_figure(11.0, 4.6)
    poles, gaps = figure.subplots(1, 2, sharey=True, width_ratios=(4, 1))
    _draw_poles(poles, orders)
    gaps.barh([one.states for one in orders.tried], [one.gap for one in orders.tried], height=1.2)
    gaps.axhline(orders.chosen, color="tab:red", linewidth=1.0)
    gaps.axvline(CLEAR_GAP, color="0.5", linewidth=1.0, linestyle="--", label="clear gap")
    gaps.set(title="gap", xlabel="ratio to next singular value", xscale="log")
    ticks_at_1_2_5(gaps)
    gaps.legend(fontsize="small", loc="upper right")
    save(figure, path, format="png")


def _draw_poles(axes: Axes, orders: Orders) -> None:
    placed = [(one.states, pole) for one in orders.tried for pole in one.poles if pole.frequency <= 1.2 * orders.high]
    for steady, marker, label in ((True, "o", "stable"), (False, "x", "not stable")):
        chosen = [(pole.frequency, states) for states, pole in placed if pole.steady is steady]
        axes.plot([f for f, _ in chosen], [states for _, states in chosen], marker, markersize=5, label=label)
    why = "a clear gap" if orders.is_clear else "no clear gap"
    axes.axhline(orders.chosen, color="tab:red", linewidth=1.0, label=f"{orders.chosen} states, {why}")
    top = orders.tried[-1].states + 5.0  # space for the legend
    axes.set(title="stabilisation diagram", xlabel="frequency [Hz]", ylabel="states", ylim=(0.0, top))
    axes.legend(loc="upper left", ncols=3, fontsize="small")
    axes.grid(alpha=0.3)


# ---- All plots of an identification ---------------------------------------------------------------------------------

#: Key outputs: shock velocities, and the outputs that setups are judged by.
KEY_OUTPUTS = ("velocity", "tire_force", "ride_height")


def plot_identification(fit: VehicleFit, folder: Path, outputs: Literal["none", "main", "all"]) -> list[Path]:
    """Draw the fit of the key outputs (main) or of all, and the stabilisation diagram; return the pictures."""
    names = [n for n in fit.residual if outputs == "all" or (outputs == "main" and n.endswith(KEY_OUTPUTS))]
    drawn = plot_fits(fit, names, folder)
    if outputs != "none" and fit.trust is not None and fit.trust.orders is not None:
        drawn.append(folder / "stabilisation.png")
        _plot_stabilisation(fit.trust.orders, drawn[-1])
    return drawn
