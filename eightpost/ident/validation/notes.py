"""What a person should know of a validation before believing it, a sentence each."""

from __future__ import annotations

from typing import TYPE_CHECKING

from eightpost.ident.validation.random import RandomValidation
from eightpost.ident.validation.static import SETTLING, StaticValidation
from eightpost.units import convert

if TYPE_CHECKING:
    from eightpost.ident.validation.evaluation import Validation
    from eightpost.ident.validation.study import Case, Outcome, ValidationStudy

#: Share of a residual that is coherent with the velocity from which the law lacks dynamics.
COHERENT = 0.5

#: Share of the samples outside the fitted velocities from which a note says so.
_SOME_BEYOND = 0.01

#: Share of the mean square error from which it is an offset more than anything else.
_OFFSET = 0.5


def notes_on(study: ValidationStudy, limit: float | None = None) -> tuple[str, ...]:
    """Return the notes on a study, what makes it unacceptable first.

    Args:
        study: Of any shocks and records.
        limit: Highest error [percent of standard deviation].
    """
    over = [
        f"{_pair(case)}: the error is {case.outcome.percent:.3g} %, over the limit of {limit:g} %"
        for case in study.cases
        if not case.is_within(limit)
    ]
    alone = [
        f"{record.name} was predicted by no shock: all were fitted under other conditions"
        for record in study.records
        if not study.of_record(record)
    ]
    beyond = _grouped([(case, _BEYOND) for case in study.cases if case.is_mostly_beyond])
    own = _grouped([(case, _OWN) for case in study.cases if case.is_fit_record])
    doubts = _grouped([(case, note) for case in study.cases for note in _doubts(case)])
    treated = dict.fromkeys(note for case in study.cases for note in _changes(case))
    return (*over, *beyond, *alone, *own, *doubts, *treated, *study.unpaired)


def _pair(case: Case) -> str:
    return f"{case.label} on {case.record.name}"


_BEYOND = (
    "more than half of the samples are outside the fitted velocities; this judges the extrapolation, not the fit: "
    "fit a record that is as fast"
)
_OWN = "the shock was fitted to this record; this is the error of its fit and validates nothing"


def _grouped(found: list[tuple[Case, str]]) -> list[str]:
    """Return a sentence for each record and note, with all the shocks that it is true of."""
    groups: dict[tuple[str, str], list[str]] = {}
    for case, note in found:
        groups.setdefault((case.record.name, note), []).append(case.label)
    return [f"{', '.join(labels)} on {record}: {note}" for (record, note), labels in groups.items()]


def _doubts(case: Case) -> list[str]:
    outcome, found = case.outcome, []
    prediction = prediction_of(outcome)
    if prediction and prediction.offset**2 > _OFFSET * prediction.rms**2 and prediction.percent > 1.0:
        found.append(
            f"most of the error is an offset of {convert(prediction.offset, 'N', 'lbf'):.3g} lbf "
            "(measured less predicted): another gas pressure, another zero of the load cell or another position"
        )
    if isinstance(outcome, RandomValidation) and outcome.residual and outcome.residual.share > COHERENT:
        found.append(
            f"{100.0 * outcome.residual.share:.0f} % of the residual is coherent with the velocity: a "
            "linear filter would predict it, so the law lacks dynamics or its curve has another slope"
        )
    if outcome.beyond > _SOME_BEYOND and not case.is_mostly_beyond:
        found.append(f"{100.0 * outcome.beyond:.2g} % of the samples are outside the fitted velocities")
    return found


def _changes(case: Case) -> list[str]:
    """Return how a record was treated otherwise than the dissertation does."""
    outcome = case.outcome
    if isinstance(outcome, StaticValidation):
        if outcome.settling < SETTLING:
            return [
                f"{case.record.name}: its holds are short; from {outcome.settling:.2g} s on they are averaged, not "
                f"from {SETTLING:g} s on"
            ]
        return []
    prediction = prediction_of(outcome)
    said = prediction.changes if prediction else ()
    # Which seconds of a sine or a bump are judged goes with its kind, as a bump's low-pass does; how a curve would be
    # fitted is no matter here.
    by_kind = {"random": (), "sine": ("seconds",), "bump": ("seconds", "cut-off")}[case.record.kind]
    return [
        f"{case.record.name}: {change.replace(' fitted', ' judged')}"
        for change in said
        if not change.startswith(("transition", *by_kind))
    ]


def prediction_of(outcome: Outcome) -> Validation | None:
    """Return the prediction in time, None of a static record."""
    return None if isinstance(outcome, StaticValidation) else outcome.prediction
