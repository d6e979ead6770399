"""The verdict on the choice among the best setups: what differs by more than the uncertainty that was stated."""

from __future__ import annotations

from cosim.study.choice.robust import REACH, Spread
from eightpost.verdict import Grade, Rule, Verdict

ABOUT = "choice"

#: What the stated uncertainty never holds, in words.
_LEFT_OUT = (
    "errors of the car and of the form of the laws are not in it unless vehicles are named, run-to-run differences "
    "only where run_to_run is, and it is not corrected for the choice among many setups"
)

LEADS = Rule(
    "one setup leads", ABOUT, Grade.LIMITED,
    condition=f"every other setup is worse by more than {REACH:g} standard deviations of the difference, pair by pair",
    why=f"the uncertainty is that which the file states: {_LEFT_OUT}",
    remedy="confirm the setup on the rig or on the track, beside the next ones (eightpost select)",
)  # fmt: skip
TIED = Rule(
    "setups not told apart", ABOUT, Grade.LIMITED,
    condition=f"other setups are within {REACH:g} standard deviations of the difference from the best",
    why=f"the uncertainty is that which the file states: {_LEFT_OUT}",
    remedy="choose among them by other measures, or measure them (eightpost select)",
)  # fmt: skip

RULES: tuple[Rule, ...] = (LEADS, TIED)


def robust_verdict(spread: Spread, setups: int) -> Verdict:
    """Return the verdict on a spread of the best setups, chosen among all `setups` of the study."""
    group = spread.groups()[0]
    looked = f"{spread.setups.size} of {setups} setups looked at, {len(spread.draws)} draws"
    origin = f"measure {spread.measure}; {_LEFT_OUT}"
    if group.size == 1:
        said = "one setup is better than the others looked at, within the stated uncertainty"
        return Verdict([LEADS.reason(said, figure=looked, origin=origin)])
    figure = f"{group.size} setups; {looked}"
    return Verdict([TIED.reason("the best setups are not told apart", figure=figure, origin=origin)])
