"""Tables of a vehicle's validation, for the terminal and the page."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from eightpost.ident.validation.comparison import Comparison
from eightpost.ident.validation.vehicles import VehicleCase, VehicleValidation
from eightpost.ident.vehicle.vehicle_fit import TENTH, VehicleFit
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
    return overview(study), trend_table(study), friction_table(study), mode_table(study)


def overview(study: VehicleValidation) -> ResultTable:
    """Return a row for each record with its worst outputs."""
    columns = ("record", "number", "kind", "shocks", "worst RMS, %", "output", "worst error, %", "output",
               "beyond the fit")  # fmt: skip
    rows = (
        (case.record.name + _remark(case), str(number), case.record.kind, case.shocks, *_worst(case.judged, "level"),
         *_worst(case.judged, "error"), "yes" if case.extrapolations else "no")
        for number, case in enumerate(study.cases, start=1)
    )  # fmt: skip
    return ResultTable.of("Each record and its worst outputs", columns, rows)


def _remark(case: VehicleCase) -> str:
    remarks = [text for text, holds in (("used by the fit", case.is_fit_record), ("gentle", case.is_gentle)) if holds]
    return f" ({', '.join(remarks)})" if remarks else ""


def _worst(outputs: Iterable[Comparison], figure: str) -> tuple[Amount | None, str]:
    worst = max(outputs, key=lambda one: abs(getattr(one, figure)), default=None)
    return (None, NONE) if worst is None else (_percent(getattr(worst, figure)), worst.name)


def outputs_table(case: VehicleCase) -> ResultTable:
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


def trend_table(study: VehicleValidation) -> ResultTable:
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


def path_table(study: VehicleValidation) -> ResultTable:
    """Return the differences between the model's main responses and the estimate that it was fitted to."""
    columns = ("output", "input", "misfit, %", "in the 95 % band, %", "lowest coherence", "median coherence")
    rows = []
    for path in study.paths:
        inside, lowest, median = None if path.inside is None else _percent(path.inside), NONE, NONE
        if path.coherence is not None:
            lowest, median = f"{path.coherence.min():.3f}", f"{float(np.median(path.coherence)):.4f}"
        rows.append((path.output, path.input, _percent(path.misfit), inside, lowest, median))
    return ResultTable.of("Main responses", columns, rows)


def mode_table(study: VehicleValidation) -> ResultTable:
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
