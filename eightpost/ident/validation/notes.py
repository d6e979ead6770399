"""Notes on a validation that a reader should know, one sentence each."""

from __future__ import annotations

from typing import TYPE_CHECKING

from eightpost.ident.validation.static import SETTLING, StaticValidation
from eightpost.ident.validation.verdict import prediction_of

if TYPE_CHECKING:
    from eightpost.ident.validation.study import Case, ValidationStudy


def notes_on(study: ValidationStudy) -> tuple[str, ...]:
    """Return how records were treated and which shocks were compared with no record; the verdict has the rest."""
    treated = dict.fromkeys(note for case in study.cases for note in _changes(case))
    return (*treated, *study.unpaired)


def _changes(case: Case) -> list[str]:
    """Return departures from the dissertation's treatment of a record."""
    outcome = case.outcome
    if isinstance(outcome, StaticValidation):
        if outcome.settling < SETTLING:
            return [
                f"{case.record.name}: its holds are short; they are averaged from {outcome.settling:.2g} s on, not "
                f"from {SETTLING:g} s on"
            ]
        return []
    prediction = prediction_of(outcome)
    changes = prediction.changes if prediction else ()
    # The segment of a sine or a bump follows from its kind, as does a bump's low-pass; the transition of the curve
    # matters only for a fit.
    by_kind = {"random": (), "sine": ("seconds",), "bump": ("seconds", "cutoff")}[case.record.kind]
    return [
        f"{case.record.name}: {change.replace(' fitted', ' evaluated')}"
        for change in changes
        if not change.startswith(("transition", *by_kind))
    ]
