"""Figures of a vehicle's validation."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import groupby
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from eightpost.array_types import Array
from eightpost.ident.validation.figures import COLORS, MEASURED, Axis, Figure, Panel, grid
from eightpost.ident.vehicle_validation.comparison import quantity

if TYPE_CHECKING:
    from eightpost.ident.vehicle.trust import Orders
    from eightpost.ident.vehicle_validation.comparison import Comparison
    from eightpost.ident.vehicle_validation.findings import Limits
    from eightpost.ident.vehicle_validation.responses import Path
    from eightpost.ident.vehicle_validation.steady import SineOutput
    from eightpost.ident.vehicle_validation.study import Case, VehicleValidation
    from eightpost.ident.vehicle_validation.trends import Trend


# ---- Plots of levels ------------------------------------------------------------------------------------------------

_COLUMNS = 3

#: Number of outputs of a static record that are plotted, counted from the last: tire forces and ride heights.
_STATIC = 6


def trend_figure(trends: Sequence[Trend]) -> Figure:
    """Return a plot of the measured and predicted RMS of each record, with a panel for each output (Fig 6.27)."""
    number = np.arange(1.0, len(trends[0].measured) + 1.0)
    panels = [
        Panel(Axis("record"), Axis("RMS", one.unit), *place, title=f"{one.name}: rank {_rank(one)}")
        for one, place in zip(trends, grid(len(trends), _COLUMNS, gap=(0.08, _gap(len(trends)))), strict=True)
    ]
    caption = "RMS of each random record, in the order of the table of records, as in Fig 6.27."
    figure = Figure(caption, _height(len(trends)), panels)
    for k, one in enumerate(trends):
        figure.line(k, number, one.measured, name="measured", color=MEASURED)
        figure.marks(k, number, one.predicted, name="predicted", color=COLORS[0])
    return figure


def correlation_figure(trends: Sequence[Trend]) -> Figure:
    """Return a plot of predicted over measured RMS with the line of equality, a panel for each output (Fig 6.28)."""
    panels = [
        Panel(Axis("measured RMS", one.unit), Axis("predicted", one.unit), *place, title=_titled(one))
        for one, place in zip(trends, grid(len(trends), _COLUMNS, gap=(0.08, _gap(len(trends)))), strict=True)
    ]
    caption = "Predicted over measured RMS of the random records, as in Fig 6.28; the line is equality."
    figure = Figure(caption, _height(len(trends)), panels)
    for k, one in enumerate(trends):
        both = np.concatenate((one.measured, one.predicted))
        ends = np.array([both.min(), both.max()])
        figure.line(k, ends, ends, name="equality", color=MEASURED, dash="dot")
        figure.dots(k, one.measured, one.predicted, name="records", color=COLORS[0], size=8)
    return figure


def sine_figure(cases: Sequence[Case]) -> Figure:
    """Return a plot of gain and phase of the predicted fundamental, a line for each quantity's worst output."""
    rows = [(case.record.frequency or 0.0, case.sines) for case in cases if case.sines]
    rows.sort(key=lambda row: row[0])
    x = Axis("frequency [Hz]", kind="log")
    places = grid(3, 3, gap=(0.07, 0.0))
    titles = ("predicted / measured amplitude", "phase lead of predicted [degrees]", "measured: not sinusoidal [%]")
    panels = [Panel(x, Axis(""), *place, title=title) for place, title in zip(places, titles, strict=True)]
    figure = Figure("Sine records: for each quantity the output with the worst gain at each frequency.", 330, panels)
    figure.level(0, 1.0)
    figure.level(1, 0.0)
    names = sorted({quantity(one.name) for _, sines in rows for one in sines})
    for name, color in zip(names, COLORS * len(names), strict=False):
        found = [(frequency, _worst(sines, name)) for frequency, sines in rows]
        points = [(frequency, one) for frequency, one in found if one is not None]
        frequency = np.array([f for f, _ in points])
        figure.marks(0, frequency, np.array([one.gain for _, one in points]), name=name, color=color)
        figure.marks(1, frequency, np.degrees([one.phase for _, one in points]), name=name, color=color)
        figure.marks(2, frequency, np.array([100.0 * one.harmonics for _, one in points]), name=name, color=color)
    return figure


def static_figure(case: Case) -> Figure:
    """Return a plot of tire forces and ride heights during the holds of a static record."""
    shown = case.holds[-_STATIC:]
    panels = [
        Panel(Axis("load", "N"), Axis("change", one.unit), *place, title=one.name)
        for one, place in zip(shown, grid(len(shown), _COLUMNS, gap=(0.08, _gap(len(shown)))), strict=True)
    ]
    caption = (
        f"{case.record.name}: levels minus their means, as in Fig 6.32. Friction causes loops in the measured ones."
    )
    figure = Figure(caption, _height(len(shown)), panels)
    for k, one in enumerate(shown):
        figure.marks(k, one.load, one.measured, name="measured", color=MEASURED)
        figure.marks(k, one.load, one.predicted, name="predicted", color=COLORS[0])
    return figure


def level_figure(study: VehicleValidation, limits: Limits) -> Figure:
    """Return an overview plot of RMS errors and errors, with a point for each output of each record."""
    places = grid(2, 2, gap=(0.08, 0.0))
    titles = ("RMS predicted minus measured [%]", "error [% of measured RMS]")
    cases = [case for case in study.cases if case.outputs and not case.is_gentle]
    panels = [Panel(Axis("record"), Axis(""), *place, title=title) for place, title in zip(places, titles, strict=True)]
    figure = Figure(
        "All judged outputs, records numbered as in the table. Dotted: limits; that of RMS is for random records.",
        330,
        panels,
    )
    for panel, value in ((0, limits.level), (0, -limits.level), (1, limits.error)):
        figure.level(panel, 100.0 * value)
    names = sorted({quantity(one.name) for case in cases for one in case.judged})
    for name, color in zip(names, COLORS * len(names), strict=False):
        found = [
            (study.cases.index(c) + 1.0, 100.0 * o.level, 100.0 * o.error)
            for c in cases
            for o in c.judged
            if quantity(o.name) == name
        ]
        number, level, error = np.array(found).T
        figure.dots(0, number, level, name=name, color=color, size=7)
        figure.dots(1, number, error, name=name, color=color, size=7)
    return figure


def _worst(sines: Sequence[SineOutput], name: str) -> SineOutput | None:
    found = [one for one in sines if quantity(one.name) == name]
    return max(found, key=lambda one: abs(one.gain - 1.0), default=None)


def _rank(trend: Trend) -> str:
    return "–, flat" if trend.is_flat else f"{trend.rank:.2f}"


def _titled(trend: Trend) -> str:
    return f"{trend.name}: level {100 * trend.bias:+.2g} %"


def _height(count: int) -> int:
    return 110 + 205 * (-(-count // _COLUMNS))


def _gap(count: int) -> float:
    """Return the gap between rows [1] that corresponds to 60 px, for a title and a label."""
    return 60.0 / (205.0 * (-(-count // _COLUMNS)))


# ---- Plot of the stabilisation diagram of a fit ---------------------------------------------------------------------


def order_figure(orders: Orders) -> Figure:
    """Return a plot of the poles of models of increasing order, and of the gaps of the singular values."""
    (poles, _), (_, row) = grid(2, 2, gap=(0.08, 0.0))
    states = Axis("states", span=(0.0, orders.tried[-1].states + 2.0))
    panels = (
        Panel(Axis("frequency [Hz]", span=(0.0, 1.2 * orders.high)), states, (poles[0], 0.76), row, title="poles"),
        Panel(Axis("singular value / next one", kind="log"), states, (0.82, 1.0), row, title="gaps"),
    )
    why = "a clear gap of the singular values" if orders.is_clear else "the description length, as no gap is clear"
    figure = Figure(
        f"Stabilisation diagram: poles of models of increasing order. {orders.chosen} states were chosen by {why}.",
        380,
        panels,
    )
    for steady, name, color in ((False, "moved", MEASURED), (True, "same as at the previous order", COLORS[0])):
        there = [(p.frequency, one.states) for one in orders.tried for p in one.poles if p.steady is steady]
        kept = np.array([pair for pair in there if pair[0] <= 1.2 * orders.high]).reshape(-1, 2)
        figure.dots(0, kept[:, 0], kept[:, 1], name=name, color=color, size=6.0)
    gaps = np.array([one.gap for one in orders.tried])
    figure.marks(1, gaps, np.array([float(one.states) for one in orders.tried]), name="gap", color=COLORS[2])
    for panel in (0, 1):
        figure.level(panel, float(orders.chosen))
    return figure


# ---- Plots of responses with coherence and confidence interval, and of error spectra --------------------------------

#: Number of outputs per figure; points per line; lowest density that is plotted, below the largest [dB].
_OUTPUTS, _POINTS, _DEEP = 4, 400, 80.0


def response_figures(paths: Sequence[Path]) -> Iterator[Figure]:
    """Yield plots of the responses of every judged output to its strongest road and shock force, with coherence."""
    rows = [tuple(found) for _, found in groupby(paths, key=lambda path: path.output)]
    for start in range(0, len(rows), _OUTPUTS):
        yield _responses(rows[start : start + _OUTPUTS])


def _responses(rows: Sequence[Sequence[Path]]) -> Figure:
    places = grid(3 * len(rows), 3, gap=(0.07, 0.27 / len(rows)))
    panels: list[Panel] = []
    for k, paths in enumerate(rows):
        x = Axis("frequency [Hz]" if k == len(rows) - 1 else "", kind="log")
        for i in range(2):
            path = paths[min(i, len(paths) - 1)]
            title = f"{path.output} from {path.input}"
            panels.append(Panel(x, Axis(f"dB re 1 {path.unit}"), *places[3 * k + i], title=title))
        title = f"{paths[0].output}: multiple coherence"
        panels.append(Panel(x, Axis("", span=(0.0, 1.05)), *places[3 * k + 2], title=title))
    figure = Figure(
        "Responses of the model and of the estimate that it was fitted to, with the estimate's 95 % band. Coherence "
        "near 1 does not exclude friction.",
        110 + 170 * len(rows),
        panels,
    )
    for k, paths in enumerate(rows):
        for i, path in enumerate(paths[:2]):
            _response(figure, 3 * k + i, path)
        if paths[0].coherence is not None:
            kept = _kept(paths[0].frequency)
            figure.line(
                3 * k + 2, paths[0].frequency[kept], paths[0].coherence[kept], name="coherence", color=COLORS[2]
            )
    return figure


def _coherence(figure: Figure, panel: int, frequency: Array, coherence: Array) -> None:
    kept = _kept(frequency)
    figure.line(panel, frequency[kept], coherence[kept], name="coherence", color=COLORS[2])


def _response(figure: Figure, panel: int, path: Path) -> None:
    kept = _kept(path.frequency)
    frequency = path.frequency[kept]
    figure.line(panel, frequency, _db(path.estimate)[kept], name="estimate", color=MEASURED)
    if path.band is not None:
        floor = 0.05 * np.abs(path.estimate)  # zero would be minus infinity in dB
        for end in path.band:
            values = _db(np.maximum(end, floor))[kept]
            figure.line(panel, frequency, values, name="95 % band", color=COLORS[4], dash="dot")
    figure.line(panel, frequency, _db(path.model)[kept], name="model", color=COLORS[0])


def spectrum_figure(case: Case) -> Figure:
    """Return a plot of the spectra of a record's outputs and errors, and of the coherence of error and prediction."""
    names = sorted(case.spectra, key=lambda name: -next(o.error for o in case.judged if o.name == name))[:3]
    places = grid(2 * len(names), len(names), gap=(0.07, 0.2))
    x = Axis("frequency [Hz]", kind="log")
    panels = [Panel(x, Axis("dB re largest"), *places[k], title=name) for k, name in enumerate(names)]
    panels += [Panel(x, Axis("coherence", span=(0.0, 1.05)), *place) for place in places[len(names) :]]
    caption = (
        f"{case.record.name}: the three outputs with the largest errors. Above: spectra of output and error; below: "
        "coherence of error and prediction, near 1 if another gain or phase would have predicted the error."
    )
    figure = Figure(caption, 480, panels)
    for k, name in enumerate(names):
        spectrum = case.spectra[name]
        largest = spectrum.measured.max()
        for values, title, color in ((spectrum.measured, "measured", MEASURED), (spectrum.error, "error", COLORS[1])):
            decibels = 10.0 * np.log10(np.maximum(values / largest, 10.0 ** (-_DEEP / 10.0)))
            figure.line(k, spectrum.frequency, decibels, name=title, color=color)
        figure.line(len(names) + k, spectrum.frequency, spectrum.coherence, name="coherence", color=COLORS[2])
    return figure


def _kept(frequency: Array) -> NDArray[np.intp]:
    """Return the indices of the points that are plotted, spaced logarithmically; long estimates have thousands."""
    if frequency.size <= _POINTS:
        return np.arange(frequency.size)
    wanted = np.geomspace(frequency[0] or frequency[1], frequency[-1], _POINTS)
    return np.unique(np.clip(np.searchsorted(frequency, wanted), 0, frequency.size - 1))


def _db(values: NDArray[np.complex128] | Array) -> Array:
    return np.asarray(20.0 * np.log10(np.maximum(np.abs(values), 1e-300)))


# ---- Plots of measured and predicted outputs over time (Figs 6.26, 6.29, 6.31) --------------------------------------

#: Length of the plotted part of a record [s], for a sine in periods, and maximum number of points per line.
_SPAN, _PERIODS, _TIME_FIGURES_POINTS = {"random": 4.0, "bump": 1.5}, 3.0, 700

#: Panels per row.
_TIME_FIGURES_COLUMNS = 2

#: Time before a bump [s].
_BEFORE = 0.2

#: Quantities that are plotted, with the worst predicted output of each (6.5 shows four signals).
_DRAWN = ("velocity", "tire_force", "total_tire_force", "ride_height", "hub_acceleration", "chassis_acceleration")


def time_figure(case: Case) -> Figure:
    """Return a plot of part of a record: for each quantity the output with the worst prediction."""
    shown = list(_shown(case))
    kept = _piece(case, shown[0])
    rows = -(-len(shown) // _TIME_FIGURES_COLUMNS)
    places = grid(len(shown), _TIME_FIGURES_COLUMNS, gap=(0.08, 0.24 / rows))
    panels = [
        Panel(
            Axis("time [s]" if k >= len(shown) - _TIME_FIGURES_COLUMNS else ""),
            Axis(quantity(one.name).replace("_", " "), one.unit),
            *place,
            title=f"{one.name}: error {100 * one.error:.2g} %",
        )
        for k, (one, place) in enumerate(zip(shown, places, strict=True))
    ]
    caption = f"{case.record.name}: for each quantity the output with the worst prediction. Ports: {case.shocks}."
    figure = Figure(caption, 130 + 170 * rows, panels)
    smooth = {one.name: one for one in case.without_friction or ()}
    for k, one in enumerate(shown):
        time = case.time[kept]
        figure.line(k, time, one.measured[kept], name="measured", color=MEASURED)
        if one.name in smooth:
            figure.line(k, time, smooth[one.name].predicted[kept], name="without friction", color=COLORS[1], dash="dot")
        figure.line(k, time, one.predicted[kept], name="predicted", color=COLORS[0])
    return figure


def _shown(case: Case) -> Iterator[Comparison]:
    for shown in _DRAWN:
        outputs = [one for one in case.outputs if quantity(one.name) == shown]
        moving = [one for one in outputs if one.is_judged] or outputs
        if moving:
            yield max(moving, key=lambda one: one.error)


def _piece(case: Case, one: Comparison) -> np.ndarray[tuple[int, ...], np.dtype[np.intp]]:
    """Return the indices of the plotted samples: around the largest value, or for a bump from just before it."""
    rate, record = case.record.series.sample_rate, case.record
    span = _PERIODS / record.frequency if record.frequency else _SPAN.get(record.kind, _SPAN["random"])
    top = int(np.argmax(np.abs(one.measured)))
    before = round((_BEFORE if record.kind == "bump" else 0.5 * span) * rate)
    count = min(round(span * rate), one.measured.size)
    first = min(max(top - before, 0), one.measured.size - count)
    return np.unique(np.linspace(first, first + count - 1, min(_TIME_FIGURES_POINTS, count)).astype(np.intp))
