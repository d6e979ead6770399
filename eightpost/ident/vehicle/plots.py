"""Pictures of frequency responses and of an identification."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from eightpost.ident.vehicle.common_pole_fit import CLEAR_GAP
from eightpost.ident.vehicle.frequency_response import FrequencyResponse, response_of
from eightpost.ident.vehicle.trust import Orders
from eightpost.report.pictures import Axes, Figure, new_figure, panels_of, save, ticks_at_1_2_5
from eightpost.vehicle import StateSpace

#: Largest number of panels side by side.
COLUMNS = 4
#: Magnitude relative to the largest of a panel below which a curve is not drawn, as the channel does not respond [1].
_NOTHING = 1e-9


def plot_magnitudes(responses: Mapping[str, FrequencyResponse], output: str, path: str | Path) -> None:
    """Write a PNG of `20 log10 |H|` of one output: one panel per input, one line per response, by label (Eq 4.8)."""
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


# ---- Plots of a fit -------------------------------------------------------------------------------------------------

#: Sizes [in]: width and height of a panel with its labels, left margin of its axes, height of the coherence plot.
_WIDE, _HIGH_ROW, _MARGIN, _STRIP = 3.9, 3.0, 0.72, 2.2
#: Width [in] beside the coherence plot for its legend, which has up to twelve inputs.
_LEGEND = 2.7
#: Plotted frequency band [Hz].
_LOW, _HIGH = 0.3, 25.0
#: Compression level of PNGs, 0 to 9; higher levels take longer and save little.
_COMPRESSION = 3


def plot_fits(estimate: FrequencyResponse, model: StateSpace, recipe: str, folder: Path) -> list[Path]:
    """Write a PNG for each output with its responses to every input (estimate and model) and the coherence below.

    Each is named after its output, and is replaced completely or not at all.
    """
    if not estimate.outputs:
        return []
    estimate = estimate.band(_LOW, _HIGH)
    fitted = response_of(model, estimate.frequency)
    sheet = _Sheet(estimate, recipe)
    paths = [folder / f"{output}.png" for output in estimate.output_names]
    for row, path in enumerate(paths):
        sheet.show(estimate, fitted, row)
        save(sheet.figure, path, format="png", dpi=90, pil_kwargs={"compress_level": _COMPRESSION})
    return paths


class _Sheet:
    """Figure with the panels of one output, created once and filled for one output after another to save time.

    Positions are computed here, as an automatic layout would double the time.
    """

    def __init__(self, estimate: FrequencyResponse, recipe: str) -> None:
        columns = min(COLUMNS, len(estimate.inputs))
        rows = -(-len(estimate.inputs) // columns)
        self.figure, self._recipe = new_figure(_WIDE * columns, _STRIP + _HIGH_ROW * rows + 0.25, layout=None), recipe
        frequency, empty = estimate.frequency, np.full(estimate.frequency.size, np.nan)
        self._panels = []
        for place, source in enumerate(estimate.inputs):
            row, column = divmod(place, columns)
            corner = (_WIDE * column + _MARGIN, _STRIP + _HIGH_ROW * (rows - 1 - row) + 0.5)
            axes = _axes(self.figure, corner, (_WIDE - 0.85, _HIGH_ROW - 0.95))
            lines = (
                axes.plot(frequency, empty, color="0.6", linewidth=2.2, label="estimate")[0],
                axes.plot(frequency, empty, color="tab:red", linewidth=1.1, label="model")[0],
            )
            axes.set_title(source.name, y=1.0)
            axes.locator_params(nbins=5)
            axes.grid(alpha=0.3)
            if place == 0:
                axes.legend(fontsize="small")
            self._panels.append((axes, lines))
        self._strip, self._coherences = (
            _axes(self.figure, (_MARGIN, 0.5), (_WIDE * columns - _LEGEND, _STRIP - 0.75)),
            [],
        )
        if estimate.partial_coherence is not None:
            for source in estimate.inputs:
                self._coherences += self._strip.plot(frequency, empty, linewidth=1.0, label=source.name)
        if estimate.coherence is not None:
            self._coherences += self._strip.plot(frequency, empty, color="black", linewidth=1.2, label="all inputs")
        title = "coherence with all inputs" if estimate.partial_coherence is None else "coherence, partial by input"
        self._strip.set_title(title, y=1.0)
        self._strip.set(ylim=(0.0, 1.05), xlabel="frequency [Hz]")
        self._strip.grid(alpha=0.3)
        if self._coherences:
            self._strip.legend(fontsize="x-small", loc="center left", bbox_to_anchor=(1.005, 0.5), ncols=2)
        self._title = self.figure.suptitle("", y=1.0 - 0.12 / self.figure.get_figheight(), va="top")

    def show(self, estimate: FrequencyResponse, model: FrequencyResponse, row: int) -> None:
        """Fill the panels with the data of an output."""
        out = estimate.outputs[row]
        for column, (axes, lines) in enumerate(self._panels):
            for line, response in zip(lines, (estimate, model), strict=True):
                size = np.abs(response.H[row, column])
                line.set_ydata(20.0 * np.log10(np.where(size > 0.0, size, np.nan)))
            axes.set_ylabel(f"dB re {out.unit} per {estimate.inputs[column].unit}")
            axes.relim()
            axes.autoscale_view()
        partial = () if estimate.partial_coherence is None else estimate.partial_coherence[row]
        every = () if estimate.coherence is None else (estimate.coherence[row],)
        for line, values in zip(self._coherences, (*partial, *every), strict=True):
            line.set_ydata(values)
        self._strip.relim()
        self._strip.autoscale_view(scaley=False)
        self._title.set_text(f"{out.name}: estimate and model, {self._recipe}")


def _axes(figure: Figure, corner: tuple[float, float], size: tuple[float, float]) -> Axes:
    """Add axes with the given lower left corner and size [in]."""
    wide, high = figure.get_size_inches()
    return figure.add_axes((corner[0] / wide, corner[1] / high, size[0] / wide, size[1] / high))


# ---- Stabilisation diagram: poles of models of increasing order, and which of them are stable ------------------------


def plot_stabilisation(orders: Orders, path: Path) -> None:
    """Write a PNG of the poles over frequency and order, and of the gaps of the singular values."""
    figure = new_figure(11.0, 4.6)
    poles, gaps = figure.subplots(1, 2, sharey=True, width_ratios=(4, 1))
    placed = [(one.states, pole) for one in orders.tried for pole in one.poles if pole.frequency <= 1.2 * orders.high]
    for steady, marker, label in ((True, "o", "stable"), (False, "x", "not stable")):
        chosen = [(pole.frequency, states) for states, pole in placed if pole.steady is steady]
        poles.plot([f for f, _ in chosen], [states for _, states in chosen], marker, markersize=5, label=label)
    why = "a clear gap" if orders.is_clear else "no clear gap"
    poles.axhline(orders.chosen, color="tab:red", linewidth=1.0, label=f"{orders.chosen} states, {why}")
    top = orders.tried[-1].states + 5.0  # space for the legend
    poles.set(title="stabilisation diagram", xlabel="frequency [Hz]", ylabel="states", ylim=(0.0, top))
    poles.legend(loc="upper left", ncols=3, fontsize="small")
    poles.grid(alpha=0.3)
    gaps.barh([one.states for one in orders.tried], [one.gap for one in orders.tried], height=1.2)
    gaps.axhline(orders.chosen, color="tab:red", linewidth=1.0)
    gaps.axvline(CLEAR_GAP, color="0.5", linewidth=1.0, linestyle="--", label="clear gap")
    gaps.set(title="gap", xlabel="ratio to next singular value", xscale="log")
    ticks_at_1_2_5(gaps)
    gaps.legend(fontsize="small", loc="upper right")
    save(figure, path, format="png")
