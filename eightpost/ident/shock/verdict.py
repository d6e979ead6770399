"""Parameters of a fit with their standard deviations, findings about them, the verdict, the spread of builds."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from eightpost.array_types import Array
from eightpost.errors import EightpostError
from eightpost.ident.shock.dynamics import FadingLag
from eightpost.ident.shock.law_fit import HeldOutErrors
from eightpost.ident.shock.problem import Solution, quantile
from eightpost.ident.shock.runs import ONE_FREQUENCY, Runs, StrokeRange
from eightpost.least_squares import linear_solution, standard_error
from eightpost.rig.dyno_test import DynoTest
from eightpost.rig.motion import force_lag
from eightpost.signals import TimeSeries
from eightpost.units import convert, display_unit
from eightpost.validity import Range, Validity
from eightpost.verdict import Reason, Rules, Verdict

# ==== Parameters and verdict =========================================================================================

# ---- The scalar parameters of a fit ---------------------------------------------------------------------------------

_GAS_UNITS = {"gas_preload": "N", "gas_stiffness": "N/m"}

#: A parameter within this share of a bound counts as at the bound.
_AT_BOUND = 0.01


@dataclass(frozen=True, slots=True)
class Parameter:
    """A fitted parameter."""

    name: str  #: Name in the shock file.
    value: float  #: Value in `unit`.
    unit: str  #: SI unit.
    #: Standard error from leaving out blocks of the record; None if the record does not determine it.
    error: float | None
    bounds: tuple[float, float] | None = None  #: Lower and upper bound of the fit; None if unbounded.
    reach: float = 1.96  #: Half-width of the 95 % interval in standard errors.

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
            if np.isfinite(bound) and abs(self.value - bound) <= _AT_BOUND * (abs(bound) or self.error or 0.0):
                return name
        return ""


#: Standard errors of the preload from its difference from that of LPNL2, where the runs have one motion. With them, its
#: 95 % intervals contain 90 % of 162 known preloads, without them 55 % (docs/explanation/shock_law.md).
_LEVEL = 2.0 / 1.96


def parameters_of(solution: Solution, level: float = 0.0) -> tuple[Parameter, ...]:
    """Return the law's own parameters, then those of the gas force that were fitted.

    `level` is the difference of the preload from that of LPNL2 [N] where the runs have one motion, else 0.
    """
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
    if model.gas.offsets and errors[0] is not None:
        errors[0] = float(np.hypot(errors[0], _LEVEL * level))
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

#: Share of the standard deviation from which a remaining offset is reported.
_NOTABLE_OFFSET = 0.01


def in_field_units(value: float, unit: str) -> tuple[float, str]:
    """Return an SI value in the unit in which it is shown: ms, lbf or N."""
    shown = "ms" if unit == "s" else display_unit(unit)
    return convert(value, unit, shown), shown


def findings(solution: Solution, parameters: Iterable[Parameter], *, recipe: str, gas: str) -> list[str]:
    """Return a sentence for each doubt about a solution besides those of the verdict."""
    # A gas stiffness at its lower bound, 0, is normal.
    own = [parameter for parameter in parameters if parameter.name != "gas_stiffness"]
    at_bound = ((p, *in_field_units(p.value, p.unit)) for p in own if p.at_bound)
    bounds = [f"{p.name} = {value:.4g} {unit} is at its {p.at_bound} bound" for p, value, unit in at_bound]
    offset = _offset(solution) if gas == "subtracted" else []
    return [*bounds, *_unused_fading(solution), *_stiff_with_lag(solution, recipe), *offset]


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

#: Limits of the error, in percent of the force's standard deviation (docs/reference/verdict.md).
GOOD, POOR = 2.5, 15.0

#: Error of the static curve alone [%], up to which a test of one frequency is usable: the error is at most about this
#: large even if the whole loop is that of a late force channel or of a spring (docs/reference/verdict.md).
NARROW = 12.0

#: Octaves of speed over the peak speed that are low speeds, their smallest number of samples, and the largest median
#: residual there [%] of a usable fit (docs/explanation/shock_law.md). Below them, friction is most of the force.
OCTAVES, FEWEST, OFF = ((0.04, 0.08), (0.08, 0.16)), 20, 5.0

#: Share of the force that a late force turns into stiffness, from which it is reported [1].
_TURNED = 0.1

RULES = Rules.read(
    Path(__file__).with_suffix(".txt"), ABOUT, good=GOOD, poor=POOR, one_frequency=ONE_FREQUENCY, narrow=NARROW,
    slowest=100.0 * OCTAVES[0][0], highest=100.0 * OCTAVES[-1][1], off=OFF,
)  # fmt: skip


def shock_validity(
    tests: Sequence[DynoTest],
    runs: Runs,
    *,
    percent: float,
    static: float,
    level: float | None,
    low_speeds: tuple[float, float],
    held_out: HeldOutErrors | None,
    trouble: str,
    conditions: Mapping[str, Any],
) -> Validity:
    """Return the verdict on a fit, and the ranges that it covers.

    Args:
        tests: Records.
        runs: Runs of the fit.
        percent: RMS of the residual, in percent of the force's standard deviation.
        static: The same of the static curve alone [%].
        level: Half-width of the 95 % interval of the gas preload [N]; None if it is not known.
        low_speeds: Error at low speeds [%], and its velocity [m/s]; see `error_at_low_speeds`.
        held_out: Errors on left-out parts; None if they are not known.
        trouble: Cause that kept the fit from converging; empty if it converged.
        conditions: Conditions of the measurement, as in a shock file.
    """
    origin, strokes = origin_of(tests), StrokeRange.of(runs.prepared)
    tested = f"{strokes}{_temperatures(conditions)}"
    reasons = [_error(percent, held_out, origin, tested)]
    rest = "" if level is None else f"; level at rest known to +-{level:.2g} N"
    loop = f"error of the static curve alone {static:.3g} %, limit {NARROW:g} %{rest}; {tested}"
    if strokes.has_one_frequency and static > NARROW:
        reasons.append(RULES.reason("one frequency", "the test has one frequency and a wide loop", loop, origin))
    elif runs.are_two_sines:
        reasons.append(RULES.reason("two sines", "the test has two sines only", tested, origin))
    elif strokes.has_one_frequency:
        reasons.append(RULES.reason("narrow loop", "the test has one frequency and a narrow loop", loop, origin))
    off, velocity = low_speeds
    if off > OFF:
        where = f"median residual {off:.2g} % of the force at {velocity:.2g} m/s, limit {OFF:g} %"
        reasons.append(RULES.reason("low speeds", "the law is wrong at low speeds", where, origin))
    if trouble:
        reasons.append(RULES.reason("fit not converged", "the fit did not converge", trouble, origin))
    reasons += [reason for test in tests for reason in _of_record(test, strokes.frequency[1])]
    return Validity(Verdict(reasons), tuple(_ranges_of(conditions)))


def error_at_low_speeds(measured: TimeSeries, predicted: TimeSeries) -> tuple[float, float]:
    """Return the largest median residual in an octave of low speeds, and the middle of this octave [m/s].

    The residual is in percent of the RMS force there without the gas force; 0 if no octave has enough samples.
    """
    velocity, error = measured["velocity"], measured["force"] - predicted["force"]
    force, found = measured["force"] - predicted["gas_force"], [(0.0, 0.0)]
    for low, high in np.abs(velocity).max() * np.array(OCTAVES):
        for side in (1.0, -1.0):
            here = (side * velocity > low) & (side * velocity <= high)
            if here.sum() >= FEWEST:
                share = np.abs(np.median(error[here])) / np.sqrt(np.mean(force[here] ** 2))
                found.append((100.0 * float(share), side * float(np.sqrt(low * high))))
    return max(found)


def _temperatures(conditions: Mapping[str, Any]) -> str:
    if "temperature_range [K]" not in conditions:
        return ""
    low, high = (f"{convert(end, 'K', 'degC'):.0f}" for end in conditions["temperature_range [K]"])
    return f", {low} to {high} degC"


def origin_of(tests: Iterable[DynoTest]) -> str:
    """Return the names of records for the origin of a reason."""
    return ", ".join(dict.fromkeys(test.label for test in tests))


def peak_velocity_validity(
    *, percent: float, points: int, doubts: Iterable[str], conditions: Mapping[str, Any], origin: str
) -> Validity:
    """Return the verdict on a fit to a table of forces over peak velocities; for the arguments see `shock_validity`."""
    speed = conditions["velocity_range [m/s]"][1]
    reasons = [_error(percent, None, origin, f"peak speeds up to {speed:.2g} m/s")]
    figure = f"{points} points, 0 of them with a time"
    reasons.append(RULES.reason("no lag known", "the shock has no lag", figure, origin))
    reasons += [RULES.reason("doubt of the fit", "the fit is doubtful", doubt, origin) for doubt in doubts]
    return Validity(Verdict(reasons), tuple(_ranges_of(conditions)))


def _error(percent: float, held_out: HeldOutErrors | None, origin: str, tested: str) -> Reason:
    """Return the reason of the larger one of a residual and an error on left-out parts, within a tested range."""
    if held_out is not None and held_out.percent > percent:
        error, what = held_out.percent, str(held_out)
    else:
        error, what = percent, f"residual {percent:.3g} % of the force's standard deviation"
    return error_reason(error, "the law describes its records", figure=f"{what}; {tested}", origin=origin)


def error_reason(error: float, statement: str, *, figure: str, origin: str) -> Reason:
    """Return the reason of an error in percent of the force's standard deviation; figure and statement without limits.

    Args:
        error: Error on what was left out, or of the residual [%].
        statement: Statement that `well`, `roughly` or `poorly` completes.
        figure: Error with what it is of.
        origin: Names of the records.
    """
    if error <= GOOD:
        rule, how = "small error", "well"
    else:
        rule, how = ("notable error", "roughly") if error <= POOR else ("large error", "poorly")
    return RULES.reason(rule, f"{statement} {how}", f"{figure}; limits {GOOD:g} and {POOR:g} %", origin)


def _of_record(test: DynoTest, frequency: float) -> Iterator[Reason]:
    """Yield the doubts about a record.

    A late force counts if it turns a tenth of the force or more from damping into stiffness at a frequency [Hz].
    """
    for reason in test.reasons:
        lag = force_lag(test.series) if reason.rule == "late force" else None
        if lag is None or 2.0 * np.pi * frequency * lag.low > _TURNED:
            yield reason
    for note in test.notes:
        yield RULES.reason("doubt of the fit", "the record is doubtful", figure=note, origin=test.label)


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


# ==== Spread between the builds of a shock whose records are fitted together =========================================
# Every build is fitted alone with the law, the recipe and the kind of curve of the common fit. The standard deviation
# of the builds' curves at a velocity, without the error of their fits, is the build-to-build uncertainty of the common
# curve:
#
#     s(v)^2 = max(variance of f_b(v) over the builds b - mean of the squared standard errors of f_b(v), 0)

#: Number of velocities at which the spread is stated.
POINTS = 61

#: Sides of a curve: sign of the velocity by the name of the FMU's parameter that scales the side.
_SIDES = {"compression_scale": 1.0, "rebound_scale": -1.0}


@dataclass(frozen=True, slots=True, eq=False)
class BuildSpread:
    """Spread between B builds of a shock."""

    builds: tuple[str, ...]  #: Names of the builds (B,).
    runs: tuple[int, ...]  #: Number of runs of each.
    velocity: Array  #: Velocities (M,) that all builds reach [m/s].
    force: Array  #: Static force of each build (B, M) [N].
    deviation: Array  #: Standard deviation between the builds (M,) [N], without the error of their fits.
    #: Scale of each build relative to the common curve (B,) [1], by `compression_scale` and `rebound_scale`.
    scales: dict[str, Array]
    #: Values (B,) and SI unit of each of the law's scalar parameters and of the gas force, by name.
    parameters: dict[str, tuple[Array, str]]
    notes: tuple[str, ...] = ()  #: Builds that could not be fitted alone, one sentence each.

    def percent(self, scale: str) -> float:
        """Return the standard deviation between the builds of `compression_scale` or `rebound_scale` in percent."""
        return 100.0 * _deviation(self.scales[scale])

    def summary(self) -> str:
        """Return one sentence."""
        return (
            f"{len(self.builds)} builds ({', '.join(self.builds)}): the static force differs from build to build by "
            f"{self.percent('compression_scale'):.2g} % in compression and {self.percent('rebound_scale'):.2g} % in "
            "rebound (standard deviation)"
        )

    def to_json(self) -> dict[str, Any]:
        """Return the spread as JSON values; docs/explanation/shock_law.md describes the keys."""
        return {
            "builds": list(self.builds),
            "runs": list(self.runs),
            "velocity [m/s]": self.velocity.tolist(),
            "force [N]": dict(zip(self.builds, self.force.tolist(), strict=True)),
            "standard_deviation [N]": self.deviation.tolist(),
            "parameters": {
                **{name: _entry(values, "1") for name, values in self.scales.items()},
                **{name: _entry(values, unit) for name, (values, unit) in self.parameters.items()},
            },
            "notes": list(self.notes),
        }


def _entry(values: Array, unit: str) -> dict[str, Any]:
    return {
        "values": values.tolist(),
        "mean": float(values.mean()),
        "standard_deviation": _deviation(values),
        "unit": unit,
    }


def _deviation(values: Array) -> float:
    return float(np.std(values, ddof=1))


def build_spread(
    runs: Runs, common: Solution, fit_alone: Callable[[Runs], Solution]
) -> tuple[BuildSpread | None, tuple[str, ...]]:
    """Return the spread between the builds of runs that were fitted together, and notes.

    Returns:
        The spread, None if the runs are of one build, or if fewer than two builds can be fitted alone.
    """
    found: dict[str, Solution] = {}
    notes: list[str] = []
    for build in runs.builds:
        own = Runs.of([p for p in runs.prepared if p.build == build])
        try:
            found[build] = fit_alone(own)
        except (EightpostError, ValueError) as error:  # laws and fits reject data by a ValueError
            notes.append(f"build {build} is not part of the spread between builds: {error}")
    if len(found) < 2:
        return None, tuple(notes)
    return _spread(found, common, tuple(notes)), tuple(notes)


def _spread(found: dict[str, Solution], common: Solution, notes: tuple[str, ...]) -> BuildSpread:
    solutions = list(found.values())
    inside = [one.model.runs.velocity[one.model.runs.inside] for one in solutions]
    velocity = np.linspace(max(float(v.min()) for v in inside), min(float(v.max()) for v in inside), POINTS)
    force, errors = (np.array(rows) for rows in zip(*(_curve(one, velocity) for one in solutions), strict=True))
    middle = _curve(common, velocity)[0]
    variance = np.var(force, axis=0, ddof=1) - np.mean(errors**2, axis=0)
    known = [{p.name: p for p in parameters_of(one)} for one in solutions]
    shared = [name for name in known[0] if all(name in parameters for parameters in known)]
    return BuildSpread(
        tuple(found),
        tuple(len(one.model.runs.prepared) for one in solutions),
        velocity,
        force,
        np.sqrt(np.maximum(variance, 0.0)),
        side_scales(force, middle, velocity),
        {name: (np.array([one[name].value for one in known]), known[0][name].unit) for name in shared},
        notes,
    )


def side_scales(force: Array, common: Array, velocity: Array) -> dict[str, Array]:
    """Return the scales (B,) with which a common curve (M,) is closest to the curves (B, M) of builds, by its side."""
    found = {}
    for name, sign in _SIDES.items():
        side = sign * velocity > 0.0
        found[name] = np.asarray(force[:, side] @ common[side] / (common[side] @ common[side]))
    return found


def _curve(solution: Solution, velocity: Array) -> tuple[Array, Array]:
    """Return the static force (M,) [N] of a fit and its standard errors [N]."""
    model = solution.model
    n, columns = model.curve_count, model.basis.at(velocity)
    errors = standard_error(columns, np.nan_to_num(solution.covariance[:, :n, :n]))
    return np.asarray(columns @ solution.parameters[:n]), errors
