"""The verdict on a fitted shock: how well it reproduces its record, what is doubtful, and the ranges that it covers."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from eightpost.ident.shock.report.findings import in_field_units
from eightpost.rig.dyno_notes import DRIFT, lag_note, temperature_drift, warming_note
from eightpost.validity import Range, Validity
from eightpost.verdict import Grade, Reason, Rule, Verdict

if TYPE_CHECKING:
    from eightpost.ident.shock.report.parameters import Parameter
    from eightpost.rig.dyno_test import DynoTest

ABOUT = "fit of the shock"

#: Limits of the RMS of the residual, in percent of the force's standard deviation.
GOOD_FIT, POOR_FIT = 10.0, 30.0

#: A lag of the force above this multiple of what a shock can have is attributed to the instrument.
LARGEST_LAG = 2.0

NOT_CONVERGED = Rule(
    "fit not converged", ABOUT, Grade.NOT_USABLE,
    condition="the search for the parameters did not end at a minimum",
    why="other starting values would give another shock",
    remedy="check the record (eightpost inspect), or fit a simpler law",
)  # fmt: skip
MISFIT = Rule(
    "large misfit of the fit", ABOUT, Grade.NOT_USABLE,
    condition=f"RMS of the residual above {POOR_FIT:g} % of the force's standard deviation",
    why="a third of the force is not in the model: it would rank shocks by chance",
    remedy="check the record (eightpost inspect), or fit another law",
)  # fmt: skip
DOUBTFUL_FIT = Rule(
    "notable misfit of the fit", ABOUT, Grade.LIMITED,
    condition=f"RMS of the residual above {GOOD_FIT:g} %",
    why="a law that suits its record has a residual of a few percent (docs/measured_shocks.md)",
    remedy="compare the laws on this record, and check the record (eightpost inspect)",
)  # fmt: skip
GOOD = Rule(
    "small misfit of the fit", ABOUT, Grade.USABLE,
    condition=f"RMS of the residual at most {GOOD_FIT:g} %",
    why="this is usual for laws that suit their record (docs/measured_shocks.md)",
    remedy="nothing",
)  # fmt: skip
INSTRUMENT_LAG = Rule(
    "lag of the instrument", ABOUT, Grade.NOT_USABLE,
    condition=f"force lags or leads velocity by more than {LARGEST_LAG:g} times the lag that a shock itself can have "
    "(10 ms, in slow tests that of a gas spring)",
    why="a delay of 20 ms shifts the phase of the force by 86 degrees at 12 Hz, the frequency of wheel hop: damping in "
    "the car becomes stiffness in the model",
    remedy="align the channels of the dynamometer (docs/dyno_files.md), measure again and fit again",
)  # fmt: skip
SOME_LAG = Rule(
    "lag or lead that a shock does not have", ABOUT, Grade.LIMITED,
    condition="force lags velocity by more than a shock itself can, or leads it by more than 2 ms",
    why="channels sampled at different times or a filter on one of them: the fitted lag includes it",
    remedy="align the channels of the dynamometer (docs/dyno_files.md) and fit again",
)  # fmt: skip
AT_BOUND = Rule(
    "parameter at its bound", ABOUT, Grade.LIMITED,
    condition="a fitted parameter is within 1 % of a bound",
    why="the record needs a value outside the law's bounds, or does not determine the parameter",
    remedy="check the record (eightpost inspect) for a lag of the instrument, or fit another law",
)  # fmt: skip
WARMING = Rule(
    "temperature changed", ABOUT, Grade.LIMITED,
    condition=f"the temperature changes by more than {DRIFT:g} K over a record",
    why="damping changes with the temperature of the oil: the record mixes several states of the shock",
    remedy="warm up the shock first, or fit parts of the record and compare them",
)  # fmt: skip
NO_DYNAMICS = Rule(
    "no lag known", ABOUT, Grade.LIMITED,
    condition="the shock was fitted to a table of forces over peak velocities",
    why="such a table contains no information on the lag of the force, which matters above about 5 Hz",
    remedy="measure force and velocity over time, and fit a law with a lag",
)  # fmt: skip
DOUBT = Rule(
    "doubt of the fit", ABOUT, Grade.LIMITED,
    condition="the record or the fit is doubtful for any other reason",
    why="it may be harmless; the text of the reason names it",
    remedy="check it in the record (eightpost inspect), and fit again",
)  # fmt: skip

RULES: tuple[Rule, ...] = tuple(value for value in list(globals().values()) if isinstance(value, Rule))


def shock_validity(
    tests: Sequence[DynoTest],
    *,
    percent: float,
    trouble: str,
    parameters: Iterable[Parameter],
    doubts: Iterable[str],
    conditions: Mapping[str, Any],
) -> Validity:
    """Return the verdict on a fit, and the ranges that it covers.

    Args:
        tests: Records.
        percent: RMS of the residual, in percent of the force's standard deviation.
        trouble: Cause that kept the fit from converging; empty if it converged.
        parameters: Scalar parameters.
        doubts: Further doubts about the fit, one sentence each.
        conditions: Conditions of the measurement, as in a shock file.
    """
    origin = ", ".join(dict.fromkeys(_name(test) for test in tests))
    reasons = [_misfit(percent, origin)]
    if trouble:
        reasons.append(NOT_CONVERGED.reason("the fit did not converge", figure=trouble, origin=origin))
    reasons += [_at_bound(p, origin) for p in parameters if p.at_bound and p.name != "gas_stiffness"]
    reasons += [reason for test in tests for reason in _of_record(test)]
    reasons += [DOUBT.reason("the fit is doubtful", figure=doubt, origin=origin) for doubt in doubts]
    return Validity(Verdict(reasons), tuple(ranges_of(conditions)))


def peak_velocity_validity(
    *, percent: float, points: int, doubts: Iterable[str], conditions: Mapping[str, Any], origin: str
) -> Validity:
    """Return the verdict on a fit to a table of forces over peak velocities; for the arguments see `shock_validity`."""
    reasons = [_misfit(percent, origin)]
    figure = f"{points} points, 0 of them with a time"
    reasons.append(NO_DYNAMICS.reason("the shock has no lag", figure=figure, origin=origin))
    reasons += [DOUBT.reason("the fit is doubtful", figure=doubt, origin=origin) for doubt in doubts]
    return Validity(Verdict(reasons), tuple(ranges_of(conditions)))


def _misfit(percent: float, origin: str) -> Reason:
    rule = GOOD if percent <= GOOD_FIT else DOUBTFUL_FIT if percent <= POOR_FIT else MISFIT
    text = "the law describes its record" if rule is GOOD else "the law does not describe its record well"
    figure = f"residual {percent:.1f} % of the force's standard deviation; limits {GOOD_FIT:g} and {POOR_FIT:g} %"
    return rule.reason(text, figure=figure, origin=origin)


def _at_bound(parameter: Parameter, origin: str) -> Reason:
    value, unit = in_field_units(parameter.value, parameter.unit)
    figure = f"{parameter.name} = {value:.4g} {unit}, at its {parameter.at_bound} bound"
    return AT_BOUND.reason("a parameter is at its bound", figure=figure, origin=origin)


def _of_record(test: DynoTest) -> Iterator[Reason]:
    """Yield the doubts about a record; a lag and a change of temperature have their own rules."""
    origin, lag = _name(test), lag_note(test.series)
    if lag is not None:
        rule = INSTRUMENT_LAG if abs(lag.delay) > LARGEST_LAG * lag.allowed else SOME_LAG
        figure = f"{1e3 * lag.delay:.3g} ms; a shock can have {-1e3 * lag.lead:.3g} to {1e3 * lag.allowed:.3g} ms"
        yield rule.reason("the lag of the force is not that of a shock", figure=figure, origin=origin)
    warming = warming_note(test.series)
    if warming is not None:
        figure = f"{temperature_drift(test.series):+.1f} K; limit {DRIFT:g} K"
        yield WARMING.reason("the shock's temperature changed over the record", figure=figure, origin=origin)
    for note in test.notes:
        if note not in (warming, None if lag is None else lag.note):
            yield DOUBT.reason("the record is doubtful", figure=note, origin=origin)


def _name(test: DynoTest) -> str:
    return f"record {test.source.name}" if test.source else "a record in memory"


def ranges_of(conditions: Mapping[str, Any]) -> Iterator[Range]:
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
