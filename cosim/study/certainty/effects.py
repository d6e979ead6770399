"""Effects of uncertain parameters on the measures, from runs with one changed parameter at a time."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from math import inf
from pathlib import Path

import numpy as np

from cosim.components.fmu_component import FmuComponent
from cosim.study.certainty.certainty import Effect
from cosim.study.certainty.sources import stated_uncertainty
from cosim.study.result import StudyResult
from cosim.study.running.evaluator import coupling_of
from cosim.study.running.sweep import Requested
from cosim.study.running.workers import Workers
from cosim.study.study import Study
from eightpost.progress import Progress
from eightpost.uncertainty import FittedParameter, LeftOutBlocks, correlation_of
from eightpost.validity import ModelUncertainty, ParameterUncertainty

#: Decimal places of correlations.
_PLACES = 4

#: Mark of a changed build in the names of the bank.
_CHANGED = " with another "


@dataclass(frozen=True, slots=True)
class UncertainParameter:
    """An uncertain parameter of a build or of the vehicle."""

    part: str  #: Name of the build, or of the vehicle's component.
    value: float  #: Value in the study.
    stated: ParameterUncertainty  #: Uncertainty of the parameter.
    #: Changes of the build's fit when blocks of its test are left out; None if they are not known.
    left_out: LeftOutBlocks | None = None

    @property
    def changed(self) -> float:
        """Value that is one standard deviation away, within the limits."""
        above = self.value + self.stated.deviation
        return above if above <= self.stated.highest else self.value - self.stated.deviation

    @property
    def sign(self) -> float:
        """1 if the changed value is above the value in the study, else -1."""
        return 1.0 if self.changed >= self.value else -1.0


def stated_parameters(result: StudyResult) -> tuple[tuple[UncertainParameter, ...], tuple[str, ...], tuple[str, ...]]:
    """Return the uncertain parameters that the builds' FMUs state, the builds whose uncertainty is unknown, and notes.

    Builds that no corner of the study allows are left out.
    """
    found, unknown, notes = list[UncertainParameter](), list[str](), dict[str, list[str]]()
    allowed = {build for builds in result.study.corners.values() for build in builds}
    for build, made in result.study.bank.items():
        stated = stated_uncertainty(result, made.fmu) if build in allowed else ModelUncertainty()
        if stated is None:
            unknown.append(build)
            continue
        values = parameter_values(made.fmu, made.parameters, [one.name for one in stated.parameters])
        missing = [one.name for one in stated.parameters if one.name not in values]
        unknown += [build] if missing else []
        for text in (*stated.held, *(f"the FMU has no parameter {name}" for name in missing)):
            notes.setdefault(text, []).append(build)
        found += [
            UncertainParameter(build, values[one.name], _scaled(one, values[one.name]), stated.left_out)
            for one in stated.parameters
            if one.name in values and one.deviation > 0.0
        ]
    return tuple(found), tuple(unknown), tuple(f"{', '.join(builds)}: {text}" for text, builds in notes.items())


def parameter_values(fmu: Path, given: Mapping[str, float | bool | str], names: Sequence[str]) -> dict[str, float]:
    """Return the values of those parameters that an FMU has: the study's, or else the FMU's own."""
    variables = FmuComponent(fmu, "part").variables if names else {}
    found = {name: given.get(name, variables[name].start) for name in names if name in variables}
    return {name: float(value) for name, value in found.items() if value is not None}


def _scaled(stated: ParameterUncertainty, value: float) -> ParameterUncertainty:
    """Return the uncertainty of a scale, which is relative, at its value in the study."""
    if not stated.name.endswith("_scale"):
        return stated
    copies = None if stated.copies is None else stated.copies * abs(value)
    return replace(stated, deviation=stated.deviation * abs(value), copies=copies)


def effects_of(
    result: StudyResult,
    parameters: Sequence[UncertainParameter],
    folder: str | Path,
    workers: Workers,
    progress: Progress = lambda _done, _all: None,
    *,
    vehicles: Sequence[Path] = (),
) -> tuple[Effect, ...]:
    """Return the effects of uncertain parameters, from runs of setups that differ from the best one at one corner.

    The best predicted setup gets each build at one corner at a time, with each of the build's parameters changed; a
    parameter of the vehicle is changed with every build at every corner. So the effects are most accurate near the
    setups among which the choice is made. Runs that are in the folder are not repeated.

    Args:
        result: Result of the study.
        parameters: Uncertain parameters.
        folder: Folder of the study.
        workers: Workers that run the setups.
        progress: Called after each part of the runs.
        vehicles: FMUs of equivalent vehicles, such as fits of other records. All vehicles are taken to have
            errors of the same size, so that half of the square of a difference belongs to the study's.
    """
    base = _best(result)
    own = [one for one in parameters if one.part in result.study.bank]
    cars = [one for one in parameters if one.part == result.study.vehicle.name]
    if base is None or not (own or cars or vehicles):
        return ()
    runs = _Runs(result, base, Path(folder) / "certainty", workers)
    corners = list(result.study.corners)
    total, count = len(corners) * (1 + len(cars) + len(vehicles)), 0
    nominal, shocks = _Table(), _Table()
    progress(0, total)
    for corner in corners:
        for key, row in runs.at(corner, result.study, own).items():
            (shocks if _CHANGED in key[1] else nominal)[key] = row
        progress(count := count + 1, total)
    found = correlated([runs.shock_effect(one, nominal, shocks) for one in own], [one.left_out for one in own])
    others = [(one.stated.name, one.stated.deviation, one.sign, runs.with_vehicle(one)) for one in cars]
    share = (2.0 * len(vehicles)) ** -0.5 if vehicles else 0.0
    others += [(path.name, 1.0, share, runs.with_other_vehicle(path)) for path in vehicles]
    for name, deviation, factor, study in others:
        changed = _Table()
        for corner in corners:
            changed |= runs.at(corner, study)
            progress(count := count + 1, total)
        found.append(runs.vehicle_effect(name, deviation, factor, nominal, changed))
    return tuple(found)


def correlated(effects: Sequence[Effect], left_out: Sequence[LeftOutBlocks | None]) -> list[Effect]:
    """Return effects of builds' parameters with the correlations of their errors, see `correlation_of`.

    Args:
        effects: Effects of parameters of builds (F,).
        left_out: Changes of the fit of each effect's build (F,); None if they are not known.
    """
    fitted = [FittedParameter(one, effect.parameter) for one, effect in zip(left_out, effects, strict=True)]
    table = np.round(correlation_of(fitted), _PLACES)
    others = [[k for k in np.flatnonzero(row).tolist() if k != place] for place, row in enumerate(table)]
    return [
        replace(effect, correlations={effects[k].part: float(row[k]) for k in places})
        for effect, row, places in zip(effects, table, others, strict=True)
    ]


def _best(result: StudyResult) -> Mapping[str, str] | None:
    ranking = result.ranking()
    rows = ranking if ranking.size else np.flatnonzero(result.done)
    return result.setup(int(rows[0])).builds if rows.size else None


#: Measures of setups that differ from the best one at one corner, by corner and build.
_Table = dict[tuple[str, str], dict[str, float]]


@dataclass(frozen=True, slots=True, eq=False)
class _Runs:
    """Runs about the best setup."""

    result: StudyResult  #: Result of the study.
    base: Mapping[str, str]  #: Builds of the best setup.
    folder: Path  #: Folder of completed runs.
    workers: Workers  #: Workers that run the setups.

    def at(self, corner: str, study: Study, parameters: Sequence[UncertainParameter] = ()) -> _Table:
        """Return the measures of the best setup with each build at a corner, and with each changed build."""
        builds = list(study.corners[corner])
        bank = {name: study.bank[name] for name in dict.fromkeys([*builds, *self.base.values()])}
        for one in parameters:
            if one.part in study.corners[corner]:
                name = one.part + _CHANGED + one.stated.name
                build = study.bank[one.part]
                bank[name] = replace(build, parameters={**build.parameters, one.stated.name: one.changed})
                builds.append(name)
        corners = {name: tuple(builds) if name == corner else (self.base[name],) for name in study.corners}
        local = replace(study, bank=bank, corners=corners, alike=(), baseline={})
        keys = {build: local.space.find({**self.base, corner: build}).index for build in builds}
        found = Requested(local, self.folder).request(self.workers, coupling_of(self.result), list(keys.values()))
        rows = dict(zip(found.setups.tolist(), range(len(found)), strict=True))
        names = [measure.name for measure in study.measures]
        return {
            (corner, build): {name: float(found.values(name)[rows[index]]) for name in names}
            for build, index in keys.items()
            if found.done[rows[index]]
        }

    def with_vehicle(self, one: UncertainParameter) -> Study:
        """Return the study with a changed parameter of the vehicle."""
        vehicle = self.result.study.vehicle
        vehicle = replace(vehicle, parameters={**vehicle.parameters, one.stated.name: one.changed})
        return replace(self.result.study, vehicle=vehicle)

    def shock_effect(self, one: UncertainParameter, nominal: _Table, shocks: _Table) -> Effect:
        """Return the effect of a parameter of a build."""
        name = one.part + _CHANGED + one.stated.name
        changes = {
            corner: {one.part: _logarithms(shocks[corner, name], nominal[corner, one.part], one.sign)}
            for corner, builds in self.result.study.corners.items()
            if one.part in builds and (corner, name) in shocks and (corner, one.part) in nominal
        }
        copies = 0.0 if one.stated.copies is None else one.stated.copies / one.stated.deviation
        return Effect(one.part, one.stated.name, one.stated.deviation, copies, {}, changes)

    def with_other_vehicle(self, fmu: Path) -> Study:
        """Return the study with an equivalent vehicle."""
        return replace(self.result.study, vehicle=replace(self.result.study.vehicle, fmu=fmu))

    def vehicle_effect(self, name: str, deviation: float, factor: float, nominal: _Table, changed: _Table) -> Effect:
        """Return the effect of a change of the vehicle: that at the best setup, and what each build changes in it."""
        logarithms = {k: _logarithms(row, nominal[k], factor) for k, row in changed.items() if k in nominal}
        shared = logarithms.get(next(iter(self.base.items())), {})
        changes: dict[str, dict[str, dict[str, float]]] = {}
        for (corner, build), row in logarithms.items():
            apart = {measure: value - shared.get(measure, 0.0) for measure, value in row.items()}
            changes.setdefault(corner, {})[build] = apart
        return Effect(self.result.study.vehicle.name, name, deviation, 0.0, shared, changes)


def _logarithms(changed: Mapping[str, float], nominal: Mapping[str, float], sign: float) -> dict[str, float]:
    return dict(_ratios(changed, nominal, sign))


def _ratios(changed: Mapping[str, float], nominal: Mapping[str, float], sign: float) -> Iterator[tuple[str, float]]:
    """Yield the logarithm of the ratio of each measure that is positive."""
    for name, value in changed.items():
        if 0.0 < value < inf and 0.0 < nominal[name] < inf:
            yield name, sign * float(np.log(value / nominal[name]))
