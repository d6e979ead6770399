"""A vehicle's validation as tables for the terminal, and as a page of sections and figures, also for print."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from itertools import groupby
from pathlib import Path

import numpy as np
from markupsafe import Markup
from numpy.typing import NDArray

from eightpost.array_types import Array, Complex
from eightpost.ident.validation.comparison import Comparison, Response, SineOutput, Trend
from eightpost.ident.validation.vehicles import Limits, VehicleCase, VehicleValidation, vehicle_verdict
from eightpost.ident.vehicle.experiment import quantity
from eightpost.ident.vehicle.trust import Orders
from eightpost.ident.vehicle.vehicle_fit import TENTH, VehicleFit
from eightpost.report.charts import COLORS, MEASURED, Axis, Figure, Panel, grid_figure, row_figure
from eightpost.report.page import Block, Section, digest, document, write_page
from eightpost.report.tables import NONE, Amount, Cell, ResultTable
from eightpost.uncertainty import MeasureUncertainty

# ---- Self-assessment of the fit -------------------------------------------------------------------------------------


def certainty_table(fit: VehicleFit) -> ResultTable:
    """Return the uncertainty of each output as the fit estimates it; no rows if the fit does not contain it."""
    columns = (
        "output", "response, one sigma, % .2", "RMS of setups, one sigma, % .2",
        "misfit, standard deviations of the estimate .2", "unexplained, % of that without friction .2",
    )  # fmt: skip
    rows = (
        (name, 100.0 * one.response, 100.0 * one.measure, one.misfit,
         None if one.with_friction is None else 100.0 * one.with_friction)
        for name, one in ({} if fit.trust is None else fit.trust.outputs).items()
    )  # fmt: skip
    return ResultTable.of("Uncertainty of the outputs, from the fit", columns, rows)


def measure_table(fit: VehicleFit) -> ResultTable:
    """Return 95 % intervals of predicted RMS values of setups; no rows if the fit does not contain them."""
    columns = (
        "measure", "error that all setups share, +- % .2", "error between two setups 10 % apart, +- % .2",
    )  # fmt: skip
    rows = (
        (name, 100.0 * one.half_width(0.0), 100.0 * MeasureUncertainty(0.0, one.own).half_width(TENTH))
        for name, one in ({} if fit.trust is None else fit.trust.measures).items()
    )
    return ResultTable.of("Accuracy of predicted RMS values of setups that were not tested, 95 %", columns, rows)


def port_table(fit: VehicleFit) -> ResultTable:
    """Return the friction and the spring nonlinearity that were estimated at the ports."""
    columns = ("port", "friction, estimate [N]", "one sigma [N] .2", "friction, in the model [N]",
               "transition velocity [m/s] .2", "bristle, reach [m] .2",
               "spring, square of travel [N] .2", "one sigma [N] .2")  # fmt: skip
    rows = []
    friction, springs = ({}, {}) if fit.trust is None else (fit.trust.friction, fit.trust.springs)
    for port, force in friction.items():
        law, spring = fit.vehicle.friction.get(port), springs.get(port)
        creeps, sticks = law is not None and law.force > 0.0, law is not None and law.bristle.force > 0.0
        velocity, reach = (
            (law.velocity if creeps else None, law.bristle.reach if sticks else None) if law else (None, None)
        )
        taken = ("none" if law is None else law.sliding_force, velocity, reach)
        bent = (None, None) if spring is None else (spring.value, spring.deviation)
        rows.append((port or "port", force.value, force.deviation, *taken, *bent))
    return ResultTable.of("Estimates at the ports", columns, rows)


# ---- Comparison with the records ------------------------------------------------------------------------------------


def terminal_tables(study: VehicleValidation) -> tuple[ResultTable, ...]:
    """Return the tables for a terminal; some may be empty."""
    return overview(study), _trend_table(study), friction_table(study), _mode_table(study)


def overview(study: VehicleValidation) -> ResultTable:
    """Return a row for each record with its worst outputs."""
    columns = ("record", "number", "kind", "RMS, %", "output", "error, %", "output")
    rows = (
        (case.record.name + _remark(case), str(number), case.record.kind, *_worst(case.judged, "level"),
         *_worst(case.judged, "error"))
        for number, case in enumerate(study.cases, start=1)
    )  # fmt: skip
    forces = " and ".join(dict.fromkeys(case.shocks for case in study.cases))
    return ResultTable.of(f"The worst outputs of each record, from {forces}", columns, rows)


def _remark(case: VehicleCase) -> str:
    held = (
        ("used by the fit", case.is_fit_record),
        ("gentle", case.is_gentle),
        ("beyond the fit", bool(case.extrapolations)),
    )
    remarks = [text for text, holds in held if holds]
    return f" ({', '.join(remarks)})" if remarks else ""


def _worst(outputs: Iterable[Comparison], figure: str) -> tuple[Amount | None, str]:
    worst = max(outputs, key=lambda one: abs(getattr(one, figure)), default=None)
    return (None, NONE) if worst is None else (_percent(getattr(worst, figure)), worst.name)


def _outputs_table(case: VehicleCase) -> ResultTable:
    """Return the outputs of a record: RMS, level, error, correlation, and the error without friction."""
    columns = ["output", "unit", "RMS measured", "predicted", "RMS, %", "error, %", "correlation"]
    smooth = {one.name: one for one in case.without_friction or ()}
    columns += ["without friction: RMS, %", "error, %"] if smooth else []
    rows: list[tuple[Cell, ...]] = [
        (one.name + ("" if one.is_judged else " (not judged)"), one.unit, *(Amount(rms, one.unit) for rms in one.rms),
         _percent(one.level), _percent(one.error), f"{one.correlation:.4f}",
         *((_percent(smooth[one.name].level), _percent(smooth[one.name].error)) if smooth else ()))
        for one in case.outputs
    ]  # fmt: skip
    return ResultTable.of(case.record.name, columns, rows)


def sine_table(study: VehicleValidation) -> ResultTable:
    """Return gain and phase of the sine records (Fig 6.30), slowest first."""
    columns = ("record", "frequency, Hz", "output", "unit", "amplitude", "predicted", "gain, %", "phase, degrees .2",
               "not sinusoidal, %")  # fmt: skip
    rows: list[tuple[Cell | float, ...]] = [
        (case.record.name, case.record.frequency or 0.0, one.name, one.unit,
         *(Amount(size, one.unit) for size in one.amplitude), _percent(one.gain - 1.0), float(np.degrees(one.phase)),
         _percent(one.harmonics))
        for case in sorted(study.of_kind("sine"), key=lambda case: case.record.frequency or 0.0)
        for one in case.sines
    ]  # fmt: skip
    return ResultTable.of("Sine records", columns, rows)


def static_table(study: VehicleValidation) -> ResultTable:
    """Return the slopes of static records (Fig 6.32)."""
    columns = ("record", "output", "per load, SI", "predicted", "error of predicted, %")
    rows = (
        (case.record.name, one.name, measured, predicted, _percent(predicted / measured - 1.0) if measured else None)
        for case in study.of_kind("static")
        for one in case.holds
        for measured, predicted in [one.slopes]
    )
    return ResultTable.of("Static records", columns, rows)


def _trend_table(study: VehicleValidation) -> ResultTable:
    """Return trends and correlation over the random records (Figs 6.27, 6.28)."""
    columns = ("output", "records", "spread measured, %", "rank correlation", "correlation", "level, %",
               "error without the common level, %")  # fmt: skip
    rows = (
        (trend.name, str(len(trend.measured)), _percent(trend.spread),
         "flat" if trend.is_flat else f"{trend.rank:.3f}", "flat" if trend.is_flat else f"{trend.correlation:.4f}",
         _percent(trend.bias), _percent(trend.remaining_error))
        for trend in study.trends
    )  # fmt: skip
    return ResultTable.of("Trends of RMS over the random records", columns, rows)


def _path_table(study: VehicleValidation) -> ResultTable:
    """Return the differences between the model's main responses and the estimate that it was fitted to."""
    columns = ("output", "input", "misfit, %", "in the 95 % band, %", "lowest coherence", "median coherence")
    rows = []
    for path in study.paths:
        inside, lowest, median = None if path.inside is None else _percent(path.inside), NONE, NONE
        if path.coherence is not None:
            lowest, median = f"{path.coherence.min():.3f}", f"{float(np.median(path.coherence)):.4f}"
        rows.append((path.output, path.input, _percent(path.misfit), inside, lowest, median))
    return ResultTable.of("Main responses", columns, rows)


def _mode_table(study: VehicleValidation) -> ResultTable:
    """Return the modes around the baseline damping, with those of another car if one was given."""
    columns, rows = ["frequency, Hz .4", "damping, %"], []
    if study.compared_with:
        columns += [f"{study.compared_with}: frequency, Hz .4", "damping, %", "MAC"]
    for mode in study.modes:
        other: tuple[float | str | None, ...] = ()
        if study.compared_with:
            other = (None,) * 3 if mode.match is None else (mode.match[0], 100.0 * mode.match[1], f"{mode.mac:.4f}")
        rows.append((mode.frequency, 100.0 * mode.damping, *other))
    return ResultTable.of("Modes", columns, rows)


def friction_table(study: VehicleValidation) -> ResultTable:
    """Return the mean errors of the judged outputs with and without the friction at the ports."""
    columns = ("record", "error with, %", "without, %", "RMS error with, %", "without, %")
    rows: list[tuple[Cell, ...]] = []
    for case in study.cases:
        names = {one.name for one in case.judged}
        if smooth := [one for one in case.without_friction or () if one.name in names]:
            means = (
                _percent(float(np.mean([abs(getattr(one, figure)) for one in some])))
                for figure in ("error", "level")
                for some in (case.judged, smooth)
            )
            rows.append((case.record.name, *means))
    return ResultTable.of("Friction at the ports, with and without", columns, rows)


def _percent(value: float) -> Amount:
    return Amount(100.0 * value, "%", 3 if abs(value) >= 0.01 else 2)


# ==== Page ============================================================================================================

# ---- Sections -------------------------------------------------------------------------------------------------------


_JUDGED = "They apply to shock velocities, tire forces, their sum and ride heights, if they move."
_TRENDS = (
    "A setup study needs the order of setups and their differences more than their levels. A level error that is the "
    "same for all records leaves the rank correlation at 1. The error without the common level is the largest error of "
    "a record's RMS relative to the mean of all records. Records with different drives also differ by their roads."
)
_MODES = "Oscillating modes around the baseline damping. The MAC is computed over the outputs that both cars have."
_MEASURES = (
    "Part of the error of a predicted RMS value is the same for all setups on a drive and does not affect which one is "
    "better. The error between two setups grows with their difference; the table gives it for predictions that differ "
    "by 10 %, RMS over all measures. Both come from free-running simulations of the identification tests."
)
_VEHICLE = Markup(
    "<p>The vehicle <strong>{}</strong>: recipe {}, {} states, fitted from {:.3g} to {:.3g} Hz. Measurement and "
    "prediction pass the same zero-phase low-pass at {:.3g} Hz. The first {:.3g} s (at most a quarter) of each record "
    "and the means are omitted. “Error” is the RMS of measured minus predicted, over the measured RMS.</p>"
)


def write_vehicle_page(
    path: str | Path, study: VehicleValidation, *, limits: Limits | None = None, title: str = "Vehicle validation"
) -> Path:
    """Write a vehicle's validation as an interactive page; an existing file is replaced only when it is complete.

    Returns:
        Path of the file.
    """
    limits = limits or Limits()
    sections = [*_vehicle_sections(study, limits), _vehicle_notes(study), _vehicle_origins(study)]
    return write_page(
        path, document(title, vehicle_verdict(study, limits), sections, lead=f"{limits.summary()} {_JUDGED}")
    )


def _vehicle_sections(study: VehicleValidation, limits: Limits) -> Iterator[Section]:
    fit = study.fit
    levels = [_level_figure(study, limits)] if any(case.judged for case in study.cases) else []
    yield Section("records", "Records", [overview(study), *levels])
    if study.trends:
        drawn = [_trend_figure(study.trends), _correlation_figure(study.trends)]
        yield Section("trends", "Setups: trends and levels", [_TRENDS, _trend_table(study)])
        yield Section("equality", "Setups: predicted and measured", drawn, folded=True)
    yield from _kinds(study)
    friction = friction_table(study)
    if friction.rows:
        forces = ", ".join(f"{port} {law.sliding_force:.1f} N".strip() for port, law in fit.vehicle.friction.items())
        text = f"The identification found friction at the ports: {forces}. Errors of the model with and without it:"
        yield Section("friction", "Friction", [text, friction, port_table(fit)])
    if static := study.of_kind("static"):
        drawn = [_static_figure(case) for case in static if case.holds]
        yield Section("static", "Static records", [_static(study), static_table(study), *drawn], folded=True)
    yield Section("responses", "Responses", [_path_table(study), *_response_figures(study.paths)], folded=True)
    yield Section("modes", "Modes", [_MODES, _mode_table(study)], folded=True)
    if trust := fit.trust:
        blocks: list[Block] = [" ".join(trust.flags.values())] if trust.flags else []
        if trust.outputs:
            blocks += [] if blocks else ["The fit found no nonlinear effect in the car."]
            blocks += [certainty_table(fit)]
        blocks += [_MEASURES, measure_table(fit)] if trust.measures else []
        blocks += [port_table(fit)] if trust.friction and not friction.rows else []
        blocks += [] if trust.orders is None else [_order_figure(trust.orders)]
        yield Section("fit", "Self-assessment of the fit", blocks, folded=True)


def _kinds(study: VehicleValidation) -> Iterator[Section]:
    """Yield the sections of random, sine and bump records: figures of the worst record; folded, the tables of all."""
    headings = {"random": "Random and track records", "sine": "Sine records", "bump": "Bump records"}
    for kind, heading in headings.items():
        cases = study.of_kind(kind)
        worst = sorted(cases, key=lambda case: -max((one.error for one in case.judged), default=0.0))[:1]
        blocks: list[Block] = [_sine_figure(cases)] if kind == "sine" and cases else []
        blocks += [_time_figure(case) for case in worst]
        more = ["Plotted: the record with the largest error."] if len(cases) > 1 else []
        details: list[Block] = [_spectrum_figure(case) for case in worst if case.spectra]
        details += [sine_table(study)] if kind == "sine" else [_outputs_table(case) for case in cases]
        if cases:
            yield Section(kind, heading, [*more, *blocks])
            yield Section(f"{kind}-details", f"{heading}: every output", details, folded=True)


def _static(study: VehicleValidation) -> str:
    low = study.band[0]
    if low <= 0.0:
        return "The fit includes 0 Hz."
    return (
        f"The fit begins at {low:.3g} Hz, so the model's static gain is extrapolated. Friction also holds the car "
        "between two levels. Static records are therefore shown, but no criterion applies to them."
    )


def _vehicle_notes(study: VehicleValidation) -> Section:
    headings = [Markup("<h3>{}</h3>").format(f"About the {what}") for what in ("records", "fit")]
    return Section("notes", "Notes", [headings[0], study.notes, headings[1], tuple(study.fit.notes)], folded=True)


def _vehicle_origins(study: VehicleValidation) -> Section:
    fit, judging = study.fit, study.judging
    text = _VEHICLE.format(fit.vehicle.name, fit.recipe, fit.states, *study.band, judging.band, judging.settling)

    columns = ("record", "kind", "reason", "shocks, as named in the file", "SHA-256")
    records = (
        (one.name, one.kind, one.reason, ", ".join(one.conditions.shocks) or NONE, digest(one.digest or NONE))
        for one in (case.record for case in study.cases)
    )
    sources: list[tuple[str, str]] = [(name, digest(one)) for name, one in fit.sources.items()]
    fitted = ResultTable.of("", ("fitted to", "SHA-256"), sources or [(NONE, NONE)])
    return Section("what", "What was validated", [text, ResultTable.of("", columns, records), fitted], folded=True)


# ---- Levels ---------------------------------------------------------------------------------------------------------

_COLUMNS = 3

#: Gap between the columns of a figure [1].
_GAP = 0.08

#: Number of outputs of a static record that are plotted, counted from the last: tire forces and ride heights.
_STATIC = 6


def _trend_figure(trends: Sequence[Trend]) -> Figure:
    """Return a plot of the measured and predicted RMS of each record, with a panel for each output (Fig 6.27)."""
    ranks = ("–, flat" if trend.is_flat else f"{trend.rank:.2f}" for trend in trends)
    panels = [
        (Axis("record"), Axis("RMS", t.unit), f"{t.name}: rank {rank}") for t, rank in zip(trends, ranks, strict=True)
    ]
    caption = "RMS of each random record, in the order of the table of records, as in Fig 6.27."
    figure = row_figure(caption, 205, panels, _COLUMNS, gap=_GAP)
    number = np.arange(1.0, len(trends[0].measured) + 1.0)
    for k, one in enumerate(trends):
        figure.line(k, number, one.measured, name="measured", color=MEASURED)
        figure.marks(k, number, one.predicted, name="predicted", color=COLORS[0])
    return figure


def _correlation_figure(trends: Sequence[Trend]) -> Figure:
    """Return a plot of predicted over measured RMS with the line of equality, a panel for each output (Fig 6.28)."""
    panels = [
        (Axis("measured RMS", one.unit), Axis("predicted", one.unit), f"{one.name}: level {100 * one.bias:+.2g} %")
        for one in trends
    ]
    caption = "Predicted over measured RMS of the random records, as in Fig 6.28; the line is equality."
    figure = row_figure(caption, 205, panels, _COLUMNS, gap=_GAP)
    for k, one in enumerate(trends):
        both = np.concatenate((one.measured, one.predicted))
        ends = np.array([both.min(), both.max()])
        figure.line(k, ends, ends, name="equality", color=MEASURED, dash="dot")
        figure.dots(k, one.measured, one.predicted, name="records", color=COLORS[0], size=8)
    return figure


def _sine_figure(cases: Sequence[VehicleCase]) -> Figure:
    """Return a plot of gain and phase of the predicted fundamental, a line for each quantity's worst output."""
    rows = [(case.record.frequency or 0.0, case.sines) for case in cases if case.sines]
    rows.sort(key=lambda row: row[0])
    titles = ("predicted / measured amplitude", "phase lead of predicted [degrees]", "measured: not sinusoidal [%]")
    panels = [(Axis("frequency [Hz]", kind="log"), Axis(""), title) for title in titles]
    caption = "Sine records: for each quantity the output with the worst gain at each frequency."
    figure = grid_figure(caption, 330, panels, 3, gap=(_GAP, 0.0))
    figure.level(0, 1.0)
    figure.level(1, 0.0)
    names = sorted({quantity(one.name) for _, sines in rows for one in sines})
    for name, color in zip(names, COLORS * len(names), strict=False):
        found = [(frequency, worst) for frequency, sines in rows if (worst := _worst_sine(sines, name))]
        frequency = np.array([f for f, _ in found])
        figure.marks(0, frequency, np.array([one.gain for _, one in found]), name=name, color=color)
        figure.marks(1, frequency, np.degrees([one.phase for _, one in found]), name=name, color=color)
        figure.marks(2, frequency, np.array([100.0 * one.harmonics for _, one in found]), name=name, color=color)
    return figure


def _worst_sine(sines: Sequence[SineOutput], name: str) -> SineOutput | None:
    found = [one for one in sines if quantity(one.name) == name]
    return max(found, key=lambda one: abs(one.gain - 1.0), default=None)


def _static_figure(case: VehicleCase) -> Figure:
    """Return a plot of tire forces and ride heights during the holds of a static record."""
    shown = case.holds[-_STATIC:]
    text = "levels minus their means, as in Fig 6.32. Friction causes loops in the measured ones."
    panels = [(Axis("load", "N"), Axis("change", one.unit), one.name) for one in shown]
    figure = row_figure(f"{case.record.name}: {text}", 205, panels, _COLUMNS, gap=_GAP)
    for k, one in enumerate(shown):
        figure.marks(k, one.load, one.measured, name="measured", color=MEASURED)
        figure.marks(k, one.load, one.predicted, name="predicted", color=COLORS[0])
    return figure


def _level_figure(study: VehicleValidation, limits: Limits) -> Figure:
    """Return an overview plot of RMS errors and errors, with a point for each output of each record."""
    titles = ("RMS predicted minus measured [%]", "error [% of measured RMS]")
    caption = "All judged outputs, records numbered as in the table. Dotted: limits; that of RMS is for random records."
    figure = grid_figure(caption, 330, [(Axis("record"), Axis(""), title) for title in titles], 2, gap=(_GAP, 0.0))
    for panel, value in ((0, limits.level), (0, -limits.level), (1, limits.error)):
        figure.level(panel, 100.0 * value)
    found = [
        (number, one) for number, case in enumerate(study.cases, start=1) if not case.is_gentle for one in case.judged
    ]
    names = sorted({quantity(one.name) for _, one in found})
    for name, color in zip(names, COLORS * len(names), strict=False):
        points = [(k, 100.0 * one.level, 100.0 * one.error) for k, one in found if quantity(one.name) == name]
        number, level, error = np.array(points).T
        figure.dots(0, number, level, name=name, color=color, size=7)
        figure.dots(1, number, error, name=name, color=color, size=7)
    return figure


# ---- Stabilisation diagram of the fit -------------------------------------------------------------------------------


def _order_figure(orders: Orders) -> Figure:
    """Return a plot of the poles of models of increasing order, and of the gaps of the singular values."""
    states = Axis("states", span=(0.0, orders.tried[-1].states + 2.0))
    panels = (
        Panel(Axis("frequency [Hz]", span=(0.0, 1.2 * orders.high)), states, (0.0, 0.76), (0.0, 1.0), "poles"),
        Panel(Axis("singular value / next one", kind="log"), states, (0.82, 1.0), (0.0, 1.0), "gaps"),
    )
    why = "a clear gap of the singular values" if orders.is_clear else "their misfit, as no clear gap explains it"
    text = f"poles of models of increasing order. {orders.chosen} states were chosen by {why}."
    figure = Figure(f"Stabilisation diagram: {text}", 380, panels)
    for steady, name, color in ((False, "moved", MEASURED), (True, "same as at the previous order", COLORS[0])):
        there = [(p.frequency, one.states) for one in orders.tried for p in one.poles if p.steady is steady]
        kept = np.array([pair for pair in there if pair[0] <= 1.2 * orders.high]).reshape(-1, 2)
        figure.dots(0, kept[:, 0], kept[:, 1], name=name, color=color, size=6.0)
    gaps = np.array([one.gap for one in orders.tried])
    figure.marks(1, gaps, np.array([float(one.states) for one in orders.tried]), name="gap", color=COLORS[2])
    for panel in (0, 1):
        figure.level(panel, float(orders.chosen))
    return figure


# ---- Responses with coherence and confidence interval, and error spectra --------------------------------------------

#: Number of outputs per figure; points per line; lowest density that is plotted, below the largest [dB].
_OUTPUTS, _POINTS, _DEEP = 4, 400, 80.0

#: Coherence that is not drawn if it is above this at all frequencies.
_FLAT = 0.9

_LOG = Axis("frequency [Hz]", kind="log")


def _response_figures(paths: Sequence[Response]) -> Iterator[Figure]:
    """Yield plots of the responses of every judged output to its strongest road and shock force, with coherence."""
    rows = [tuple(found) for _, found in groupby(paths, key=lambda path: path.output)]
    for start in range(0, len(rows), _OUTPUTS):
        yield _responses(rows[start : start + _OUTPUTS])


def _responses(rows: Sequence[Sequence[Response]]) -> Figure:
    panels, columns = [], 3 if any(_is_notable(paths[0].coherence) for paths in rows) else 2
    for paths in rows:
        x = _LOG if paths is rows[-1] else Axis("", kind="log")
        panels += [
            (x, Axis(f"dB re 1 {path.unit}"), f"{path.output} from {path.input}") for path in (paths[0], paths[:2][-1])
        ]
        if columns == 3:
            panels.append((x, Axis("", span=(0.0, 1.05)), f"{paths[0].output}: multiple coherence"))
    caption = (
        "Responses of the model and of the estimate that it was fitted to, with the estimate's 95 % band. Coherence "
        "near 1 does not exclude friction."
    )
    figure = row_figure(caption, 170, panels, columns, gap=_GAP)
    for k, paths in enumerate(rows):
        for i, path in enumerate(paths[:2]):
            _response(figure, columns * k + i, path)
        if columns == 3 and paths[0].coherence is not None:
            kept = _kept(paths[0].frequency)
            frequency, coherence = paths[0].frequency[kept], paths[0].coherence[kept]
            figure.line(3 * k + 2, frequency, coherence, name="coherence", color=COLORS[2])
    return figure


def _is_notable(coherence: Array | None) -> bool:
    """Return whether a coherence is drawn: the table has its lowest value, and a flat line at 1 says no more."""
    return coherence is not None and bool(coherence.min() < _FLAT)


def _response(figure: Figure, panel: int, path: Response) -> None:
    kept = _kept(path.frequency)
    frequency = path.frequency[kept]
    figure.line(panel, frequency, _db(path.estimate)[kept], name="estimate", color=MEASURED)
    if path.band is not None:
        floor = 0.05 * np.abs(path.estimate)  # zero would be minus infinity in dB
        for end in path.band:
            values = _db(np.maximum(end, floor))[kept]
            figure.line(panel, frequency, values, name="95 % band", color=COLORS[4], dash="dot")
    figure.line(panel, frequency, _db(path.model)[kept], name="model", color=COLORS[0])


def _spectrum_figure(case: VehicleCase) -> Figure:
    """Return a plot of the spectra of a record's outputs and errors, and of the coherence of error and prediction."""
    errors = {one.name: one.error for one in case.judged}
    names = sorted(case.spectra, key=lambda name: -errors[name])[:3]
    panels = [(_LOG, Axis("dB re largest"), name) for name in names]
    panels += [(_LOG, Axis("coherence", span=(0.0, 1.05)), "")] * len(names)
    caption = (
        f"{case.record.name}: the three outputs with the largest errors. Above: spectra of output and error; below: "
        "coherence of error and prediction, near 1 if another gain or phase would have predicted the error."
    )
    figure = grid_figure(caption, 480, panels, len(names), gap=(_GAP, 0.2))
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
    spaced = np.geomspace(frequency[0] or frequency[1], frequency[-1], _POINTS)
    return np.unique(np.clip(np.searchsorted(frequency, spaced), 0, frequency.size - 1))


def _db(values: Complex | Array) -> Array:
    return np.asarray(20.0 * np.log10(np.maximum(np.abs(values), 1e-300)))


# ---- Measured and predicted outputs over time (Figs 6.26, 6.29, 6.31) -----------------------------------------------

#: Length of the plotted part of a record [s], for a sine in periods; time before a bump [s]; points per line.
_SPAN, _PERIODS, _BEFORE, _SAMPLES = {"random": 4.0, "bump": 1.5}, 3.0, 0.2, 700

#: Quantities that are plotted, with the worst predicted output of each (6.5 shows four signals).
_DRAWN = ("velocity", "tire_force", "total_tire_force", "ride_height", "hub_acceleration", "chassis_acceleration")


def _time_figure(case: VehicleCase) -> Figure:
    """Return a plot of part of a record: for each quantity the output with the worst prediction."""
    shown = list(_shown(case))
    kept = _piece(case, shown[0])
    panels = []
    for k, one in enumerate(shown):
        x, y = "time [s]" if k >= len(shown) - 2 else "", quantity(one.name).replace("_", " ")
        panels.append((Axis(x), Axis(y, one.unit), f"{one.name}: error {100 * one.error:.2g} %"))
    caption = f"{case.record.name}: for each quantity the output with the worst prediction. Ports: {case.shocks}."
    figure = row_figure(caption, 170, panels, 2, gap=_GAP)
    smooth = {one.name: one for one in case.without_friction or ()}
    for k, one in enumerate(shown):
        time = case.time[kept]
        figure.line(k, time, one.measured[kept], name="measured", color=MEASURED)
        if one.name in smooth:
            figure.line(k, time, smooth[one.name].predicted[kept], name="without friction", color=COLORS[1], dash="dot")
        figure.line(k, time, one.predicted[kept], name="predicted", color=COLORS[0])
    return figure


def _shown(case: VehicleCase) -> Iterator[Comparison]:
    for shown in _DRAWN:
        outputs = [one for one in case.outputs if quantity(one.name) == shown]
        moving = [one for one in outputs if one.is_judged] or outputs
        if moving:
            yield max(moving, key=lambda one: one.error)


def _piece(case: VehicleCase, one: Comparison) -> NDArray[np.intp]:
    """Return the indices of the plotted samples: around the largest value, or for a bump from just before it."""
    rate, record = case.record.series.sample_rate, case.record
    span = _PERIODS / record.frequency if record.frequency else _SPAN.get(record.kind, _SPAN["random"])
    top = int(np.argmax(np.abs(one.measured)))
    before = round((_BEFORE if record.kind == "bump" else 0.5 * span) * rate)
    count = min(round(span * rate), one.measured.size)
    first = min(max(top - before, 0), one.measured.size - count)
    return np.unique(np.linspace(first, first + count - 1, min(_SAMPLES, count)).astype(np.intp))
