"""Verdict on a reproduction: items that agree, that needed a stand-in, that differ."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from dissertation.findings import Outcome, State
from eightpost.verdict import Reason, Rules, Verdict, listed

_ABOUT = "reproduction"

RULES = Rules.read(Path(__file__).with_suffix(".txt"), _ABOUT)


_RULE_OF = {
    State.DIFFERS: "printed value differs",
    State.FAILED: "item not computed",
    State.STAND_IN: "reproduced on the stand-in",
    State.PARTLY: "partly reproduced",
    State.SHOWN: "partly reproduced",
    State.REPRODUCED: "reproduced from print",
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


def _reasons(found: list[Outcome], state: State, rule: str) -> list[Reason]:
    those = [one for one in found if one.state is state]
    if state in (State.DIFFERS, State.FAILED):
        return [
            RULES.reason(
                rule, one.error or one.beyond[0], figure=f"{max(1, len(one.beyond))} found", origin=one.item.label
            )
            for one in those
        ]
    if not those:
        return []
    names = listed([one.item.label for one in those], most=6)
    return [RULES.reason(rule, _STATEMENTS[state], figure=f"{len(those)} of {len(found)} items", origin=names)]
