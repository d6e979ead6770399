"""Tables of a vehicle's validation."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

import numpy as np

from eightpost.ident.validation.tables import NONE, Amount, Cell, ResultTable

if TYPE_CHECKING:
    from eightpost.ident.vehicle import VehicleFit
    from eightpost.ident.vehicle_validation.comparison import Comparison
    from eightpost.ident.vehicle_validation.study import Case, VehicleValidation


# ---- Tables of a fit's self-assessment, for the command line and the report -----------------------------------------


def certainty_table(fit: VehicleFit) -> ResultTable:
    """Return the uncertainty of each output as the fit estimates it; no rows if the fit does not contain it."""
    heads = (
        ("output", ""), ("response, one sigma, %", ""), ("RMS of setups, one sigma, %", ""),
        ("misfit, standard deviations of the estimate", ""), ("unexplained, % of that without friction", ""),
    )  # fmt: skip
    outputs = {} if fit.trust is None else fit.trust.outputs
    rows: list[tuple[Cell, ...]] = []
    for name, one in outputs.items():
        left = NONE if one.with_friction is None else _percent(one.with_friction)
        rows.append((name, _percent(one.response), _percent(one.measure), Amount(one.misfit, "1", 2), left))
    return ResultTable("Uncertainty of the outputs, from the fit", heads, tuple(rows))


def port_table(fit: VehicleFit) -> ResultTable:
    """Return the friction and the spring nonlinearity that were estimated at the ports."""
    heads = (
        ("port", ""), ("friction, estimate", "N"), ("one sigma", "N"), ("friction, in the model", "N"),
        ("transition velocity", "m/s"), ("spring, square of travel", "N"), ("one sigma", "N"),
    )  # fmt: skip
    rows: list[tuple[Cell, ...]] = []
    friction, springs = ({}, {}) if fit.trust is None else (fit.trust.friction, fit.trust.springs)
    for port, force in friction.items():
        law, spring = fit.vehicle.friction.get(port), springs.get(port)
        taken = ("none", NONE) if law is None else (Amount(law.force, "N"), Amount(law.velocity, "m/s", 2))
        bent = (NONE, NONE) if spring is None else (Amount(spring.value, "N", 2), Amount(spring.deviation, "N", 2))
        rows.append((port or "port", Amount(force.value, "N"), Amount(force.deviation, "N", 2), *taken, *bent))
    return ResultTable("Estimates at the ports", heads, tuple(rows))


def _percent(value: float) -> Amount:
    return Amount(100.0 * value, "%", 2)


# ---- Tables of a vehicle's validation, for the command line and the report ------------------------------------------


def overview(study: VehicleValidation) -> ResultTable:
    """Return a row for each record with its worst outputs."""
    heads = (
        ("record", ""), ("number", ""), ("kind", ""), ("shocks", ""), ("worst RMS, %", ""), ("output", ""),
        ("worst error, %", ""), ("output", ""), ("beyond the fit", ""),
    )  # fmt: skip
    rows = tuple(
        (
            case.record.name + _remark(case),
            str(number),
            case.record.kind,
            case.shocks,
            *_worst(case.judged, "level"),
            *_worst(case.judged, "error"),
            "yes" if case.extrapolations else "no",
        )
        for number, case in enumerate(study.cases, start=1)
    )
    return ResultTable("Each record and its worst outputs", heads, rows)


def _remark(case: Case) -> str:
    remarks = [text for text, holds in (("used by the fit", case.is_fit_record), ("gentle", case.is_gentle)) if holds]
    return f" ({', '.join(remarks)})" if remarks else ""


def _worst(outputs: Iterable[Comparison], figure: str) -> tuple[Cell, Cell]:
    worst = max(outputs, key=lambda one: abs(getattr(one, figure)), default=None)
    return (NONE, NONE) if worst is None else (_tables_percent(getattr(worst, figure)), worst.name)


def outputs_table(case: Case) -> ResultTable:
    """Return the outputs of a record: RMS, level, error, correlation, and the error without friction."""
    heads = [("output", ""), ("unit", ""), ("RMS measured", ""), ("predicted", ""), ("RMS, %", ""), ("error, %", ""),
             ("correlation", "")]  # fmt: skip
    smooth = {one.name: one for one in case.without_friction or ()}
    if smooth:
        heads += [("without friction: RMS, %", ""), ("error, %", "")]
    rows = []
    for one in case.outputs:
        cells: list[Cell] = [one.name + ("" if one.is_judged else " (not judged)"), one.unit]
        cells += [Amount(one.rms[0], one.unit), Amount(one.rms[1], one.unit)]
        cells += [_tables_percent(one.level), _tables_percent(one.error), f"{one.correlation:.4f}"]
        if smooth:
            cells += [_tables_percent(smooth[one.name].level), _tables_percent(smooth[one.name].error)]
        rows.append(tuple(cells))
    return ResultTable(case.record.name, tuple(heads), tuple(rows))


def sine_table(study: VehicleValidation) -> ResultTable:
    """Return gain and phase of the sine records (Fig 6.30), slowest first."""
    heads = (
        ("record", ""), ("frequency, Hz", ""), ("output", ""), ("unit", ""), ("amplitude", ""), ("predicted", ""),
        ("gain, %", ""), ("phase, degrees", ""), ("not sinusoidal, %", ""),
    )  # fmt: skip
    rows = [
        (
            case.record.name,
            Amount(case.record.frequency or 0.0, "1", 3),
            one.name,
            one.unit,
            Amount(one.amplitude[0], one.unit),
            Amount(one.amplitude[1], one.unit),
            _tables_percent(one.gain - 1.0),
            Amount(float(np.degrees(one.phase)), "1", 2),
            _tables_percent(one.harmonics),
        )
        for case in sorted(study.of_kind("sine"), key=lambda case: case.record.frequency or 0.0)
        for one in case.sines
    ]
    return ResultTable("Sine records", heads, tuple(rows))


def static_table(study: VehicleValidation) -> ResultTable:
    """Return the slopes of static records (Fig 6.32)."""
    heads = (
        ("record", ""),
        ("output", ""),
        ("per load, SI", ""),
        ("predicted", ""),
        ("error of predicted, %", ""),
    )
    rows: list[tuple[Cell, ...]] = []
    for case in study.of_kind("static"):
        for one in case.holds:
            measured, predicted = one.slopes
            off = _tables_percent(predicted / measured - 1.0) if measured else NONE
            rows.append((case.record.name, one.name, Amount(measured, "1"), Amount(predicted, "1"), off))
    return ResultTable("Static records", heads, tuple(rows))


def trend_table(study: VehicleValidation) -> ResultTable:
    """Return trends and correlation over the random records (Figs 6.27, 6.28)."""
    heads = (
        ("output", ""), ("records", ""), ("spread measured, %", ""), ("rank correlation", ""), ("correlation", ""),
        ("level, %", ""), ("error without the common level, %", ""),
    )  # fmt: skip
    rows = tuple(
        (
            trend.name,
            str(len(trend.measured)),
            _tables_percent(trend.spread),
            "flat" if trend.is_flat else f"{trend.rank:.3f}",
            "flat" if trend.is_flat else f"{trend.correlation:.4f}",
            _tables_percent(trend.bias),
            _tables_percent(trend.remaining_error),
        )
        for trend in study.trends
    )
    return ResultTable("Trends of RMS over the random records", heads, rows)


def path_table(study: VehicleValidation) -> ResultTable:
    """Return the differences between the model's main responses and the estimate that it was fitted to."""
    heads = (
        ("output", ""), ("input", ""), ("misfit, %", ""), ("in the 95 % band, %", ""), ("lowest coherence", ""),
        ("median coherence", ""),
    )  # fmt: skip
    rows: list[tuple[Cell, ...]] = []
    for path in study.paths:
        inside = NONE if path.inside is None else _tables_percent(path.inside)
        lowest, median = (
            (NONE, NONE)
            if path.coherence is None
            else (f"{path.coherence.min():.3f}", f"{float(np.median(path.coherence)):.4f}")
        )
        rows.append((path.output, path.input, _tables_percent(path.misfit), inside, lowest, median))
    return ResultTable("Main responses", heads, tuple(rows))


def mode_table(study: VehicleValidation) -> ResultTable:
    """Return the modes around the baseline damping, with those of another car if one was given."""
    heads = [("frequency, Hz", ""), ("damping, %", "")]
    if study.compared_with:
        heads += [(f"{study.compared_with}: frequency, Hz", ""), ("damping, %", ""), ("MAC", "")]
    rows = []
    for mode in study.modes:
        cells: list[Cell] = [Amount(mode.frequency, "1", 4), Amount(100.0 * mode.damping, "%", 3)]
        if study.compared_with:
            cells += [NONE] * 3 if mode.match is None else [
                Amount(mode.match[0], "1", 4), Amount(100.0 * mode.match[1], "%", 3), f"{mode.mac:.4f}"]  # fmt: skip
        rows.append(tuple(cells))
    return ResultTable("Modes", tuple(heads), tuple(rows))


def friction_table(study: VehicleValidation) -> ResultTable:
    """Return the mean errors of the judged outputs with and without the friction at the ports."""
    heads = (
        ("record", ""), ("error with, %", ""), ("without, %", ""), ("RMS error with, %", ""), ("without, %", ""),
    )  # fmt: skip
    rows = []
    for case in study.cases:
        if case.without_friction is None:
            continue
        names = {one.name for one in case.judged}
        smooth = [one for one in case.without_friction if one.name in names]
        if smooth:
            rows.append(
                (case.record.name, *_means(case.judged, smooth, "error"), *_means(case.judged, smooth, "level"))
            )
    return ResultTable("Friction at the ports, with and without", heads, tuple(rows))


def _means(found: Iterable[Comparison], smooth: Iterable[Comparison], figure: str) -> tuple[Cell, Cell]:
    first, second = (float(np.mean([abs(getattr(one, figure)) for one in some])) for some in (found, smooth))
    return _tables_percent(first), _tables_percent(second)


def _tables_percent(value: float) -> Amount:
    return Amount(100.0 * value, "%", 3 if abs(value) >= 0.01 else 2)
