"""Verdict on a reproduction: items that agree, that needed a stand-in, that differ."""

from __future__ import annotations

from collections.abc import Iterable

from dissertation.findings import Outcome, State
from eightpost.verdict import Grade, Reason, Rule, Rules, Verdict, listed

_ABOUT = "reproduction"

RULES = Rules()

_DIFFERS = RULES.add("printed value differs", _ABOUT, Grade.NOT_USABLE,
    condition="a value is farther from print than the tolerance in the inventory, or a judged statement does not hold",
    why="the tolerance of a value states what the printed digits, or the stand-in, allow",
    remedy="read the item on the page; the printed values are in dissertation/printed",
)  # fmt: skip
_FAILED = RULES.add("item not computed", _ABOUT, Grade.NOT_USABLE,
    condition="the computation of an item ended with an error",
    why="without a result there is nothing to compare",
    remedy="read the message of the item",
)  # fmt: skip
_STAND_IN = RULES.add("reproduced on the stand-in", _ABOUT, Grade.LIMITED,
    condition="an item is based on measured data that were never published; the virtual rigs replace them",
    why="levels depend on the car and the shocks, so only orders of magnitude and trends are compared",
    remedy="do not compare levels; trends and orders of magnitude can be compared",
)  # fmt: skip
_PARTLY = RULES.add("partly reproduced", _ABOUT, Grade.LIMITED,
    condition="a statement that may depend on the car, the shock or the drive does not hold on the stand-in, or an "
    "item has nothing to judge",
    why="such statements are properties of the dissertation's data, not of its method",
    remedy="read which statements hold; do not expect them of another car",
)  # fmt: skip
_AGREES = RULES.add("reproduced from print", _ABOUT, Grade.USABLE,
    condition="all judged values and statements of an item agree with print",
    why="its equations and parameters are printed",
)  # fmt: skip

_RULE_OF = {
    State.DIFFERS: _DIFFERS,
    State.FAILED: _FAILED,
    State.STAND_IN: _STAND_IN,
    State.PARTLY: _PARTLY,
    State.SHOWN: _PARTLY,
    State.REPRODUCED: _AGREES,
}
_STATEMENTS = {
    State.STAND_IN: "items are reproduced on the stand-in, because the measured data were never published",
    State.PARTLY: "items are partly reproduced on the stand-in: some statements of the text do not hold there",
    State.SHOWN: "items are shown on the stand-in, without anything that agrees or can be judged",
    State.REPRODUCED: "items are reproduced from the printed equations and parameters",
}


def reproduction_verdict(outcomes: Iterable[Outcome]) -> Verdict:
    """Return the verdict on outcomes; items with nothing to compute have no part in it."""
    found = list(outcomes)
    return Verdict(reason for state, rule in _RULE_OF.items() for reason in _reasons(found, state, rule))


def _reasons(found: list[Outcome], state: State, rule: Rule) -> list[Reason]:
    those = [one for one in found if one.state is state]
    if state in (State.DIFFERS, State.FAILED):
        return [
            rule.reason(one.error or one.beyond[0], figure=f"{max(1, len(one.beyond))} found", origin=one.item.label)
            for one in those
        ]
    if not those:
        return []
    names = listed([one.item.label for one in those], most=6)
    return [rule.reason(_STATEMENTS[state], figure=f"{len(those)} of {len(found)} items", origin=names)]
