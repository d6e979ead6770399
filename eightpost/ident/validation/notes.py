"""What a person should know of a validation before believing it, a sentence each."""

from __future__ import annotations

from typing import TYPE_CHECKING

from eightpost.ident.validation.static import SETTLING, StaticValidation
from eightpost.ident.validation.verdict import prediction_of

if TYPE_CHECKING:
    from eightpost.ident.validation.study import Case, ValidationStudy


def notes_on(study: ValidationStudy) -> tuple[str, ...]:
    """Return how records were treated, and which shocks were held against none; the rest is in the verdict."""
    treated = dict.fromkeys(note for case in study.cases for note in _changes(case))
    return (*treated, *study.unpaired)


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
