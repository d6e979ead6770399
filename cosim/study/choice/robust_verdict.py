"""Verdict on the choice among the best setups: which differences exceed the stated uncertainty."""

from __future__ import annotations

from cosim.study.choice.robust import REACH, Spread
from eightpost.verdict import Grade, Rule, Verdict

ABOUT = "choice"

#: Contributions that the stated uncertainty does not contain.
_LEFT_OUT = (
    "it excludes errors of the car and of the form of the laws unless vehicles are given, and run-to-run differences "
    "unless run_to_run is given, and it is not corrected for the choice among many setups"
)

LEADS = Rule(
    "one setup leads", ABOUT, Grade.LIMITED,
    condition=f"every other setup is worse by more than {REACH:g} standard deviations of the difference, pair by pair",
    why=f"the uncertainty is that of the uncertainty file: {_LEFT_OUT}",
    remedy="confirm the setup on the rig or on the track, together with the next ones (eightpost select)",
)  # fmt: skip
TIED = Rule(
    "setups tied", ABOUT, Grade.LIMITED,
    condition=f"other setups are within {REACH:g} standard deviations of the difference from the best",
    why=f"the uncertainty is that of the uncertainty file: {_LEFT_OUT}",
    remedy="choose among them by other measures, or test them on the rig (eightpost select)",
)  # fmt: skip

RULES: tuple[Rule, ...] = (LEADS, TIED)


def robust_verdict(spread: Spread, setups: int) -> Verdict:
    """Return the verdict on a spread of the best setups, chosen among all `setups` of the study."""
    group = spread.groups()[0]
    evaluated = f"{spread.setups.size} of {setups} setups evaluated, {len(spread.draws)} draws"
    origin = f"measure {spread.measure}; {_LEFT_OUT}"
    if group.size == 1:
        statement = "one setup is better than the other evaluated ones by more than the stated uncertainty"
        return Verdict([LEADS.reason(statement, figure=evaluated, origin=origin)])
    figure = f"{group.size} setups; {evaluated}"
    return Verdict([TIED.reason("the best setups are tied", figure=figure, origin=origin)])
