"""The verdict on a study: how much of it ran, how well its setups are known, what its models say of themselves."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import PurePath

import numpy as np

from cosim.study.result import StudyResult
from cosim.validity import MODEL_UNKNOWN
from cosim.verdict import LARGEST_ERROR
from eightpost.errors import InputError
from eightpost.validity import Validity
from eightpost.verdict import Grade, Reason, Rule, Verdict, listed

NOTHING_RAN = Rule(
    "no setup ran", "setups", Grade.NOT_USABLE,
    condition="every setup failed",
    why="there is nothing to rank",
    remedy="read why in the column message of the table",
)  # fmt: skip
NONE_FEASIBLE = Rule(
    "no setup keeps all constraints", "setups", Grade.NOT_USABLE,
    condition="every setup that ran breaks a constraint",
    why="no setup of the study can be chosen",
    remedy="loosen the constraints, or give other builds",
)  # fmt: skip
FAILED = Rule(
    "setups failed", "setups", Grade.LIMITED,
    condition="a setup failed",
    why="the best one may be among them",
    remedy="read why in the column message of the table",
)  # fmt: skip
PARTIAL = Rule(
    "study not complete", "setups", Grade.LIMITED,
    condition="the study was stopped before all setups were run",
    why="levels and ranks are of those that ran",
    remedy="call it again with the same folder",
)  # fmt: skip
MARKED = Rule(
    "setups marked", "marks", Grade.LIMITED,
    condition="a setup is marked: a shock beyond its fitted velocities, a tire off the ground, a coupling error above "
    "the tolerance",
    why="its figures hold less well than those of the others",
    remedy="see the column marks; choose among setups without a mark, or run the marked ones by themselves",
)  # fmt: skip
UNMARKED = Rule(
    "no setup marked", "marks", Grade.USABLE,
    condition="no setup is marked",
    why="all figures hold alike",
    remedy="nothing",
)  # fmt: skip
LARGE_ERROR = Rule(
    "coupling error of a setup too large", "coupling", Grade.NOT_USABLE,
    condition=f"the coupling error of the best setup is above {LARGEST_ERROR:g} %",
    why="as in a run",
    remedy="ask for a smaller error (accuracy in the study file)",
)  # fmt: skip
NOTABLE_ERROR = Rule(
    "coupling error of a setup above the tolerance", "coupling", Grade.LIMITED,
    condition="the coupling error of a setup is above what was asked for",
    why="such a setup is told from others less well than was asked for",
    remedy="run these setups by themselves (eightpost run), or ask for a smaller error (accuracy in the study file)",
)  # fmt: skip
UNKNOWN_ERROR = Rule(
    "coupling error of setups not stated", "coupling", Grade.UNKNOWN,
    condition="no setup states a coupling error",
    why="differences between setups may be those of the coupling",
    remedy="run the study again with this version",
)  # fmt: skip
SMALL_ERROR = Rule(
    "coupling errors of all setups small", "coupling", Grade.USABLE,
    condition="the coupling error of every setup is within what was asked for",
    why="setups differ by more",
    remedy="nothing",
)  # fmt: skip
NO_MEANS = Rule(
    "means not trusted", "vehicle", Grade.LIMITED,
    condition="the study file says that the vehicle's response to constant inputs is not to be trusted",
    why="levels that hang on a mean are left out",
    remedy="judge setups by the other measures",
)  # fmt: skip

RULES: tuple[Rule, ...] = tuple(
    value for value in list(globals().values()) if isinstance(value, Rule) and value is not MODEL_UNKNOWN
)


def study_verdict(result: StudyResult) -> Verdict:
    """Return the verdict on a study."""
    return Verdict((*_setups(result), *_marks(result), *_coupling(result), *_models(result)))


def _setups(result: StudyResult) -> Iterator[Reason]:
    count, failed = len(result), int(np.sum(~result.done))
    if failed == count:
        yield NOTHING_RAN.reason("no setup ran", figure=f"0 of {count} setups", origin="the table")
    elif not result.feasible.any():
        figure = f"0 of {count - failed} setups that ran"
        yield NONE_FEASIBLE.reason("no setup keeps all constraints", figure=figure, origin="the constraints")
    if 0 < failed < count:
        names = listed(str(number) for number in result.setups[~result.done].tolist())
        yield FAILED.reason("setups failed", figure=f"{failed} of {count} setups", origin=f"setups {names}")
    if result.partial:
        figure = f"{count} of {len(result.study.space)} setups were run"
        yield PARTIAL.reason("the study is not complete", figure=figure, origin="the study was stopped")
    if not result.study.vehicle.means_trusted:
        yield NO_MEANS.reason("means are not trusted", figure="0 measures of means", origin=result.study.vehicle.name)


def _marks(result: StudyResult) -> Iterator[Reason]:
    marked = np.array([bool(text) for text in result.table["marks"].to_pylist()], dtype=np.bool_) & result.done
    if not marked.any():
        yield UNMARKED.reason("no setup is marked", figure=f"0 of {len(result)} setups", origin="column marks")
        return
    ranking = result.ranking()
    best = ", the best among them" if ranking.size and marked[ranking[0]] else ""
    names = listed(str(number) for number in result.setups[marked].tolist())
    figure = f"{int(marked.sum())} of {len(result)} setups{best}"
    yield MARKED.reason("setups are marked", figure=figure, origin=f"setups {names}")


def _coupling(result: StudyResult) -> Iterator[Reason]:
    asked = result.study.accuracy
    rows = np.flatnonzero(result.feasible if result.feasible.any() else result.done)
    known = result.table["coupling_error_percent"].to_numpy(zero_copy_only=False).astype(np.float64)[rows]
    errors, numbers = known[np.isfinite(known)], result.setups[rows][np.isfinite(known)]
    if not errors.size:
        figure = f"known for 0 of {len(result)} setups"
        yield UNKNOWN_ERROR.reason("no coupling error is stated", figure=figure, origin="column coupling_error_percent")
        return
    worst, best = int(np.argmax(errors)), result.ranking()[:1]
    at_best = errors[np.isin(numbers, result.setups[best])] if best.size else errors
    above = int(np.sum(errors > asked))
    figure = f"up to {errors[worst]:.2g} %; asked for {asked:g} %; {above} of {errors.size} setups are above"
    rule = SMALL_ERROR if not above else LARGE_ERROR if at_best.max(initial=0.0) > LARGEST_ERROR else NOTABLE_ERROR
    said = "coupling errors are small" if rule is SMALL_ERROR else "a coupling error is larger than asked for"
    yield rule.reason(said, figure=figure, origin=f"setup {numbers[worst]}")


def _models(result: StudyResult) -> Iterator[Reason]:
    """Yield what the models of a study say of themselves."""
    for file, document in result.provenance.models.items():
        name = PurePath(file).name
        try:
            validity = Validity.from_json(document)
        except InputError:
            said = "how far the model can be used is not known to this program"
            yield MODEL_UNKNOWN.reason(said, figure="0 ranges stated", origin=name)
            continue
        yield from (replace(reason, origin=f"{name}: {reason.origin}") for reason in validity.verdict.reasons)
