"""Verdicts on a comparison of a study with the rig and on a comparison of runs."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

from cosim.study.choice.compare import Comparison
from eightpost.errors import InputError
from eightpost.verdict import Grade, Reason, Rule, Verdict

ABOUT = "prediction of the rig"

WRONG_RANK = Rule(
    "setups ranked otherwise than measured", ABOUT, Grade.NOT_USABLE,
    condition="rank correlation (Spearman) of a measure below --rank",
    why="a study is run to rank setups",
    remedy="do not choose by this measure; validate the car and the shocks on rig records (eightpost validate)",
)  # fmt: skip
WRONG_LEVEL = Rule(
    "levels otherwise than measured", ABOUT, Grade.NOT_USABLE,
    condition="RMS error of a measure's levels above --level",
    why="the limits are set by the user",
    remedy="use the measure only to rank setups, or validate the car on rig records",
)  # fmt: skip
PREDICTED = Rule(
    "ranked as measured", ABOUT, Grade.USABLE,
    condition="every measure is within --rank and --level",
    why="the limits are set by the user",
    remedy="nothing",
)  # fmt: skip
OLD_RUN = Rule(
    "run without a verdict", "run", Grade.UNKNOWN,
    condition="the result.json of a compared run contains no verdict, because an older version wrote it",
    why="whether the run can be used was not recorded",
    remedy="run it again",
)  # fmt: skip

RULES: tuple[Rule, ...] = (WRONG_RANK, WRONG_LEVEL, PREDICTED, OLD_RUN)


def comparison_verdict(comparisons: Sequence[Comparison], *, rank: float, level: float | None) -> Verdict:
    """Return the verdict on comparisons of a study with the rig.

    Args:
        comparisons: Comparison of each measure.
        rank: Minimum rank correlation (Spearman).
        level: Maximum level error [%]; None for no limit.
    """
    reasons = [reason for one in comparisons for reason in _faults(one, rank, level)]
    if not reasons:
        worst = min(comparisons, key=lambda one: one.spearman)
        levels = "" if level is None else f"; level errors up to {max(one.level_error for one in comparisons):.1f} %"
        figure = f"rank correlation {worst.spearman:.3f} or more; limit {rank:g}{levels}"
        reasons = [PREDICTED.reason("the study ranks setups as the rig does", figure=figure, origin=worst.measure)]
    return Verdict(reasons)


def _faults(one: Comparison, rank: float, level: float | None) -> Iterator[Reason]:
    if not one.spearman >= rank:
        noise = "; run-to-run noise alone can explain this" if one.spearman >= one.attainable else ""
        figure = f"rank correlation {one.spearman:.3f}; limit {rank:g}{noise}"
        yield WRONG_RANK.reason("the study ranks setups differently than the rig", figure=figure, origin=one.measure)
    if level is not None and not one.level_error <= level:
        figure = f"level error {one.level_error:.1f} %; limit {level:g} %"
        yield WRONG_LEVEL.reason("the study's levels differ from those of the rig", figure=figure, origin=one.measure)


def verdict_of_runs(documents: Mapping[str, Mapping[str, Any]]) -> Verdict:
    """Return the verdict on compared runs, given their result.json by folder."""
    return Verdict(
        replace(reason, origin=f"{folder}: {reason.origin}")
        for folder, document in documents.items()
        for reason in _of_run(document).reasons
    )


def _of_run(document: Mapping[str, Any]) -> Verdict:
    try:
        return Verdict.from_json(document.get("verdict"))
    except InputError:
        statement = "the run has no verdict"
        return Verdict([OLD_RUN.reason(statement, figure="0 reasons stated", origin="result.json")])
