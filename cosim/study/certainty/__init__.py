"""Certainty of a study: intervals of its levels, probability of being best, ties, and the next tests on the rig."""

from cosim.study.certainty.certainty import (
    OBJECTIVE,
    PROBABILITIES,
    Certainty,
    ConfirmedRun,
    Contradiction,
    Contribution,
    Effect,
    Levels,
    NextTest,
    Status,
    TradeOff,
    read_certainty,
    write_certainty,
)

__all__ = [
    "OBJECTIVE",
    "PROBABILITIES",
    "Certainty",
    "ConfirmedRun",
    "Contradiction",
    "Contribution",
    "Effect",
    "Levels",
    "NextTest",
    "Status",
    "TradeOff",
    "read_certainty",
    "write_certainty",
]
