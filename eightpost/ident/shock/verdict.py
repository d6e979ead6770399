"""Parameters of a fit with their standard deviations, findings about them, and the verdict."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from eightpost.array_types import Array
from eightpost.ident.shock.closed import FadingLag
from eightpost.ident.shock.cross_validation import HeldOutErrors
from eightpost.ident.shock.force import linear_solution
from eightpost.ident.shock.problem import Solution
from eightpost.ident.shock.record import Prepared
from eightpost.ident.shock.runs import ONE_SPEED, Runs
from eightpost.ident.shock.uncertainty import quantile, standard_error
from eightpost.rig.dyno_test import DynoTest
from eightpost.rig.lag import LAG, force_lag
from eightpost.rig.plausibility import REST_SHARE
from eightpost.rig.rest_force import pulls_at_standstill
from eightpost.rig.temperature_drift import DRIFT, temperature_drift, warming_note
from eightpost.units import convert, us_customary
from eightpost.validity import Range, Validity
from eightpost.verdict import Grade, Reason, Rules, Verdict

# ---- The scalar parameters of a fit ---------------------------------------------------------------------------------

_GAS_UNITS = {"gas_preload": "N", "gas_stiffness": "N/m"}

#: A parameter within this share of a bound counts as at the bound.
_AT_BOUND = 0.01


@dataclass(frozen=True, slots=True)
class Parameter:
    """A fitted parameter.

    Attributes:
        name: Name in the shock file.
        value: Value in `unit`.
        unit: SI unit.
        error: Standard error from leaving out blocks of the record; None if the record does not determine it.
        bounds: Lower and upper bound of the fit; None if unbounded.
        reach: Half-width of the 95 % interval in standard errors.
    """

    name: str
    value: float
    unit: str
    error: float | None
    bounds: tuple[float, float] | None = None
    reach: float = 1.96

    @property
    def interval(self) -> tuple[float, float] | None:
        """The 95 % confidence interval; None if the record does not determine the parameter."""
        if self.error is None:
            return None
        return self.value - self.reach * self.error, self.value + self.reach * self.error

    @property
    def at_bound(self) -> str:
        """`lower` or `upper` when the value is within 1 % of that bound (of its error at 0), else empty."""
        if self.bounds is None:
            return ""
        for name, bound in zip(("lower", "upper"), self.bounds, strict=True):
            if np.isfinite(bound) and abs(self.value - bound) <= _AT_BOUND * max(abs(bound), self.error or 0.0):
                return name
        return ""


def parameters_of(solution: Solution) -> tuple[Parameter, ...]:
    """Return the law's own parameters, then those of the gas force that were fitted."""
    model, reach = solution.model, quantile(solution.model.runs)
    dynamics, (_, g, theta) = model.dynamics, model.split(solution.parameters)
    n, m = model.curve_count, model.linear_count
    own = zip(
        dynamics.names,
        dynamics.values(theta).tolist(),
        dynamics.units,
        _errors(dynamics.values_jacobian(theta), solution.covariance[:, m:, m:]),
        dynamics.value_bounds(),
        strict=True,
    )
    found = [Parameter(*entry, reach) for entry in own]
    gas = zip(model.gas.names, model.gas.to_values @ g, strict=True)
    errors = _errors(model.gas.to_values, solution.covariance[:, n:m, n:m])
    bounds = {"gas_stiffness": (0.0, float("inf"))}
    found += [
        Parameter(name, float(value), _GAS_UNITS[name], error, bounds.get(name), reach)
        for (name, value), error in zip(gas, errors, strict=True)
    ]
    return tuple(found)


def _errors(jacobian: Array, covariance: Array) -> list[float | None]:
    """Return the standard errors of values, given their Jacobian with respect to the covariances' parameters.

    A value that depends on an undetermined parameter (NaN) is undetermined too.
    """
    errors: list[float | None] = []
    for row in jacobian:
        used = row != 0.0
        known = covariance[..., used, :][..., used]
        error = float(standard_error(row[None, used], known)[0]) if np.isfinite(known).all() else None
        errors.append(error)
    return errors


# ---- Warnings about a fit that a user should know before using the shock --------------------------------------------

#: Share of the standard deviation from which a remaining offset or a negative gas force is reported.
_NOTABLE_OFFSET = 0.01

#: Share of the standard deviation from which the residual is reported as too large for the law.
_POOR = 0.1


def in_field_units(value: float, unit: str) -> tuple[float, str]:
    """Return an SI value in the unit used in the field: ms, lbf, lbf/in."""
    shown = "ms" if unit == "s" else us_customary(unit)
    return convert(value, unit, shown), shown


def findings(solution: Solution, parameters: Iterable[Parameter], *, recipe: str, gas: str, rms: float) -> list[str]:
    """Return a sentence for each doubt about a solution.

    Args:
        solution: Solution of a recipe.
        parameters: Scalar parameters of the solution.
        recipe: Name of the recipe.
        gas: Treatment of the gas force.
        rms: RMS of the residual [N].
    """
    # A gas stiffness at its lower bound, 0, is normal.
    own = [parameter for parameter in parameters if parameter.name != "gas_stiffness"]
    found = [] if solution.converged else [f"the fit did not converge: {solution.status}"]
    found += [_at_bound(parameter) for parameter in own if parameter.at_bound]
    found += doubts(solution, own, recipe=recipe, gas=gas)
    deviation = solution.model.runs.deviation
    if rms > _POOR * deviation:
        found.append(
            f"the residual is {100.0 * rms / deviation:.1f} % of the force's standard deviation: this law does not "
            "describe this record well"
        )
    return found


def doubts(solution: Solution, parameters: Iterable[Parameter], *, recipe: str, gas: str) -> list[str]:
    """Return a sentence for each doubt besides convergence, bounds and residual; see `findings` for the arguments."""
    notable = _NOTABLE_OFFSET * solution.model.runs.deviation
    is_pulling = any(_pulls(prepared) for prepared in solution.model.runs.prepared)
    pulling = [_pulling(p) for p in parameters if p.name == "gas_preload" and p.value < -notable and is_pulling]
    offset = _offset(solution) if gas == "subtracted" else []
    return [*_unused_fading(solution), *_stiff_with_lag(solution, recipe), *pulling, *offset]


def _pulls(prepared: Prepared) -> bool:
    """Return whether the force of a record itself, not only that of a fitted curve, is negative at standstill.

    The low-pass of the preparation rounds the curve at standstill, which is why the limit is a share of the range.
    """
    velocity, force = (prepared.record[name][prepared.inside] for name in ("velocity", "force"))
    return pulls_at_standstill(velocity, force, REST_SHARE * float(np.ptp(force)))


def _at_bound(parameter: Parameter) -> str:
    value, unit = in_field_units(parameter.value, parameter.unit)
    return f"{parameter.name} = {value:.4g} {unit} is at its {parameter.at_bound} bound"


def _unused_fading(solution: Solution) -> list[str]:
    """Return a warning if LPNL2's transition forces have no effect, or cannot be as high as LPF1 would need them."""
    model = solution.model
    if not isinstance(model.dynamics, FadingLag):
        return []
    b, _, theta = model.split(solution.parameters)
    peak = float(np.abs(model.static(b)).max())
    if float(model.dynamics.values(theta)[1]) >= peak:
        return ["alpha is 1 over the whole record: LPNL2 equals LPF1 here, and its transition forces are arbitrary"]
    if model.dynamics.bounds()[1][1] < peak:
        highest, unit = in_field_units(float(model.dynamics.bounds()[1][1]), "N")
        return [
            f"the bound of {highest:.4g} {unit} on lag_full_force is below the record's largest static force: LPNL2 "
            "cannot become LPF1 here and may be worse"
        ]
    return []


def _stiff_with_lag(solution: Solution, recipe: str) -> list[str]:
    """Return a warning if the gas stiffness was fitted without a lag that could explain part of it."""
    if not solution.model.gas.size or (recipe == "joint" and solution.model.dynamics.names):
        return []
    return ["gas_stiffness was fitted without a lag and includes part of it; a joint LPF1 fit separates the two"]


def _pulling(preload: Parameter) -> str:
    return (
        f"gas_preload is {preload.value:.4g} N, but gas pushes: either the load cell was zeroed with the gas force on "
        "it, or the record is positive in extension. Then negate force and motion (--flip force with --flip velocity "
        "or --flip displacement), otherwise compression and rebound are swapped"
    )


def _offset(solution: Solution) -> list[str]:
    """Return a warning if a force from which the gas force was subtracted still has an offset at rest."""
    runs = solution.model.runs
    columns = np.column_stack([solution.model.basis.columns[runs.inside], np.ones(int(runs.inside.sum()))])
    offset = float(linear_solution(columns, runs.measured)[-1])
    if abs(offset) <= _NOTABLE_OFFSET * runs.deviation:
        return []
    pounds, unit = in_field_units(offset, "N")
    return [
        f"an offset of {pounds:.3g} {unit} ({offset:.3g} N) remains in the force, although the gas force was declared "
        "as subtracted; the curve passes through zero and cannot represent it: fit with gas 'estimate'"
    ]


# ---- The verdict on a fitted shock ----------------------------------------------------------------------------------

ABOUT = "fit of the shock"

#: Limits of the RMS of the residual, in percent of the force's standard deviation.
GOOD_FIT, POOR_FIT = 10.0, 30.0

#: Minimum number of cycles of the motion in all records.
FEWEST_CYCLES = 16

#: Peak speed [m/s] below which a record shows only low speeds: 10 in/s.
NARROW = convert(10.0, "in/s", "m/s")

#: A lag of the force above this multiple of what a shock can have is attributed to the instrument.
LARGEST_LAG = 2.0

RULES = Rules()

NOT_CONVERGED = RULES.add("fit not converged", ABOUT, Grade.NOT_USABLE,
    condition="the search for the parameters did not end at a minimum",
    why="other starting values would give another shock",
    remedy="check the record (eightpost inspect), or fit a simpler law",
)  # fmt: skip
MISFIT = RULES.add("large misfit of the fit", ABOUT, Grade.NOT_USABLE,
    condition=f"RMS of the residual above {POOR_FIT:g} % of the force's standard deviation",
    why="a third of the force is not in the model: it would rank shocks by chance",
    remedy="check the record (eightpost inspect), or fit another law",
)  # fmt: skip
DOUBTFUL_FIT = RULES.add("notable misfit of the fit", ABOUT, Grade.LIMITED,
    condition=f"RMS of the residual above {GOOD_FIT:g} %",
    why="a law that suits its record has a residual of a few percent (docs/evidence/measured_shocks.md)",
    remedy="compare the laws on this record, and check the record (eightpost inspect)",
)  # fmt: skip
GOOD = RULES.add("small misfit of the fit", ABOUT, Grade.USABLE,
    condition=f"RMS of the residual at most {GOOD_FIT:g} %",
    why="this is usual for laws that suit their record (docs/evidence/measured_shocks.md)",
)  # fmt: skip
INSTRUMENT_LAG = RULES.add("lag of the instrument", ABOUT, Grade.NOT_USABLE,
    condition=f"force follows velocity by more than {LARGEST_LAG:g} times the 10 ms that a shock itself can have, gas "
    "and friction excluded (the whole 95 % interval)",
    why="a delay of 20 ms shifts the phase of the force by 86 degrees at 12 Hz, the frequency of wheel hop: damping in "
    "the car becomes stiffness in the model",
    remedy="align the channels of the dynamometer (docs/reference/dyno_files.md), measure again and fit again",
)  # fmt: skip
AT_BOUND = RULES.add("parameter at its bound", ABOUT, Grade.LIMITED,
    condition="a fitted parameter is within 1 % of a bound",
    why="the record needs a value outside the law's bounds, or does not determine the parameter",
    remedy="check the record (eightpost inspect) for a lag of the instrument, or fit another law",
)  # fmt: skip
WARMING = RULES.add("temperature changed", ABOUT, Grade.LIMITED,
    condition=f"the temperature changes by more than {DRIFT:g} K over a record",
    why="damping changes with the temperature of the oil: the record mixes several states of the shock",
    remedy="warm up the shock first, or fit parts of the record and compare them",
)  # fmt: skip
NO_DYNAMICS = RULES.add("no lag known", ABOUT, Grade.LIMITED,
    condition="the shock was fitted to a table of forces over peak velocities",
    why="such a table contains no information on the lag of the force, which matters above about 5 Hz",
    remedy="measure force and velocity over time, and fit a law with a lag",
)  # fmt: skip
DOUBT = RULES.add("doubt of the fit", ABOUT, Grade.LIMITED,
    condition="the record or the fit is doubtful for any other reason",
    why="it may be harmless; the text of the reason names it",
    remedy="check it in the record (eightpost inspect), and fit again",
)  # fmt: skip
HELD_OUT = RULES.add("held-out error", ABOUT, Grade.LIMITED,
    condition=f"error on left-out parts of the records above {GOOD_FIT:g} % of the force's standard deviation",
    why="shocks of one bank differ by some tens of percent; smaller differences cannot be distinguished then",
    remedy="compare only shocks that differ by more; repeat the test to see how far two runs of the shock differ",
)  # fmt: skip
LARGE_HELD_OUT = RULES.add("large held-out error", ABOUT, Grade.NOT_USABLE,
    condition=f"error on left-out parts of the records above {POOR_FIT:g} %",
    why="a third of the force of what was left out is missing: shocks would be ranked by chance",
    remedy="check whether the records are of one shock and one setting (eightpost inspect), and fit them separately",
)  # fmt: skip
ONE_SPEED_ONLY = RULES.add("single speed", ABOUT, Grade.LIMITED,
    condition=f"every record is one sine, and their peak speeds are within a factor of {ONE_SPEED:g}",
    why="at one speed, lag, friction and a spring have the same effect on the loop: the error at a faster or a slower "
    "speed is unknown, and laws that agree here disagree by tens of percent there (docs/explanation/shock_law.md)",
    remedy="use the shock near this speed and frequency only; add a run at another speed, or a random test",
)  # fmt: skip
FEW_CYCLES_ONLY = RULES.add("few cycles", ABOUT, Grade.LIMITED,
    condition=f"less than {FEWEST_CYCLES} cycles of the motion in all",
    why="there are too few strokes to fit a law and to judge it by a part that is left out",
    remedy=f"record {FEWEST_CYCLES} or more cycles",
)  # fmt: skip
LOW_SPEED_ONLY = RULES.add("low speeds only", ABOUT, Grade.LIMITED,
    condition="peak speed below 10 in/s (0.254 m/s)",
    why="the valves of a race shock open at about this speed: the record does not show the force beyond",
    remedy="do not use it on kerbs and bumps; add a run that reaches the speeds of the track",
)  # fmt: skip


def fit_reasons(held_out: HeldOutErrors | None, runs: Runs, origin: str) -> Iterator[Reason]:
    """Yield the reasons of a held-out error, and of what the records cannot show.

    Args:
        held_out: Errors on left-out parts; None if they are not known.
        runs: Records of the fit.
        origin: Names of the records.
    """
    if held_out is not None and held_out.percent > GOOD_FIT:
        rule = HELD_OUT if held_out.percent <= POOR_FIT else LARGE_HELD_OUT
        figure = f"{held_out}; limits {GOOD_FIT:g} and {POOR_FIT:g} %"
        yield rule.reason("the law does not predict well what was left out of its fit", figure=figure, origin=origin)
    speed = max(runs.peak_speeds)
    if runs.has_one_speed:
        figure = f"sine of {runs.first.single_frequency:.3g} Hz, peak speed {speed:.3g} m/s"
        statement = "the test has a single speed; the error at other speeds is unknown"
        yield ONE_SPEED_ONLY.reason(statement, figure=figure, origin=origin)
    cycles = sum(_cycles(p.record["velocity"][p.inside]) for p in runs.prepared)
    if cycles < FEWEST_CYCLES:
        figure = f"{cycles} cycles in all; {FEWEST_CYCLES} are needed"
        yield FEW_CYCLES_ONLY.reason("the test has few cycles", figure=figure, origin=origin)
    if speed < NARROW:
        figure = f"peak speed {speed:.3g} m/s; limit {NARROW:.3g} m/s"
        yield LOW_SPEED_ONLY.reason("the test has low speeds only", figure=figure, origin=origin)


def _cycles(velocity: Array) -> int:
    """Return the number of times that a velocity (N,) becomes positive."""
    return int(np.sum((velocity[1:] > 0.0) & (velocity[:-1] <= 0.0)))


def shock_validity(
    tests: Sequence[DynoTest],
    *,
    percent: float,
    trouble: str,
    parameters: Iterable[Parameter],
    doubts: Iterable[str],
    conditions: Mapping[str, Any],
    further: Iterable[Reason] = (),
) -> Validity:
    """Return the verdict on a fit, and the ranges that it covers.

    Args:
        tests: Records.
        percent: RMS of the residual, in percent of the force's standard deviation.
        trouble: Cause that kept the fit from converging; empty if it converged.
        parameters: Scalar parameters.
        doubts: Further doubts about the fit, one sentence each.
        conditions: Conditions of the measurement, as in a shock file.
        further: Reasons of other rules.
    """
    origin = origin_of(tests)
    reasons = [_misfit(percent, origin)]
    if trouble:
        reasons.append(NOT_CONVERGED.reason("the fit did not converge", figure=trouble, origin=origin))
    reasons += [_verdict_at_bound(p, origin) for p in parameters if p.at_bound and p.name != "gas_stiffness"]
    reasons += [reason for test in tests for reason in _of_record(test)]
    reasons += [DOUBT.reason("the fit is doubtful", figure=doubt, origin=origin) for doubt in doubts]
    return Validity(Verdict([*reasons, *further]), tuple(_ranges_of(conditions)))


def origin_of(tests: Iterable[DynoTest]) -> str:
    """Return the names of records for the origin of a reason."""
    return ", ".join(dict.fromkeys(test.label for test in tests))


def peak_velocity_validity(
    *, percent: float, points: int, doubts: Iterable[str], conditions: Mapping[str, Any], origin: str
) -> Validity:
    """Return the verdict on a fit to a table of forces over peak velocities; for the arguments see `shock_validity`."""
    reasons = [_misfit(percent, origin)]
    figure = f"{points} points, 0 of them with a time"
    reasons.append(NO_DYNAMICS.reason("the shock has no lag", figure=figure, origin=origin))
    reasons += [DOUBT.reason("the fit is doubtful", figure=doubt, origin=origin) for doubt in doubts]
    return Validity(Verdict(reasons), tuple(_ranges_of(conditions)))


def _misfit(percent: float, origin: str) -> Reason:
    rule = GOOD if percent <= GOOD_FIT else DOUBTFUL_FIT if percent <= POOR_FIT else MISFIT
    text = "the law describes its record" if rule is GOOD else "the law does not describe its record well"
    figure = f"residual {percent:.1f} % of the force's standard deviation; limits {GOOD_FIT:g} and {POOR_FIT:g} %"
    return rule.reason(text, figure=figure, origin=origin)


def _verdict_at_bound(parameter: Parameter, origin: str) -> Reason:
    value, unit = in_field_units(parameter.value, parameter.unit)
    figure = f"{parameter.name} = {value:.4g} {unit}, at its {parameter.at_bound} bound"
    return AT_BOUND.reason("a parameter is at its bound", figure=figure, origin=origin)


def _of_record(test: DynoTest) -> Iterator[Reason]:
    """Yield the doubts about a record; a lag and a change of temperature have their own rules."""
    origin, lag = test.label, force_lag(test.series)
    if lag is not None and lag.low > LARGEST_LAG * LAG:
        figure = f"{lag}; a shock has under {1e3 * LAG:g} ms"
        yield INSTRUMENT_LAG.reason("the lag of the force is not that of a shock", figure=figure, origin=origin)
    warming = warming_note(test.series)
    if warming is not None:
        figure = f"{temperature_drift(test.series):+.1f} K; limit {DRIFT:g} K"
        yield WARMING.reason("the shock's temperature changed over the record", figure=figure, origin=origin)
    yield from test.reasons
    for note in test.notes:
        if note != warming:
            yield DOUBT.reason("the record is doubtful", figure=note, origin=origin)


def _ranges_of(conditions: Mapping[str, Any]) -> Iterator[Range]:
    """Yield the ranges in the conditions of a measurement; an FMU itself monitors its range of velocities."""
    known: tuple[tuple[str, str, str, str], ...] = (
        ("displacement_range [m]", "displacement", "amplitude", "m"),
        ("frequency_range [Hz]", "velocity", "frequency", "Hz"),
        ("temperature_range [K]", "temperature", "condition", "K"),
    )
    for key, variable, kind, unit in known:
        if key in conditions:
            low, high = conditions[key]
            yield Range(variable, kind, low, high, unit)  # type: ignore[arg-type]
    if (pressure := conditions.get("gas_pressure [Pa]")) is not None:
        yield Range("gas pressure", "condition", float(pressure), float(pressure), "Pa")
