"""Contributions to the uncertainty of a study: which are included, which are not, and which are unknown."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cosim.study.certainty.certainty import RUN_TO_RUN, Contribution, Effect, Status
from cosim.study.certainty.choice import Criterion
from cosim.study.certainty.sources import ErrorSources
from cosim.study.certainty.vehicle_errors import FILE, UNKNOWN
from cosim.study.columns import error_column
from cosim.study.result import StudyResult


def contributions_of(
    result: StudyResult,
    sources: ErrorSources,
    effects: Sequence[Effect],
    unstated: Sequence[str],
    chosen: Criterion,
    confirmed: bool,
) -> tuple[Contribution, ...]:
    """Return the contributions to the uncertainty of a criterion.

    Args:
        result: Result of the study.
        sources: Sources of the errors.
        effects: Effects of uncertain parameters.
        unstated: Builds whose parameters' uncertainty is not known.
        chosen: Criterion by which setups are ranked.
        confirmed: Whether rig runs are taken into account.
    """
    return (
        _vehicle(result, sources, chosen),
        _fits(result, effects, unstated),
        _copies(result, effects),
        _run_to_run(sources, chosen, confirmed),
        _coupling(result, sources, chosen),
    )


def _vehicle(result: StudyResult, sources: ErrorSources, chosen: Criterion) -> Contribution:
    names = [sources.names[m] for m in chosen.measures.tolist() if sources.bases[m] == UNKNOWN]
    if not names and FILE in [sources.bases[m] for m in chosen.measures.tolist()]:
        return Contribution("vehicle", Status.INCLUDED, "as the uncertainty file states")
    if not names:
        text = f"as {result.study.vehicle.fmu.name} states for its outputs"
        return Contribution("vehicle", Status.INCLUDED, text)
    text = (
        f"{result.study.vehicle.fmu.name} does not state the uncertainty of {', '.join(names)}; identify the car with "
        "`eightpost identify --recipe common-poles`, or rank by the RMS of one of its outputs"
    )
    return Contribution("vehicle", Status.UNKNOWN, text)


def _allowed(result: StudyResult) -> tuple[str, ...]:
    """Return the builds that a corner of the study allows."""
    return tuple(dict.fromkeys(build for builds in result.study.corners.values() for build in builds))


def _fits(result: StudyResult, effects: Sequence[Effect], unstated: Sequence[str]) -> Contribution:
    name = "shock fits"
    builds = [effect.part for effect in effects if effect.part in result.study.bank and effect.changes]
    unknown = [build for build in _allowed(result) if build in unstated or build not in builds]
    if unknown:
        text = f"the uncertainty of {', '.join(unknown)} is not known; build the FMU from a file of `eightpost fit`"
        return Contribution(name, Status.UNKNOWN, text)
    text = f"standard errors of {len(builds)} parameters of {len(set(builds))} builds"
    alike = {effect.part for effect in effects if effect.correlations}
    if alike:
        text += f"; the errors of {len(alike)} of them are correlated, because their fits had the same test"
    return Contribution(name, Status.INCLUDED, text)


def _copies(result: StudyResult, effects: Sequence[Effect]) -> Contribution:
    name, stated = "build to build", {effect.part for effect in effects if effect.copies > 0.0}
    equal = [build for build in _allowed(result) if build not in stated]
    if not equal:
        return Contribution(name, Status.INCLUDED, f"stated for {', '.join(sorted(stated))}")
    whose = f"copies of {', '.join(equal)}" if stated else "all copies of a build"
    return Contribution(name, Status.LEFT_OUT, f"{whose} are treated as equal")


def _run_to_run(sources: ErrorSources, chosen: Criterion, confirmed: bool) -> Contribution:
    name = RUN_TO_RUN
    if np.all(np.isfinite(sources.run_to_run[chosen.measures])):
        return Contribution(name, Status.INCLUDED, "in rig runs; the true level of a setup does not have it")
    if confirmed:
        text = "measured levels are treated as exact; test one setup twice, or state run_to_run"
        return Contribution(name, Status.UNKNOWN, text)
    return Contribution(name, Status.LEFT_OUT, "a rig run deviates from the true level by an unknown amount")


def _coupling(result: StudyResult, sources: ErrorSources, chosen: Criterion) -> Contribution:
    name = "coupling"
    columns = [error_column(sources.names[m]) for m in chosen.measures.tolist()]
    if all(c in result.table.column_names and result.table[c].null_count < len(result) for c in columns):
        worst = float(sources.coupling[:, chosen.measures].max(initial=0.0))
        return Contribution(name, Status.INCLUDED, f"errors of the coupling of up to {100.0 * worst:.2g} %")
    return Contribution(name, Status.LEFT_OUT, "the table does not state the coupling errors of these measures")
