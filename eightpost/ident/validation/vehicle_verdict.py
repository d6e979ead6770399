"""Verdict on a vehicle that was compared with records: exceeded limits and doubtful results."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from eightpost.errors import ParameterError
from eightpost.ident.validation.comparison import Comparison, Trend
from eightpost.ident.validation.vehicles import VehicleCase, VehicleValidation
from eightpost.ident.vehicle import write_fit
from eightpost.ident.vehicle.measured_levels import MeasuredLevels
from eightpost.ident.vehicle.vehicle_fit import fit_files
from eightpost.model_uncertainty import ModelUncertainty
from eightpost.outputs import replacing
from eightpost.validity import Validity, judged
from eightpost.verdict import Grade, Reason, Rules, Verdict, listed

ABOUT = "validation of the vehicle"

#: Fraction of an error's power that is linear in the prediction above which the model lacks a linear part, and the
#: error above which that is reported [1].
_LINEAR, _MATTERS = 0.5, 0.1

#: Number of records from which a wrong order is more than one swap.
_RANKED = 4

#: Largest level error that may be common to all records, in units of the level limit, and largest part of it by which
#: records may differ from each other [1].
_COMMON, _ALIKE = 3.0, 0.5


@dataclass(frozen=True, slots=True)
class Limits:
    """Limits beyond which a vehicle is not usable.

    Raises:
        ParameterError: A limit is outside its range.
    """

    level: float = 0.05  #: Largest relative error of the RMS of a judged output on random records [1].
    #: Largest RMS of measured minus predicted, over the measured RMS, on random, sine and bump records [1].
    error: float = 0.25
    rank: float = 0.9  #: Lowest rank correlation of RMS over four or more random records [1].

    def __post_init__(self) -> None:
        """Check the ranges."""
        if not (self.level > 0.0 and self.error > 0.0 and -1.0 <= self.rank <= 1.0):
            raise ParameterError(f"{self}: level and error must be above 0, and rank must be between -1 and 1")

    @classmethod
    def of_percent(cls, level: float | None, error: float | None) -> Limits:
        """Return the limits from percentages; None keeps the default."""
        given = {"level": level, "error": error}
        return cls(**{name: percent / 100.0 for name, percent in given.items() if percent is not None})

    def summary(self) -> str:
        """Return the limits as a sentence."""
        return (
            f"Limits: RMS within {100 * self.level:g} % on random records, errors within {100 * self.error:g} % of "
            f"the measured RMS, rank correlation over {_RANKED} or more records at least {self.rank:g}."
        )


RULES = Rules()

UNSTABLE = RULES.add("validated vehicle not stable", ABOUT, Grade.NOT_USABLE,
    condition="according to the fit, the car does not settle with every damper that was tried",
    why="a run with such shocks diverges, or nearly does",
    remedy="identify with more tests of other shocks",
)  # fmt: skip
WRONG_LEVEL = RULES.add("level of an output wrong", ABOUT, Grade.NOT_USABLE,
    condition="on a random record, the RMS of a judged output is off by more than --level (5 %), and the error is not "
    "one that all records share",
    why="setups differ by a few percent in these outputs",
    remedy="check the output's response in the report; identify again with more tests",
)  # fmt: skip
COMMON_LEVEL = RULES.add("level of an output wrong by the same factor on all records", ABOUT, Grade.LIMITED,
    condition=f"the RMS of an output is off by more than --level (5 %) and by at most {_COMMON:g} times that, on "
    f"{_RANKED} or more random records that differ; they are ranked right; and they deviate from the common error by "
    f"at most {100 * _ALIKE:g} % of it",
    why="an error that all setups share does not change which one is better, but the level itself is wrong",
    remedy="rank setups by this output, but do not rely on its level, nor on sums of it with other measures",
)  # fmt: skip
LARGE_ERROR = RULES.add("large error of an output", ABOUT, Grade.NOT_USABLE,
    condition="the error of a judged output is above --limit (25 % of the measured RMS)",
    why="above the limit, phase or gain is so wrong that measures that combine several outputs mean little",
    remedy="check the output's response in the report; identify again with more tests",
)  # fmt: skip
WRONG_RANK = RULES.add("setups ranked otherwise than by the rig", ABOUT, Grade.NOT_USABLE,
    condition=f"over {_RANKED} or more random records, the rank correlation of an output's RMS is below 0.9, and two "
    "records that differ by 1 % or more are predicted in the wrong order",
    why="a study exists to find the order of setups",
    remedy="do not choose setups by this output; identify again with more tests",
)  # fmt: skip
NOT_VALIDATED = RULES.add("vehicle not validated", ABOUT, Grade.NOT_USABLE,
    condition="all records are the fit's own, static or too gentle",
    why="errors on such records do not show how well the car predicts other records",
    remedy="give a held-out record: one that the car was not identified from",
)  # fmt: skip
PREDICTS = RULES.add("the vehicle predicts its records", ABOUT, Grade.USABLE,
    condition="no limit is exceeded on held-out records",
    why="the limits above",
)  # fmt: skip
OWN_RECORD = RULES.add("the fit's own records among them", ABOUT, Grade.LIMITED,
    condition="a record is one that the car was fitted to",
    why="errors on these records do not validate the car",
    remedy="omit these records",
)  # fmt: skip
GENTLE = RULES.add("shocks hardly move", ABOUT, Grade.LIMITED,
    condition="all shocks stay below 5 % of the velocities of the fit's tests",
    why="friction holds the car; such a record is shown, but no criterion applies to it",
    remedy="validate on records with larger motions",
)  # fmt: skip
LIFTED = RULES.add("tires leave the road", ABOUT, Grade.LIMITED,
    condition="a tire is at 1 % of its mean load or less",
    why="a linear car cannot model that",
    remedy="do not use the car for drives in which tires lift off",
)  # fmt: skip
LINEAR_ERROR = RULES.add("error linear in the prediction", ABOUT, Grade.LIMITED,
    condition=f"more than {100 * _LINEAR:g} % of an error above {100 * _MATTERS:g} % is linear in the prediction",
    why="the model's gain or phase is wrong, which a better linear model would correct",
    remedy="identify again with more tests, or with another recipe",
)  # fmt: skip
BEYOND = RULES.add("records beyond the fit's tests", ABOUT, Grade.LIMITED,
    condition="a record exceeds the amplitudes of the fit's tests by more than 10 %, or has more than 10 % of "
    "the power of a velocity or tire force above the fit's band",
    why="the model extrapolates there",
    remedy="identify from tests with the amplitudes and frequencies of these records",
)  # fmt: skip
DOUBT = RULES.add("doubt of a record", ABOUT, Grade.LIMITED,
    condition="any other doubtful property of a record",
    why="it may be harmless; the reason names it",
    remedy="check the record",
)  # fmt: skip
NO_LEVELS = RULES.add("levels not validated", ABOUT, Grade.LIMITED,
    condition="there is no random or track record",
    why="a study compares setups by their levels on such drives",
    remedy="validate on a random or track record",
)  # fmt: skip


def vehicle_verdict(study: VehicleValidation, limits: Limits | None = None) -> Verdict:
    """Return the verdict on a vehicle that was compared with records."""
    limits, known = limits or Limits(), study.fit.vehicle.validity
    edits = known.edits if known else ()
    reasons = [*edits, *_faults(study, limits), *_common_levels(study, limits), *_doubts(study)]
    if study.independent and not any(reason.grade is Grade.NOT_USABLE for reason in reasons):
        places = listed(case.record.name for case in study.independent)
        reasons.append(PREDICTS.reason("the car predicts its records", figure=_best(study), origin=places))
    return Verdict(reasons)


def keep_verdict(path: Path, study: VehicleValidation, verdict: Verdict) -> None:
    """Write a verdict, and the level errors of independent random records, into the file of a vehicle.

    The verdict replaces an earlier one.
    """
    fit, validity = study.fit, Validity.with_verdict(study.fit.vehicle.validity, verdict)
    if fit.trust is not None and fit.trust.measures:
        records = [case.record.series for case in study.independent if case.record.kind == "random"]
        measures = MeasuredLevels().with_records(fit.trust.measures, fit.vehicle, records)
        fit = replace(fit, trust=replace(fit.trust, measures=measures))
        validity = replace(validity, uncertainty=ModelUncertainty(measures=measures))
    with replacing(*fit_files(path)):
        write_fit(path, replace(fit, vehicle=judged(fit.vehicle, validity=validity)))


def _faults(study: VehicleValidation, limits: Limits) -> Iterator[Reason]:
    if not study.fit.stable:
        figure = "with 1 or more dampers"
        yield UNSTABLE.reason("the car does not settle", figure=figure, origin=study.fit.vehicle.name)
    if not study.independent:
        statement = "no record validates the car: all are the fit's own, static or too gentle"
        names = listed(case.record.name for case in study.cases)
        yield NOT_VALIDATED.reason(statement, figure=f"0 of {len(study.cases)} records are judged", origin=names)
        return
    yield from _levels(study, limits)
    yield from _errors(study, limits)
    wrong = [t for t in study.trends if len(t.measured) >= _RANKED and _ranks_wrong(t, limits)]
    if wrong:
        figure = f"rank correlation {min(t.rank for t in wrong):.2f}; limit {limits.rank:g}"
        statement = "the car ranks setups differently from the rig"
        yield WRONG_RANK.reason(statement, figure=figure, origin=listed(trend.name for trend in wrong))


def _ranks_wrong(trend: Trend, limits: Limits) -> bool:
    """Return whether records are ranked wrong that differ enough to be ranked."""
    return not trend.is_flat and trend.rank < limits.rank and trend.is_reversed


def _levels(study: VehicleValidation, limits: Limits) -> Iterator[Reason]:
    over = [(c, o) for c, o in _judged(study) if c.record.kind == "random" and abs(o.level) > limits.level]
    common = {t.name: t for t in study.trends if _is_common(t, limits)}
    over = [(case, output) for case, output in over if output.name not in common]
    if over:
        case, worst = max(over, key=lambda pair: abs(pair[1].level))
        figure = f"{100 * worst.level:+.1f} %; limit {100 * limits.level:g} %; {_counted(over)}"
        origin = f"{worst.name} on {case.record.name}"
        yield WRONG_LEVEL.reason("the RMS of an output is wrong", figure=figure, origin=origin)


def _is_common(trend: Trend, limits: Limits) -> bool:
    """Return whether the level of an output is wrong by nearly the same factor on all records, and ranks them right."""
    levels = np.abs(trend.predicted / trend.measured - 1.0)
    return bool(
        len(levels) >= _RANKED
        and limits.level < levels.max() <= _COMMON * limits.level
        and not trend.is_flat
        and not _ranks_wrong(trend, limits)
        and trend.remaining_error <= _ALIKE * abs(trend.bias)
    )


def _common_levels(study: VehicleValidation, limits: Limits) -> Iterator[Reason]:
    """Yield a reason if levels are wrong by a factor that all records share."""
    common = [trend for trend in study.trends if _is_common(trend, limits)]
    if common:
        worst = max(common, key=lambda trend: abs(trend.bias))
        figure = (
            f"{worst.name}: {100 * worst.bias:+.1f} % on {len(worst.measured)} records, "
            f"{100 * worst.remaining_error:.1f} % without the common factor; rank correlation "
            f"{min(trend.rank for trend in common):.2f}; limit {100 * limits.level:g} %"
        )
        statement = "the RMS of an output is wrong by the same factor on all records, which are ranked right"
        yield COMMON_LEVEL.reason(statement, figure=figure, origin=listed(trend.name for trend in common))


def _errors(study: VehicleValidation, limits: Limits) -> Iterator[Reason]:
    over = [(c, o) for c, o in _judged(study) if o.error > limits.error]
    if over:
        case, worst = max(over, key=lambda pair: pair[1].error)
        figure = f"{100 * worst.error:.0f} % of the measured RMS; limit {100 * limits.error:g} %; {_counted(over)}"
        origin = f"{worst.name} on {case.record.name}"
        yield LARGE_ERROR.reason("the error of an output is too large", figure=figure, origin=origin)


def _doubts(study: VehicleValidation) -> Iterator[Reason]:
    """Yield the reasons that limit the use of the car."""
    cases = study.cases
    groups = (
        (
            OWN_RECORD,
            "the car was fitted to a record, so errors on it do not validate the car",
            [c for c in cases if c.is_fit_record],
        ),
        (GENTLE, "the shocks barely move: friction holds them", [c for c in cases if c.is_gentle]),
        (LIFTED, "tires leave the road", [c for c in cases if c.lifted]),
        (
            BEYOND,
            "a record exceeds the amplitudes or frequencies of the fit's tests",
            [c for c in cases if c.extrapolations],
        ),
    )
    for rule, statement, found in groups:
        if found:
            figure = f"{len(found)} of {len(cases)} records"
            yield rule.reason(statement, figure=figure, origin=listed(case.record.name for case in found))
    yield from _linear(study)
    for case in cases:
        for note in case.notes:
            yield DOUBT.reason("a record is doubtful", figure=note.rstrip("."), origin=case.record.name)
    if not study.of_kind("random"):
        figure = f"0 of {len(cases)} records are random"
        yield NO_LEVELS.reason("levels of setups were not validated", figure=figure, origin="the records")


def _linear(study: VehicleValidation) -> Iterator[Reason]:
    """Yield a reason if errors are linear in the prediction, so that a better linear model would avoid them."""
    found: dict[str, float] = {}
    for case in study.independent:
        for output in case.judged:
            spectrum = case.spectra.get(output.name)
            if spectrum is not None and spectrum.share > _LINEAR and output.error > _MATTERS:
                found[output.name] = max(found.get(output.name, 0.0), spectrum.share)
    if found:
        figure = f"{100 * max(found.values()):.0f} % of its power; limit {100 * _LINEAR:g} %"
        yield LINEAR_ERROR.reason("an error is linear in the prediction", figure=figure, origin=listed(found))


def _best(study: VehicleValidation) -> str:
    """Return the main figures of a successful validation."""
    random = [o for c, o in _judged(study) if c.record.kind == "random"]
    judged = [o for _, o in _judged(study)]
    parts = [f"RMS within {100 * max(abs(o.level) for o in random):.3g} %"] if random else []
    parts += [f"errors up to {100 * max(o.error for o in judged):.3g} % of the measured RMS"] if judged else []
    ranked = [trend.rank for trend in study.trends if not trend.is_flat]
    if ranked:
        count = len(study.trends[0].measured)
        parts.append(f"rank correlation of setups at least {min(ranked):.2f} over {count} records")
    return f"{len(study.independent)} records that it was not fitted to: {', '.join(parts)}"


def _judged(study: VehicleValidation) -> Iterator[tuple[VehicleCase, Comparison]]:
    for case in study.independent:
        for found in case.judged:
            yield case, found


def _counted(over: list[tuple[VehicleCase, Comparison]]) -> str:
    records = len({id(case) for case, _ in over})
    return f"{len({found.name for _, found in over})} outputs on {records} record{'s' * (records > 1)}"
