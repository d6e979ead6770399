"""The verdict on a comparison: of a study with the rig, and of runs with each other."""

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
    why="the order of setups is what a study is for",
    remedy="do not choose by this measure; validate the car and the shocks on records of the rig (eightpost validate)",
)  # fmt: skip
WRONG_LEVEL = Rule(
    "levels otherwise than measured", ABOUT, Grade.NOT_USABLE,
    condition="RMS error of a measure's levels above --level",
    why="it was asked for",
    remedy="use the measure for the order of setups alone, or validate the car on records of the rig",
)  # fmt: skip
PREDICTED = Rule(
    "ranked as measured", ABOUT, Grade.USABLE,
    condition="--rank and --level are kept in every measure",
    why="it was asked for",
    remedy="nothing",
)  # fmt: skip
OLD_RUN = Rule(
    "run without a verdict", "run", Grade.UNKNOWN,
    condition="the result.json of a run that is compared states no verdict: an older version wrote it",
    why="whether the run can be used was not recorded",
    remedy="run it again",
)  # fmt: skip

RULES: tuple[Rule, ...] = (WRONG_RANK, WRONG_LEVEL, PREDICTED, OLD_RUN)


def comparison_verdict(found: Sequence[Comparison], *, rank: float, level: float | None) -> Verdict:
    """Return the verdict on comparisons of a study with the rig.

    Args:
        found: Comparison of each measure.
        rank: Least rank correlation (Spearman).
        level: Largest level error [%]; None where levels do not matter.
    """
    reasons = [reason for one in found for reason in _faults(one, rank, level)]
    if not reasons:
        worst = min(found, key=lambda one: one.spearman)
        levels = "" if level is None else f"; level errors up to {max(one.level_error for one in found):.1f} %"
        figure = f"rank correlation {worst.spearman:.3f} or more; limit {rank:g}{levels}"
        reasons = [PREDICTED.reason("the study ranks setups as the rig does", figure=figure, origin=worst.measure)]
    return Verdict(reasons)


def _faults(one: Comparison, rank: float, level: float | None) -> Iterator[Reason]:
    if not one.spearman >= rank:
        noise = "; run-to-run noise alone could take it so low" if one.spearman >= one.attainable else ""
        figure = f"rank correlation {one.spearman:.3f}; limit {rank:g}{noise}"
        yield WRONG_RANK.reason("the study ranks setups otherwise than the rig", figure=figure, origin=one.measure)
    if level is not None and not one.level_error <= level:
        figure = f"level error {one.level_error:.1f} %; limit {level:g} %"
        yield WRONG_LEVEL.reason("the study's levels are not the rig's", figure=figure, origin=one.measure)


def verdict_of_runs(documents: Mapping[str, Mapping[str, Any]]) -> Verdict:
    """Return the verdict on runs that are compared, from their result.json by folder."""
    return Verdict(
        replace(reason, origin=f"{folder}: {reason.origin}")
        for folder, document in documents.items()
        for reason in _of_run(document).reasons
    )


def _of_run(document: Mapping[str, Any]) -> Verdict:
    try:
        return Verdict.from_json(document.get("verdict"))
    except InputError:
        said = "the run states no verdict"
        return Verdict([OLD_RUN.reason(said, figure="0 reasons stated", origin="result.json")])
