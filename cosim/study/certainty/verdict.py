"""Reasons of a study's verdict that concern the certainty of the choice."""

from __future__ import annotations

from collections.abc import Iterator

from cosim.study.certainty.certainty import TIE, Certainty, Status
from cosim.study.certainty.summary import percent
from eightpost.verdict import Grade, Reason, Rules, listed

ABOUT = "choice"

RULES = Rules()

ONE_BEST = RULES.add("one setup is the best", ABOUT, Grade.USABLE,
    condition=f"one setup is the best with a probability of {100 * TIE:g} % or more, and no contribution to the "
    "uncertainty is unknown or not included",
    why="the probability contains the choice among all setups of the study",
    remedy="nothing; confirm it on the rig (eightpost confirm)",
)  # fmt: skip
BEST_BY_PART = RULES.add("one setup is the best by a part of the uncertainty", ABOUT, Grade.LIMITED,
    condition=f"one setup is the best with a probability of {100 * TIE:g} % or more, but a contribution to the "
    "uncertainty is not included",
    why="with the missing contribution, other setups may be as good",
    remedy="state it, e.g. fit several builds of a shock together (eightpost fit), or confirm the setup on the rig",
)  # fmt: skip
TIED = RULES.add("setups tied", ABOUT, Grade.LIMITED,
    condition=f"no single setup is the best with a probability of {100 * TIE:g} %",
    why="the study does not tell which of the tied setups is the best",
    remedy="choose among the ties by other measures, or test the proposed setups (eightpost confirm)",
)  # fmt: skip
UNKNOWN = RULES.add("uncertainty of the choice unknown", ABOUT, Grade.UNKNOWN,
    condition="a contribution to the uncertainty is unknown: of the vehicle, of a shock, or of rig runs",
    why="stated probabilities contain the known contributions only, so that they are too extreme",
    remedy="see the contributions: identify the car, fit the shocks, or state the uncertainty (eightpost robust)",
)  # fmt: skip
NOT_ASSESSED = RULES.add("certainty not computed", ABOUT, Grade.UNKNOWN,
    condition="the study has no certainty: it was switched off, or the study is of an older version",
    why="differences between the best setups may be smaller than their uncertainty",
    remedy="run `eightpost study` with the same folder, without --no-certainty; completed runs are not repeated",
)  # fmt: skip
CONTRADICTED = RULES.add("rig runs contradict the prediction", "rig runs", Grade.LIMITED,
    condition="a measured level is improbable, given the prediction, its uncertainty and the other rig runs",
    why="the record, or the model, has an error that the stated uncertainty does not contain",
    remedy="check the record (setup, shocks, drive file, units); if it is right, identify the car again",
)  # fmt: skip


def certainty_reasons(certainty: Certainty | None) -> Iterator[Reason]:
    """Yield the reasons of a certainty; None if it was not computed."""
    if certainty is None:
        yield NOT_ASSESSED.reason("it is not known how sure the choice is", figure="0 draws", origin="the folder")
        return
    if certainty.leader is None:
        return  # no setup is feasible, which is a reason of its own
    chance = certainty.probability(certainty.leader)
    figure = f"setup {certainty.leader} {chance:.0%}; limit {TIE:.0%}; {len(certainty.ties)} setups tied"
    origin = f"{certainty.criterion}; {certainty.draws} draws"
    if len(certainty.ties) > 1:
        yield TIED.reason("several setups may be the best", figure=figure, origin=origin)
    elif certainty.is_known and certainty.left_out:
        names = listed(one.name for one in certainty.left_out)
        figure = f"{figure}; not included: {names}"
        yield BEST_BY_PART.reason("one setup is the best by the included contributions", figure=figure, origin=origin)
    elif certainty.is_known:
        yield ONE_BEST.reason("one setup is the best", figure=figure, origin=origin)
    for one in certainty.contributions:
        if one.status is Status.UNKNOWN:
            figure = f"{one.name}: {one.text}"
            yield UNKNOWN.reason("a contribution to the uncertainty is unknown", figure=figure, origin=origin)
    if certainty.contradictions:
        worst = min(certainty.contradictions, key=lambda one: one.probability)
        change = 100.0 * (worst.measured / worst.predicted - 1.0)
        figure = f"{worst.measure} {change:+.2g} % from the prediction, probability {percent(worst.probability)}"
        names = listed(one.file for one in certainty.contradictions)
        yield CONTRADICTED.reason("a record contradicts the prediction", figure=figure, origin=names)
