"""The head of the page: in one sentence, whether the shocks predict the records."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from eightpost.ident.validation.study import Case, ValidationStudy


@dataclass(frozen=True, slots=True)
class Verdict:
    """What the page says first.

    Attributes:
        kind: `good`, `open` or `bad`: its colour.
        answer: In a few words.
        reason: In a sentence.
    """

    kind: str
    answer: str
    reason: str


def verdict(study: ValidationStudy, limit: float | None) -> Verdict:
    """Return the verdict on a study under a limit [percent of standard deviation], if there is one."""
    if not study.is_acceptable(limit):
        return Verdict("bad", "Not acceptable.", _faults(study, limit))
    said = _best(study)
    if any(case.is_fit_record for case in study.cases):
        return Verdict(
            "open", "Partly the fit's own records.", f"Errors on a record of the fit validate nothing. {said}"
        )
    if limit is None:
        return Verdict("open", "No limit was given; judge the errors yourself.", said)
    return Verdict("good", f"Every error is within {limit:g} % of the force's standard deviation.", said)


def _faults(study: ValidationStudy, limit: float | None) -> str:
    over = sum(not case.is_within(limit) for case in study.cases)
    beyond = sum(case.is_mostly_beyond for case in study.cases)
    alone = sum(not study.of_record(record) for record in study.records)
    parts = [
        f"{over} of {len(study.cases)} errors are over the limit of {limit:g} %" if over else "",
        f"{beyond} predictions are mostly outside the fitted velocities" if beyond else "",
        f"{alone} records have no shock of their conditions" if alone else "",
    ]
    return "; ".join(part for part in parts if part) + ". The notes name them."


def _best(study: ValidationStudy) -> str:
    """Return the error of the best shock on the random records, or on all where there are none."""
    judged = [case for case in study.cases if case.outcome.percent is not None and not case.is_fit_record]
    cases = [case for case in judged if case.record.kind == "random"] or judged
    if not cases:
        return ""
    best, worst = min(cases, key=_percent), max(cases, key=_percent)
    if best is worst:
        return f"{best.label} on {best.record.name}: {_percent(best):.2g} %."
    kind = "Random records" if best.record.kind == "random" else "Errors"
    return f"{kind}: from {_percent(best):.2g} % ({_pair(best)}) to {_percent(worst):.2g} % ({_pair(worst)})."


def _pair(case: Case) -> str:
    return f"{case.label} on {case.record.name}"


def _percent(case: Case) -> float:
    return case.outcome.percent or 0.0
