"""Verdict on a study: how much of it ran, how precise its values are, and what its models state of their validity."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import PurePath

import numpy as np

from cosim.session.verdict import LARGEST_ERROR, MODEL_UNKNOWN, NOTABLE_POWER
from cosim.study.choice.certainty import Certainty, certainty_reasons
from cosim.study.table import StudyResult
from eightpost.errors import InputError
from eightpost.validity import Validity
from eightpost.verdict import Grade, Reason, Rules, Verdict, listed

RULES = Rules()

NOTHING_RAN = RULES.add("no setup ran", "setups", Grade.NOT_USABLE,
    condition="every setup failed",
    why="there is nothing to rank",
    remedy="see the reason in the column message of the table",
)  # fmt: skip
NONE_FEASIBLE = RULES.add("no setup keeps all constraints", "setups", Grade.NOT_USABLE,
    condition="every setup that ran breaks a constraint",
    why="no setup of the study can be chosen",
    remedy="relax the constraints, or allow other builds",
)  # fmt: skip
FAILED = RULES.add("setups failed", "setups", Grade.LIMITED,
    condition="a setup failed",
    why="the best setup may be among them",
    remedy="see the reason in the column message of the table",
)  # fmt: skip
PARTIAL = RULES.add("study not complete", "setups", Grade.LIMITED,
    condition="the study was stopped before all setups had run",
    why="levels and ranks cover only the setups that ran",
    remedy="run it again with the same output folder; it resumes where it stopped",
)  # fmt: skip
MARKED = RULES.add("setups marked", "marks", Grade.LIMITED,
    condition="a setup is marked: a shock beyond its fitted velocities, a tire off the ground, a coupling error above "
    "the tolerance",
    why="its values are less reliable than those of the others",
    remedy="see the column marks; choose among setups without a mark, or run the marked ones separately",
)  # fmt: skip
UNMARKED = RULES.add("no setup marked", "marks", Grade.USABLE,
    condition="no setup is marked",
    why="no setup has one of the defects that a mark states; other errors are judged by the other rules",
)  # fmt: skip
LARGE_ERROR = RULES.add("coupling error of a setup too large", "coupling", Grade.NOT_USABLE,
    condition=f"the coupling error of the best setup is above {LARGEST_ERROR:g} %",
    why="the same limit applies to a single run",
    remedy="set a smaller accuracy in the study file",
)  # fmt: skip
NOTABLE_ERROR = RULES.add("coupling error of a setup above the tolerance", "coupling", Grade.LIMITED,
    condition="the coupling error of a setup is above the accuracy of the study file",
    why="differences between this setup and others are less certain than requested",
    remedy="run these setups separately (eightpost run), or set a smaller accuracy in the study file",
)  # fmt: skip
UNKNOWN_ERROR = RULES.add("coupling error of setups not stated", "coupling", Grade.UNKNOWN,
    condition="no setup, or not the best one, has a coupling error in the table",
    why="differences between setups may be due to the coupling",
    remedy="run the study again with this version; run the best setup separately (eightpost run)",
)  # fmt: skip
SMALL_ERROR = RULES.add("coupling errors of all setups small", "coupling", Grade.USABLE,
    condition="the coupling error of every setup is within the accuracy of the study file",
    why="the differences between setups are larger",
)  # fmt: skip
NO_MEANS = RULES.add("means not trusted", "vehicle", Grade.LIMITED,
    condition="the vehicle's response to constant inputs is not trusted (means in the study file)",
    why="measures that depend on a mean are omitted",
    remedy="compare setups by the other measures",
)  # fmt: skip
ABOVE_BAND = RULES.add("measures above the identified band", "band of the vehicle", Grade.LIMITED,
    condition=f"more than {100 * NOTABLE_POWER:g} % of a measure's power is above the frequencies for which the "
    "vehicle was identified, in the run of the baseline or else of the first setup",
    why="there, the vehicle is an extrapolation, and the study ranks setups by it",
    remedy="end the measure's band there (band in the study file), or identify from tests with more power above",
)  # fmt: skip
WITHIN_BAND = RULES.add("measures within the identified band", "band of the vehicle", Grade.USABLE,
    condition="the power of every measure above these frequencies is within that limit",
    why="the ranking depends on the identified band",
)  # fmt: skip


def study_verdict(result: StudyResult, certainty: Certainty | None = None) -> Verdict:
    """Return the verdict on a study.

    Args:
        certainty: Certainty of the choice; None if it was not computed, so that it is unknown.
    """
    own = (*_marks(result), *_coupling(result), *_band(result), *_means(result), *_models(result))
    return Verdict((*_setups(result), *certainty_reasons(certainty), *own))


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


def _means(result: StudyResult) -> Iterator[Reason]:
    if not result.study.vehicle.means_trusted:
        statement, figure = "measures that depend on a mean are omitted", "the study file does not trust means"
        yield NO_MEANS.reason(statement, figure=figure, origin=result.study.vehicle.name)


def _marks(result: StudyResult) -> Iterator[Reason]:
    marked = result.is_marked & result.done
    if not marked.any():
        yield UNMARKED.reason("no setup is marked", figure=f"0 of {len(result)} setups", origin="column marks")
        return
    ranking = result.ranking()
    best = ", the best among them" if ranking.size and marked[ranking[0]] else ""
    names = listed(str(number) for number in result.setups[marked].tolist())
    figure = f"{int(marked.sum())} of {len(result)} setups{best}"
    yield MARKED.reason("setups are marked", figure=figure, origin=f"setups {names}")


def _coupling(result: StudyResult) -> Iterator[Reason]:
    accuracy = result.study.accuracy
    rows = np.flatnonzero(result.feasible if result.feasible.any() else result.done)
    known = result.table["coupling_error_percent"].to_numpy(zero_copy_only=False).astype(np.float64)[rows]
    errors, numbers = known[np.isfinite(known)], result.setups[rows][np.isfinite(known)]
    if not errors.size:
        figure = f"known for 0 of {len(result)} setups"
        yield UNKNOWN_ERROR.reason("no coupling error is known", figure=figure, origin="column coupling_error_percent")
        return
    worst, best = int(np.argmax(errors)), result.ranking()[:1]
    if best.size and result.setups[best[0]] not in numbers:
        figure = f"known for {errors.size} of {rows.size} setups"
        yield UNKNOWN_ERROR.reason(
            "the coupling error of the best setup is not known", figure=figure, origin=f"setup {result.setups[best[0]]}"
        )
        return
    at_best = errors[np.isin(numbers, result.setups[best])] if best.size else errors
    above = int(np.sum(errors > accuracy))
    figure = f"up to {errors[worst]:.2g} %; target {accuracy:g} %; {above} of {errors.size} setups are above it"
    rule = SMALL_ERROR if not above else LARGE_ERROR if at_best.max(initial=0.0) > LARGEST_ERROR else NOTABLE_ERROR
    statement = "coupling errors are small" if rule is SMALL_ERROR else "a coupling error is above the target"
    yield rule.reason(statement, figure=figure, origin=f"setup {numbers[worst]}")


def _band(result: StudyResult) -> Iterator[Reason]:
    """Yield which measures depend on frequencies above the band in which the vehicle was identified."""
    shares = result.provenance.above_band
    if not shares:
        return
    above = {name: one for name, one in shares.items() if one.share > NOTABLE_POWER}
    listed_ones = above or dict([max(shares.items(), key=lambda pair: pair[1].share)])
    figure = ", ".join(f"{name} {one.share:.0%} above {one.high:.3g} Hz" for name, one in listed_ones.items())
    rule = ABOVE_BAND if above else WITHIN_BAND
    statement = "the study ranks what lies above the identified band" if above else "measures lie within the band"
    origin = f"{len(above)} of {len(shares)} measures of {result.study.vehicle.name}"
    yield rule.reason(statement, figure=f"{figure}; limit {NOTABLE_POWER:.0%} of the power", origin=origin)


def _models(result: StudyResult) -> Iterator[Reason]:
    """Yield the reasons that the models of a study state about their own validity."""
    for file, document in result.provenance.models.items():
        name = PurePath(file).name
        try:
            validity = Validity.from_json(document)
        except InputError:
            statement = "the validity of the model is not known to this program"
            yield MODEL_UNKNOWN.reason(statement, figure="0 ranges stated", origin=name)
            continue
        yield from (replace(reason, origin=f"{name}: {reason.origin}") for reason in validity.verdict.reasons)
