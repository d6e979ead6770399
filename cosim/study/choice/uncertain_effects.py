"""Certainty of a study with an uncertainty file: its entries replace what the models state."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from cosim.study.certainty.assess import Knowledge
from cosim.study.certainty.certainty import Effect, VehicleSource
from cosim.study.certainty.effects import UncertainParameter, effects_of, parameter_values, stated_parameters
from cosim.study.certainty.sources import error_sources
from cosim.study.choice.robust import Draws, Spread, Uncertain
from cosim.study.result import StudyResult
from cosim.study.running.workers import Workers
from eightpost.array_types import Array
from eightpost.errors import InputError
from eightpost.model_uncertainty import ParameterUncertainty
from eightpost.progress import Progress

#: Departure of a parameter's value in the file from that in the study, in standard deviations, that is reported.
_APART = 1.0


def knowledge_of(
    result: StudyResult,
    uncertain: Draws,
    run_to_run: Mapping[str, float],
    folder: str | Path,
    workers: Workers,
    progress: Progress = lambda _done, _all: None,
) -> Knowledge:
    """Return what is known about a study with the entries of an uncertainty file.

    An entry replaces what the build's FMU states about the same parameter; the entry of a fit replaces all of it.
    Equivalent vehicles replace what the vehicle's FMU states; parameters of the vehicle are added to it.

    Args:
        result: Result of the study.
        uncertain: Entries of the file, with the fits' parameters.
        run_to_run: Standard deviation of one rig run by measure, SI.
        folder: Folder of the study.
        workers: Workers that run the setups.
        progress: Called after each part of the runs.
    """
    stated, unstated, notes = stated_parameters(result)
    named = {(part.part, name) for part in uncertain.parts for name in part.names}
    parameters = [one for one in stated if (one.part, one.stated.name) not in named]
    kept = len(parameters)
    for part in uncertain.parts:
        entries = _parameters(part, _values_in_study(result, part))
        notes += tuple(_departures(part, entries))
        parameters += entries
    found = effects_of(result, parameters, folder, workers, progress, vehicles=uncertain.vehicles)
    effects, place = list(found[:kept]), kept
    for part in uncertain.parts:
        effects += _correlated(found[place : place + len(part.names)], part)
        place += len(part.names)
    effects += found[place:]
    car = any(part.part == result.study.vehicle.name for part in uncertain.parts)
    source = VehicleSource.REPLACED if uncertain.vehicles else VehicleSource.ADDED if car else VehicleSource.MODEL
    known = {part.part for part in uncertain.parts}
    left = tuple(build for build in unstated if build not in known)
    return Knowledge(tuple(effects), left, run_to_run, notes=notes, vehicle=source)


def _values_in_study(result: StudyResult, part: Uncertain) -> Mapping[str, float]:
    """Return the values of a part's parameters in the study.

    Raises:
        InputError: The part is neither a build nor the vehicle, or its FMU lacks a parameter.
    """
    study = result.study
    if part.part != study.vehicle.name and part.part not in study.bank:
        raise InputError(
            f"there is no part {part.part!r}; the parts are {', '.join((study.vehicle.name, *study.bank))}"
        )
    made = study.vehicle if part.part == study.vehicle.name else study.bank[part.part]
    found = parameter_values(made.fmu, made.parameters, part.names)
    if missing := [name for name in part.names if name not in found]:
        raise InputError(f"{part.part}: {made.fmu} has no parameter {missing[0]!r}; remove it from the file")
    return found


def _parameters(part: Uncertain, values: Mapping[str, float]) -> list[UncertainParameter]:
    shape = (len(part.names),)
    low, high = (np.broadcast_to(limit, shape).tolist() for limit in (part.lowest, part.highest))
    rows = zip(part.names, part.deviations.tolist(), low, high, strict=True)
    return [
        UncertainParameter(part.part, values[name], ParameterUncertainty(name, deviation, None, *limits), part.left_out)
        for name, deviation, *limits in rows
    ]


def _departures(part: Uncertain, entries: Sequence[UncertainParameter]) -> list[str]:
    return [
        f"{part.part}: the study has {one.stated.name} = {one.value:.4g}, the uncertainty file {value:.4g}; only its "
        "deviation is used"
        for one, value in zip(entries, part.values.tolist(), strict=True)
        if abs(one.value - value) > _APART * one.stated.deviation
    ]


def _correlated(effects: Sequence[Effect], part: Uncertain) -> list[Effect]:
    """Return the effects of independent combinations of correlated parameters."""
    deviations = part.deviations
    scale = np.where(deviations > 0.0, deviations, 1.0)
    correlation = part.covariance / np.outer(scale, scale)
    if np.allclose(correlation, np.diag(correlation.diagonal())) or len(effects) < 2:
        return list(effects)
    variances, axes = np.linalg.eigh(correlation)
    factors = axes * np.sqrt(np.maximum(variances, 0.0))
    name = " and ".join(part.names)
    return [_combined(effects, column, f"{name}, combination {k + 1}") for k, column in enumerate(factors.T)]


def _combined(effects: Sequence[Effect], factors: Array, name: str) -> Effect:
    """Return the weighted sum of effects."""

    def summed(rows: Sequence[Mapping[str, float]]) -> dict[str, float]:
        names = dict.fromkeys(measure for row in rows for measure in row)
        return {m: float(sum(f * row.get(m, 0.0) for f, row in zip(factors, rows, strict=True))) for m in names}

    places = dict.fromkeys((c, b) for one in effects for c, builds in one.changes.items() for b in builds)
    changes: dict[str, dict[str, dict[str, float]]] = {}
    for corner, build in places:
        row = summed([one.changes.get(corner, {}).get(build, {}) for one in effects])
        changes.setdefault(corner, {})[build] = row
    return Effect(effects[0].part, name, 1.0, 0.0, summed([one.shared for one in effects]), changes)


# ---- Check of the linear model by simulated draws -------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class LinearityCheck:
    """Largest difference between the linear effects and simulated draws."""

    measure: str  #: Name of the measure.
    setup: int  #: Number of the setup.
    linear: float  #: Standard deviation of its difference from the leading setup by the linear effects, SI.
    simulated: float  #: The same from simulated draws, SI.
    draws: int  #: Number of draws.

    def summary(self) -> str:
        """Return the check as a sentence."""
        change = 100.0 * (self.linear / self.simulated - 1.0)
        return (
            f"linear effects against {self.draws} simulated draws: the standard deviation of a difference from the "
            f"leading setup differs most for setup {self.setup}, {self.measure}: {change:+.0f} %"
        )


def linearity_check(result: StudyResult, known: Knowledge, spreads: Sequence[Spread]) -> LinearityCheck | None:
    """Return the largest difference between the linear effects and simulated draws; None without draws.

    Setups whose difference varies by less than a tenth of the largest variation are left out: their relative difference
    matters little.

    Args:
        result: Result of the study.
        known: Knowledge with the effects.
        spreads: Simulated draws of the measures of the leading setups.
    """
    sources = error_sources(result, known.effects, vehicle=known.vehicle)
    rows = {int(number): row for row, number in enumerate(result.setups)}
    found = list[LinearityCheck]()
    for spread in spreads:
        if spread.measure not in sources.names or len(spread.draws) < 2 or not np.isfinite(spread.values).any():
            continue
        m, leader = sources.index(spread.measure), int(np.nanargmin(spread.values))
        chosen = np.array([rows[int(number)] for number in spread.setups])
        changes = spread.values[:, None] * sources.by_parameter(chosen, m)
        linear = np.sqrt(np.sum((changes - changes[leader]) ** 2, axis=1))
        simulated = (spread.draws - spread.draws[:, leader : leader + 1]).std(axis=0, ddof=1)
        for k in np.flatnonzero(simulated > 0.1 * np.nanmax(simulated)).tolist():
            setup = int(spread.setups[k])
            found.append(
                LinearityCheck(spread.measure, setup, float(linear[k]), float(simulated[k]), len(spread.draws))
            )
    return max(found, key=lambda one: abs(np.log(max(one.linear, 1e-300) / one.simulated))) if found else None
