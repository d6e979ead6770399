"""Certainty of a study from the sources of its errors and from rig runs."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from threadpoolctl import threadpool_limits

from cosim.study.choice.best import (
    Criterion,
    Drawn,
    candidates,
    draw_choice,
    drawn_levels,
    feasible_probability,
    limits_of,
    tests_of,
)
from cosim.study.choice.certainty import (
    OBJECTIVE,
    PROBABILITIES,
    RUN_TO_RUN,
    TIE,
    Certainty,
    ConfirmedRun,
    Contradiction,
    Contribution,
    Effect,
    Levels,
    Status,
    TradeOff,
    VehicleSource,
    relative_change,
)
from cosim.study.choice.posterior import Observations, Posterior, Surprise, surprises_of
from cosim.study.choice.sources import FILE, OUTPUT, UNKNOWN, ErrorSources, error_sources
from cosim.study.table import StudyResult, error_column
from eightpost.array_types import Array, Flags, Integers

# ---- Contributions to the uncertainty: which are included, which are not, and which are unknown ---------------------


def _contributions_of(
    result: StudyResult,
    sources: ErrorSources,
    effects: Sequence[Effect],
    unstated: Sequence[str],
    chosen: Criterion,
    confirmed: bool,
) -> tuple[Contribution, ...]:
    """Return the contributions to the uncertainty of a criterion.

    Args:
        unstated: Builds whose parameters' uncertainty is not known.
        chosen: Criterion by which setups are ranked.
    """
    found = {
        "vehicle": _vehicle(result, sources, chosen),
        "shock fits": _fits(result, effects, unstated),
        "build to build": _copies(result, effects),
        RUN_TO_RUN: _run_to_run(sources, chosen, confirmed),
        "coupling": _coupling(result, sources, chosen),
    }
    return tuple(Contribution(name, *stated) for name, stated in found.items())


def _vehicle(result: StudyResult, sources: ErrorSources, chosen: Criterion) -> tuple[Status, str]:
    bases = {sources.names[m]: sources.bases[m] for m in chosen.measures.tolist()}
    if names := [name for name, basis in bases.items() if basis == UNKNOWN]:
        return Status.UNKNOWN, (
            f"{result.study.vehicle.fmu.name} does not state the uncertainty of {', '.join(names)}; identify the car "
            "with `eightpost identify`, or rank by the RMS of one of its outputs"
        )
    if FILE in bases.values():
        return Status.INCLUDED, "as the uncertainty file states"
    return Status.INCLUDED, f"as {result.study.vehicle.fmu.name} states for its outputs"


def _fits(result: StudyResult, effects: Sequence[Effect], unstated: Sequence[str]) -> tuple[Status, str]:
    builds = [effect.part for effect in effects if effect.part in result.study.bank and effect.changes]
    if unknown := [build for build in result.study.allowed if build in unstated or build not in builds]:
        text = f"the uncertainty of {', '.join(unknown)} is not known; build the FMU from a file of `eightpost fit`"
        return Status.UNKNOWN, text
    text = f"standard errors of {len(builds)} parameters of {len(set(builds))} builds"
    if alike := {effect.part for effect in effects if effect.correlations}:
        text += f"; the errors of {len(alike)} of them are correlated, because their fits had the same test"
    return Status.INCLUDED, text


def _copies(result: StudyResult, effects: Sequence[Effect]) -> tuple[Status, str]:
    stated = {effect.part for effect in effects if effect.copies > 0.0}
    equal = [build for build in result.study.allowed if build not in stated]
    if not equal:
        return Status.INCLUDED, f"stated for {', '.join(sorted(stated))}"
    whose = f"copies of {', '.join(equal)}" if stated else "all copies of a build"
    return Status.LEFT_OUT, f"{whose} are treated as equal"


def _run_to_run(sources: ErrorSources, chosen: Criterion, confirmed: bool) -> tuple[Status, str]:
    if np.all(np.isfinite(sources.run_to_run[chosen.measures])):
        return Status.INCLUDED, "in rig runs; the true level of a setup does not have it"
    if confirmed:
        return Status.UNKNOWN, "measured levels are treated as exact; test one setup twice, or state run_to_run"
    return Status.LEFT_OUT, "a rig run deviates from the true level by an unknown amount"


def _coupling(result: StudyResult, sources: ErrorSources, chosen: Criterion) -> tuple[Status, str]:
    columns = [error_column(sources.names[m]) for m in chosen.measures.tolist()]
    if all(c in result.table.columns and np.isfinite(result.table[c]).any() for c in columns):
        worst = float(sources.coupling[:, chosen.measures].max(initial=0.0))
        return Status.INCLUDED, f"errors of the coupling of up to {100.0 * worst:.2g} %"
    return Status.LEFT_OUT, "the table does not state the coupling errors of these measures"


# ---- Assessment -----------------------------------------------------------------------------------------------------

#: Number of draws of the criterion, and of the probability of being best by another measure.
DRAWS, _FEWER = 4096, 1024

#: Number k of the best setups, number of next tests, seed of the draws.
TOP, TESTS, SEED = 10, 3, 20260


@dataclass(frozen=True, slots=True)
class Knowledge:
    """What is known about a study beyond its table."""

    effects: tuple[Effect, ...] = ()  #: Effects of uncertain parameters of shocks and vehicle.
    unstated: tuple[str, ...] = ()  #: Builds whose parameters' uncertainty is not known.
    run_to_run: Mapping[str, float] = field(default_factory=dict)  #: Standard deviation of one rig run by measure, SI.
    runs: tuple[ConfirmedRun, ...] = ()  #: Rig runs.
    notes: tuple[str, ...] = ()  #: Sentences about the uncertain parameters.
    vehicle: VehicleSource = VehicleSource.MODEL  #: Origin of the uncertainty of the vehicle.

    @classmethod
    def of(cls, certainty: Certainty) -> Knowledge:
        """Return what a certainty was computed from."""
        noise = {name: one.run_to_run for name, one in certainty.levels.items() if name != OBJECTIVE}
        known = {name: value for name, value in noise.items() if np.isfinite(value)}
        return cls(certainty.effects, certainty.unstated, known, certainty.runs, certainty.notes, certainty.vehicle)


@threadpool_limits.wrap(limits=1, user_api="blas")  # type: ignore[untyped-decorator]  # its matrices are small
def certainty_of(
    result: StudyResult,
    known: Knowledge | None = None,
    *,
    criterion: str | None = None,
    top: int = TOP,
    tests: int = TESTS,
    draws: int = DRAWS,
    seed: int = SEED,
) -> Certainty:
    """Return the certainty of a study.

    Args:
        known: Knowledge beyond its table; None: nothing is known.
        criterion: Measure to rank by; None: the objective, or the first measure if the study has none.
        seed: Seed of the draws; the same seed gives the same result.

    Raises:
        InputError: There is no such measure.
    """
    known = known or Knowledge()
    seen, surprises, posterior = _evidence(result, known)
    sources = posterior.sources
    name = criterion or (OBJECTIVE if result.study.objective else result.measures[0].name)
    feasible = feasible_probability(posterior, limits_of(result), result.done)
    chosen = Criterion.of(result, name)
    drawn, left_out = _drawn(result, posterior, chosen, feasible, top, draws, seed)
    ties = drawn.ties(TIE)
    best, among = (_spread(part, drawn.rows, len(result)) for part in (drawn.probability, drawn.among))
    run_to_run = np.nan_to_num(sources.run_to_run[chosen.measures])  # 0 where it is not known
    return Certainty(
        digest=result.provenance.digest,
        criterion=name,
        top=top,
        setups=result.setups,
        best=best,
        among=among,
        feasible=feasible,
        ties=tuple(int(result.setups[drawn.rows[k]]) for k in ties.tolist()),
        levels=dict(_levels(result, posterior, feasible, chosen, best, min(draws, _FEWER), seed)),
        contributions=_contributions_of(result, sources, known.effects, known.unstated, chosen, bool(known.runs)),
        tests=tests_of(result, drawn, ties, float(np.sum((chosen.weights * run_to_run) ** 2)), tests),
        trade_offs=tuple(_trade_offs(result, posterior, chosen, drawn, ties, min(draws, _FEWER), seed)),
        effects=known.effects,
        runs=known.runs,
        contradictions=tuple(_contradictions(result, known.runs, sources, seen, surprises)),
        draws=drawn.count,
        unstated=known.unstated,
        vehicle=known.vehicle,
        notes=known.notes,
        remarks=tuple(_remarks(posterior, chosen, drawn, left_out)),
    )


def posterior_of(result: StudyResult, known: Knowledge) -> Posterior:
    """Return the errors of a study's setups, given the rig runs so far."""
    return _evidence(result, known)[2]


def _evidence(result: StudyResult, known: Knowledge) -> tuple[Observations, list[Surprise], Posterior]:
    """Return the measured levels, those that are improbable, and the errors given all that are not left out."""
    sources = error_sources(result, known.effects, known.run_to_run, known.vehicle)
    seen = _observations_of(result, sources, known.runs)
    surprises = surprises_of(sources, seen)
    left = [one.position for one in surprises if not one.used]
    return seen, surprises, Posterior(sources, seen.only(np.setdiff1d(np.arange(seen.rows.size), left)))


def _observations_of(result: StudyResult, sources: ErrorSources, runs: Sequence[ConfirmedRun]) -> Observations:
    """Return the measured levels whose uncertainty is known; those of failed setups are left out."""
    rows = dict(zip(result.setups.tolist(), range(len(result)), strict=True))
    found = list[tuple[float, ...]]()
    for k, run in enumerate(runs):
        row = rows[run.setup]
        for name, value in run.values.items():
            m = sources.index(name)
            predicted = float(sources.predicted[row, m])
            if sources.bases[m] != UNKNOWN and predicted > 0.0 and value > 0.0:
                noise = float(np.nan_to_num(sources.run_to_run[m])) / predicted
                found.append((row, m, k, np.log(value / predicted), np.hypot(noise, sources.coupling[row, m])))
    columns = np.array(found).reshape(-1, 5).T
    return Observations(*columns[:3].astype(np.int64), *columns[3:])


def _drawn(
    result: StudyResult, posterior: Posterior, chosen: Criterion, feasible: Array, top: int, draws: int, seed: int
) -> tuple[Drawn, float]:
    rows, left_out = candidates(posterior, chosen, feasible, top)
    if not rows.size:
        empty = np.empty(0, dtype=np.int64)
        return Drawn(rows, np.empty((2, 0)), np.empty(0), 1, np.empty((0, 0)), empty, 1.0), 0.0
    return draw_choice(posterior, chosen, limits_of(result), rows, top=top, count=draws, seed=seed), left_out


def _spread(values: Array, rows: Integers, count: int) -> Array:
    found = np.zeros(count)
    found[rows] = values
    return found


def _levels(
    result: StudyResult, posterior: Posterior, feasible: Array, chosen: Criterion, best: Array, draws: int, seed: int
) -> Iterator[tuple[str, Levels]]:
    sources = posterior.sources
    if result.study.objective:
        criterion = Criterion.of(result, OBJECTIVE)
        yield OBJECTIVE, _objective_levels(result, posterior, criterion, best if chosen.name == OBJECTIVE else None)
    for m, name in enumerate(sources.names):
        if sources.bases[m] == UNKNOWN:
            nothing = np.full(len(result), np.nan)
            unknown = np.full((len(PROBABILITIES), len(result)), np.nan)
            yield name, Levels(sources.predicted[:, m], unknown, nothing, True, UNKNOWN, float(sources.run_to_run[m]))
            continue
        middle, half = posterior.half_widths(PROBABILITIES, sources.only_measure(m))
        own = best
        if chosen.name != name:
            others, _ = _drawn(result, posterior, Criterion.of(result, name), feasible, 1, draws, seed)
            own = _spread(others.probability, others.rows, len(result))
        expected = sources.predicted[:, m] * np.exp(middle)
        yield name, Levels(expected, np.where(result.done, half, np.nan), own, True, sources.bases[m],
                           float(sources.run_to_run[m]))  # fmt: skip


def _objective_levels(result: StudyResult, posterior: Posterior, criterion: Criterion, best: Array | None) -> Levels:
    """Return the levels of the objective; its error is that of its terms, linear in their errors."""
    sources = posterior.sources
    weights = criterion.changes(sources.predicted)
    middle, half = posterior.half_widths(PROBABILITIES, weights)
    known = all(sources.bases[m] != UNKNOWN for m in criterion.measures.tolist())
    expected = criterion.values(sources.predicted) + middle
    noise = float(np.sqrt(np.sum((criterion.weights * sources.run_to_run[criterion.measures]) ** 2)))
    half = np.where(result.done & known, half, np.nan)
    own = np.full(len(result), np.nan) if best is None else best
    return Levels(expected, half, own, False, "terms" if known else UNKNOWN, noise)


def _trade_offs(
    result: StudyResult, posterior: Posterior, chosen: Criterion, drawn: Drawn, ties: Integers, draws: int, seed: int
) -> Iterator[TradeOff]:
    """Yield the levels of the leading setup relative to the baseline, unless it leads itself; the objective is last."""
    sources = posterior.sources
    reference = _reference(result, chosen, sources)
    if reference is None or not ties.size or drawn.rows[ties[0]] == reference:
        return
    rows = np.array([int(drawn.rows[ties[0]]), reference])
    generator = np.random.default_rng(seed + 1)
    groups = [(posterior.draw(s, max(draws // 64, 2), generator)) for s in posterior.scales.groups(64, generator)]
    feasible = result.feasible if result.feasible.any() else result.done
    known: dict[int, Array] = {}
    for m, name in enumerate(sources.names):
        if sources.bases[m] == UNKNOWN:
            continue
        levels = np.concatenate([drawn_levels(posterior, g, rows, m, generator) for g in groups])
        known[m] = levels
        yield _trade_off(name, levels, rows[0], sources.predicted[:, m], feasible)
    if chosen.name == OBJECTIVE and known.keys() >= set(chosen.measures.tolist()):
        terms = zip(chosen.weights.tolist(), chosen.measures.tolist(), strict=True)
        whole = np.asarray(chosen.offset + sum(weight * known[m] for weight, m in terms))
        yield _trade_off(OBJECTIVE, whole, rows[0], chosen.values(sources.predicted), feasible)


def _trade_off(name: str, levels: Array, row: int, predicted: Array, feasible: Flags) -> TradeOff:
    """Return the change of drawn levels (D, 2) from the second setup to the first, which has a row."""
    low, change, high = np.quantile(relative_change(*levels.T), [0.025, 0.5, 0.975])
    lowest = float(relative_change(predicted[row], np.nanmin(predicted[feasible])))
    return TradeOff(name, float(change), float(low), float(high), lowest)


def _reference(result: StudyResult, chosen: Criterion, sources: ErrorSources) -> int | None:
    """Return the row of the baseline, or else of the median setup by the criterion; None if no setup ran."""
    baseline = result.baseline_row
    if baseline is not None and result.done[baseline]:
        return baseline
    rows = np.flatnonzero(result.done)
    if not rows.size:
        return None
    values = chosen.values(sources.predicted)[rows]
    return int(rows[np.argsort(values, kind="stable")[rows.size // 2]])


def _contradictions(
    result: StudyResult,
    runs: Sequence[ConfirmedRun],
    sources: ErrorSources,
    seen: Observations,
    surprises: Sequence[Surprise],
) -> Iterator[Contradiction]:
    """Yield the measured levels that are improbable, most improbable first."""
    for one in sorted(surprises, key=lambda one: one.probability):
        row, m = int(seen.rows[one.position]), int(seen.measures[one.position])
        predicted = float(sources.predicted[row, m])
        measured = predicted * float(np.exp(seen.changes[one.position]))
        file = runs[int(seen.runs[one.position])].file
        yield Contradiction(file, int(result.setups[row]), sources.names[m], predicted, measured, one.probability,
                            one.used)  # fmt: skip


def _remarks(posterior: Posterior, chosen: Criterion, drawn: Drawn, left_out: float) -> Iterator[str]:
    sources = posterior.sources
    for m in np.flatnonzero(sources.shift).tolist():
        change = f"{100.0 * np.expm1(sources.shift[m]):+.2g} %"
        yield f"{sources.names[m]} is corrected by {change}: its error on the vehicle's own tests is significant"
    measures = [m for m in chosen.measures.tolist() if sources.bases[m] == OUTPUT]
    if measures:
        names = ", ".join(sources.names[m] for m in measures)
        yield f"the uncertainty of {names} is that of the RMS of its outputs"
    if left_out > 0.001:
        yield (
            f"{drawn.rows.size} setups are compared; each other one is better than the leading one with a probability "
            f"of at most {left_out:.2g}"
        )
    if drawn.none > 0.01:
        yield f"with a probability of {drawn.none:.0%} none of these setups meets the constraints"
