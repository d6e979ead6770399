"""Verdict on a study: how much of it ran, how precise its values are, and what its models state of their validity."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path, PurePath

import numpy as np

from cosim.session.verdict import LARGEST_ERROR, NOTABLE_POWER
from cosim.session.verdict import RULES as RUN_RULES
from cosim.study.choice.certainty import Certainty, certainty_reasons
from cosim.study.table import StudyResult
from eightpost.errors import InputError
from eightpost.validity import Validity
from eightpost.verdict import Reason, Rules, Verdict, listed

RULES = Rules.read(Path(__file__).with_suffix(".txt"), largest_error=LARGEST_ERROR, notable_power=100 * NOTABLE_POWER)


#: Reasons as rows: rule, statement, figure, origin.
_Rows = Iterator[tuple[str, str, str, str]]


def study_verdict(result: StudyResult, certainty: Certainty | None = None) -> Verdict:
    """Return the verdict on a study.

    Args:
        certainty: Certainty of the choice; None if it was not computed, so that it is unknown.
    """
    setups = [RULES.reason(*row) for row in _setups(result)]
    others = [RULES.reason(*row) for row in (*_marks(result), *_coupling(result), *_band(result))]
    if not result.study.vehicle.means_trusted:
        statement, figure = "measures that depend on a mean are omitted", "the study file does not trust means"
        others.append(RULES.reason("means not trusted", statement, figure, origin=result.study.vehicle.name))
    return Verdict((*setups, *certainty_reasons(certainty), *others, *_models(result)))


def _setups(result: StudyResult) -> _Rows:
    count, failed = len(result), int(np.sum(~result.done))
    if failed == count:
        yield "no setup ran", "no setup ran", f"0 of {count} setups", "the table"
    elif not result.feasible.any():
        rule, figure = "no setup keeps all constraints", f"0 of {count - failed} setups that ran"
        yield rule, "no setup keeps all constraints", figure, "the constraints"
    if 0 < failed < count:
        names = listed(str(number) for number in result.setups[~result.done].tolist())
        yield "setups failed", "setups failed", f"{failed} of {count} setups", f"setups {names}"
    if result.partial:
        figure = f"{count} of {len(result.study.space)} setups were run"
        yield "study not complete", "the study is not complete", figure, "the study was stopped"


def _marks(result: StudyResult) -> _Rows:
    marked = result.is_marked & result.done
    if not marked.any():
        yield "no setup marked", "no setup is marked", f"0 of {len(result)} setups", "column marks"
        return
    ranking = result.ranking()
    best = ", the best among them" if ranking.size and marked[ranking[0]] else ""
    names = listed(str(number) for number in result.setups[marked].tolist())
    figure = f"{int(marked.sum())} of {len(result)} setups{best}"
    yield "setups marked", "setups are marked", figure, f"setups {names}"


def _coupling(result: StudyResult) -> _Rows:
    accuracy = result.study.accuracy
    rows = np.flatnonzero(result.feasible if result.feasible.any() else result.done)
    known = result.column("coupling_error_percent")[rows]
    errors, numbers = known[np.isfinite(known)], result.setups[rows][np.isfinite(known)]
    if not errors.size:
        figure, origin = f"known for 0 of {len(result)} setups", "column coupling_error_percent"
        yield "coupling error of setups not stated", "no coupling error is known", figure, origin
        return
    worst, best = int(np.argmax(errors)), result.ranking()[:1]
    if best.size and result.setups[best[0]] not in numbers:
        statement = "the coupling error of the best setup is not known"
        figure, origin = f"known for {errors.size} of {rows.size} setups", f"setup {result.setups[best[0]]}"
        yield "coupling error of setups not stated", statement, figure, origin
        return
    at_best = errors[np.isin(numbers, result.setups[best])] if best.size else errors
    above = int(np.sum(errors > accuracy))
    figure = f"up to {errors[worst]:.2g} %; target {accuracy:g} %; {above} of {errors.size} setups are above it"
    if not above:
        rule, statement = "coupling errors of all setups small", "coupling errors are small"
    else:
        rule, statement = "coupling error of a setup above the tolerance", "a coupling error is above the target"
        if at_best.max(initial=0.0) > LARGEST_ERROR:
            rule = "coupling error of a setup too large"
    yield rule, statement, figure, f"setup {numbers[worst]}"


def _band(result: StudyResult) -> _Rows:
    """Yield which measures depend on frequencies above the band in which the vehicle was identified."""
    shares = result.provenance.above_band
    if not shares:
        return
    above = {name: one for name, one in shares.items() if one.share > NOTABLE_POWER}
    listed_ones = above or dict([max(shares.items(), key=lambda pair: pair[1].share)])
    figure = ", ".join(f"{name} {one.share:.0%} above {one.high:.3g} Hz" for name, one in listed_ones.items())
    rule = "measures above the identified band" if above else "measures within the identified band"
    statement = "the study ranks what lies above the identified band" if above else "measures lie within the band"
    origin = f"{len(above)} of {len(shares)} measures of {result.study.vehicle.name}"
    yield rule, statement, f"{figure}; limit {NOTABLE_POWER:.0%} of the power", origin


def _models(result: StudyResult) -> Iterator[Reason]:
    """Yield the reasons that the models of a study state about their own validity."""
    for file, document in result.provenance.models.items():
        name = PurePath(file).name
        try:
            validity = Validity.from_json(document)
        except InputError:
            statement = "the validity of the model is not known to this program"
            yield RUN_RULES.reason("validity of a model unknown", statement, figure="0 ranges stated", origin=name)
            continue
        yield from (replace(reason, origin=f"{name}: {reason.origin}") for reason in validity.verdict.reasons)
