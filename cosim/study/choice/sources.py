"""Sources of the errors of a study's measures, as one linear model of independent variables."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import hypot, inf
from pathlib import Path
from typing import NamedTuple

import numpy as np

from cosim.components.fmu_component import FmuComponent
from cosim.study.choice.certainty import Effect, VehicleSource
from cosim.study.definition import Study, Vehicle
from cosim.study.measures import AboveBand, Measure
from cosim.study.running.evaluator import coupling_of
from cosim.study.running.sweep import Sweep
from cosim.study.running.workers import Workers
from cosim.study.table import StudyResult, error_column
from eightpost.array_types import Array, Flags, Integers
from eightpost.errors import InputError
from eightpost.progress import Progress
from eightpost.uncertainty import (
    TOTAL,
    FittedParameter,
    LeftOutBlocks,
    MeasureUncertainty,
    correlation_of,
    local_features,
    square_root,
)
from eightpost.validity import ModelUncertainty, ParameterUncertainty, Validity

# ---- Uncertainty that the vehicle states, for each measure ----------------------------------------------------------

#: Statistics whose relative error is approximately that of the RMS of their channels.
_LIKE_RMS = ("rms", "joint_rms", "peak", "range", "variation")

#: Quantity whose sum over all wheels the vehicle states.
_SUMMED = "tire_force"

#: Origin of an uncertainty: stated for this measure, that of its outputs, a file's, or not known (Levels.basis).
STATED, OUTPUT, FILE, UNKNOWN = "stated", "output", "file", "unknown"


def _stated_uncertainty(result: StudyResult, fmu: object) -> ModelUncertainty | None:
    """Return the uncertainty that an FMU of a study states; None if it states none, or it cannot be read."""
    document = result.provenance.models.get(str(fmu))
    try:
        return None if document is None else Validity.from_json(document).uncertainty
    except InputError:
        return None


def _stated_measures(result: StudyResult) -> Mapping[str, MeasureUncertainty]:
    found = _stated_uncertainty(result, result.study.vehicle.fmu)
    return {} if found is None else found.measures


def _plain_output(measure: Measure, vehicle: str, outputs: Mapping[str, MeasureUncertainty]) -> str | None:
    """Return the output whose RMS a measure is, or the total tire force; None if it is neither."""
    names = [channel.removeprefix(f"{vehicle}.") for channel in measure.channels]
    whole = measure.statistic == "rms" and not measure.function and measure.band is None and measure.section is None
    if not whole or len(set(measure.weights)) > 1 or any(weight == 0.0 for weight in measure.weights):
        return None
    if len(names) == 1:
        return names[0] if names[0] in outputs else None
    wheels = {name for name in outputs if name.rpartition(".")[2] == _SUMMED}
    return TOTAL if set(names) == wheels and TOTAL in outputs else None


def _vehicle_uncertainty(
    measure: Measure, stated: Mapping[str, MeasureUncertainty], vehicle: str, spectrum: AboveBand | None
) -> tuple[MeasureUncertainty | None, str]:
    """Return the uncertainty of a measure due to the vehicle, and its origin: stated, output or unknown.

    The vehicle states the uncertainty of the RMS of its outputs and of the total tire force. That of a measure in a
    band, in a section or of another statistic of the same size (peak, range) is approximated by that of its output, and
    that of several outputs by the largest one. Means, shares, percentiles, work and user-defined measures are unknown.
    """
    shares = () if spectrum is None else spectrum.bands
    name = _plain_output(measure, vehicle, stated)
    if name is not None:
        return stated[name].on_drive(shares), STATED
    names = [channel.removeprefix(f"{vehicle}.") for channel in measure.channels]
    if measure.function or measure.statistic not in _LIKE_RMS or not all(name in stated for name in names):
        return None, UNKNOWN
    if len(names) > 1 and TOTAL in stated and all(name.rpartition(".")[2] == _SUMMED for name in names):
        names.append(TOTAL)
    parts = [stated[name].on_drive(shares) for name in names]
    return MeasureUncertainty(max(hypot(p.common, p.bias) for p in parts), max(p.own for p in parts)), OUTPUT


# ---- Positions of setups, which the own errors of their measures depend on ------------------------------------------

#: Statistics whose values are proportional to the motion, so that they can measure the distance of two setups.
_DISTANCE = ("rms", "joint_rms")


@dataclass(frozen=True, slots=True, eq=False)
class Axes:
    """Axes of the positions of setups: O outputs, their local features, then all M measures; Z in all."""

    #: Positions of the measures of the outputs (O,): each output of the vehicle counts once, as in the vehicle's own
    #: distance.
    outputs: Integers
    positive: Flags  #: Whether a measure is positive for all setups (M,); the coordinate of any other one is 0.
    middle: Array  #: Means of the logarithms over the setups of the study (O + M,).

    @classmethod
    def of(cls, result: StudyResult) -> Axes:
        """Return the axes of a study."""
        study, predicted = result.study, _predicted_levels(result)[result.done]
        positive = np.asarray(np.all(predicted > 0.0, axis=0), dtype=np.bool_)
        names = _stated_measures(result)
        plain = {_plain_output(m, study.vehicle.name, names): k for k, m in enumerate(study.measures) if positive[k]}
        kept = [k for output, k in plain.items() if output is not None]
        if not kept:
            kept = [k for k, m in enumerate(study.measures)
                    if positive[k] and m.statistic in _DISTANCE and not m.function]  # fmt: skip
        axes = cls(np.array(kept, dtype=np.int64), positive, np.zeros(len(kept) + positive.size))
        return cls(axes.outputs, positive, axes._logarithms(predicted).mean(axis=0) if len(predicted) else axes.middle)

    def position(self, levels: Array) -> Array:
        """Return the positions (R, Z) of setups by the levels of their measures (R, M), SI.

        The coordinates are `ln(measure) / sqrt(O)` of the outputs, minus their means, `local_features` of these, and
        `ln(measure)` of all measures, minus their means.
        """
        outputs, own = np.split(self._logarithms(levels) - self.middle, [self.outputs.size], axis=1)
        return np.hstack([outputs, local_features(outputs), own])

    def _logarithms(self, levels: Array) -> Array:
        own = np.log(np.where(self.positive, levels, 1.0))
        return np.hstack([own[:, self.outputs] / np.sqrt(max(self.outputs.size, 1)), own])


def _predicted_levels(result: StudyResult) -> Array:
    return np.stack([result.values(measure.name) for measure in result.measures], axis=1)


# ---- The linear model -----------------------------------------------------------------------------------------------
#     e[k, m] = ln(true / predicted)
#             = shift[m] + common[m] + own[m] . z[k] + sum over corners of the shock there + coupling[k, m]
#
# for setup k and measure m. The shift is known: minus the vehicle's bias. The position `z` of a setup has three parts.
# The first are the outputs, `x - mean of x` with `x = ln(measures) / sqrt(O)`; the second are `local_features` of the
# first; every measure depends on both. The third are `ln(measure)` minus its mean, of all M measures; only the measure
# itself depends on its own one: its range over the setups is wrong by a factor. All Z parts together give the
# separation that MeasureUncertainty describes. The common error and the gradient `own` have Student's t distribution
# (MeasureUncertainty): a normal distribution whose scale is unknown. All other variables are normal. The fit of a build
# has the same error at every corner, and each copy of it another one. The errors of several fits are correlated if
# these had the same test (`Effect.correlations`): they are sums of independent variables, the modes.


class Scales(NamedTuple):
    """Factors of the scales of the common and own errors (..., M); 1 is the stated scale."""

    common: Array
    own: Array


@dataclass(frozen=True, slots=True, eq=False)
class Variables:
    """Drawn variables of the error model: D draws."""

    #: Common error of each measure (D, M), with its shift and the errors that parameters of the vehicle give all.
    common: Array
    own: Array  #: Gradient of each measure's own error (D, M, Z).
    shocks: Array  #: Error due to each build at each corner (D, C, B, M).


@dataclass(frozen=True, eq=False)
class ErrorSources:
    """Sources of the errors of M measures of R setups with C corners and B builds."""

    names: tuple[str, ...]  #: Names of the measures.
    predicted: Array  #: Predicted levels (R, M), SI; NaN if a setup failed.
    shift: Array  #: Known common error ln(true / predicted) (M,) [1].
    common: Array  #: Scale of the common error (M,) [1]; 0 if it is not known.
    own: Array  #: Scale of the own error per distance (M,) [1]; 0 if it is not known.
    bases: tuple[str, ...]  #: Origin of both, by measure (Levels.basis).
    positions: Array  #: Positions z of the setups (R, Z); 0 for setups that failed.
    builds: Integers  #: Positions of the builds at the corners (R, C) in the list of all builds.
    shared: Array  #: Change of all setups by a standard deviation of each of F modes (F, M).
    changes: Array  #: Change by a build at a corner by a standard deviation of each mode (F, C, B, M).
    #: Change by a build at a corner by a standard deviation between copies, for each of P parameters for which it is
    #: known (P, C, B, M).
    copies: Array
    coupling: Array  #: Standard deviation due to the coupling (R, M) [1].
    run_to_run: Array  #: Standard deviation of one rig run (M,), SI; NaN if it is not known.

    @property
    def directions(self) -> Array:
        """Whether each measure's own error depends on each part of the position (M, Z): 1 or 0."""
        measures = len(self.names)
        shared = self.positions.shape[1] - measures
        return np.hstack([np.ones((measures, shared)), np.eye(measures)])

    @property
    def parameters(self) -> int:
        """Number of uncertain parameters F, and of their modes."""
        return len(self.shared)

    def index(self, name: str) -> int:
        """Return the position of a measure."""
        return self.names.index(name)

    def by_parameter(self, rows: Integers, m: int) -> Array:
        """Return the changes of a measure of some setups (K, F) by one standard deviation of each mode."""
        return np.asarray(self.shared[:, m] + self._at_corners(self.changes, rows, m).sum(axis=1))

    def by_copy(self, rows: Integers, m: int) -> Array:
        """Return the changes of a measure of some setups (K, C, P) by one standard deviation of each copy."""
        return self._at_corners(self.copies, rows, m)

    def _at_corners(self, changes: Array, rows: Integers, m: int) -> Array:
        """Return the changes of a measure (K, C, F) by the builds at the corners of some setups, from (F, C, B, M)."""
        corners = np.arange(self.builds.shape[1])
        return np.moveaxis(changes[:, corners, self.builds[rows], m], 0, -1)

    def shock_covariance(self, rows: Integers, first: int, second: int) -> Array:
        """Return the covariance (K,) of two measures of each of some setups due to the uncertain parameters."""
        corners, builds = self.changes.shape[1:3]
        sides = []
        for m in (first, second):
            flat = self.changes[:, :, :, m].reshape(self.parameters, corners * builds)
            sides.append(np.hstack([self.shared[:, m, None], flat]))
        table = sides[0].T @ sides[1]
        copies = np.sum(self.copies[..., first] * self.copies[..., second], axis=0).ravel()
        table[np.arange(1, copies.size + 1), np.arange(1, copies.size + 1)] += copies
        places = [np.zeros(rows.size, dtype=np.int64)]
        places += [1 + corner * builds + self.builds[rows, corner] for corner in range(corners)]
        found = np.zeros(rows.size)
        for one in places:
            for other in places:
                found += table[one, other]
        return found

    def only_measure(self, m: int) -> Array:
        """Return weights of the measures (R, M): 1 for one of them, 0 for the others."""
        return np.broadcast_to(1.0 * (np.arange(len(self.names)) == m), self.predicted.shape)

    def only(self, rows: Integers) -> ErrorSources:
        """Return the sources of the errors of some setups."""
        own = {name: getattr(self, name)[rows] for name in ("predicted", "positions", "builds", "coupling")}
        return replace(self, **own)

    def draw(self, scales: Scales, count: int, generator: np.random.Generator) -> Variables:
        """Return drawn variables.

        Args:
            scales: Factors of the scales (M,), the same for all draws.
        """
        corners = self.builds.shape[1]
        normal = generator.standard_normal
        fit = normal((count, self.parameters))
        common = self.shift + normal((count, len(self.names))) * (self.common * scales.common) + fit @ self.shared
        gradient = (self.own * scales.own)[:, None] * self.directions
        own, some = np.zeros((count, *gradient.shape)), gradient != 0.0
        own[:, some] = normal((count, np.count_nonzero(some))) * gradient[some]
        shocks = np.zeros((count, *self.changes.shape[1:]))
        for corner in range(corners):
            shocks[:, corner] = np.tensordot(fit, self.changes[:, corner], axes=1)
            if len(self.copies):
                shocks[:, corner] += np.tensordot(normal((count, len(self.copies))), self.copies[:, corner], axes=1)
        return Variables(common, own, shocks)

    def errors(self, drawn: Variables, rows: Integers, m: int) -> Array:
        """Return the errors (D, K) of a measure of K setups, without the coupling's."""
        found = np.repeat(drawn.common[:, m, None], rows.size, axis=1)
        if np.any(drawn.own[:, m]):  # it is zero if the vehicle states no uncertainty
            found += drawn.own[:, m] @ self.positions[rows].T
        if self.parameters:
            for corner in range(self.builds.shape[1]):
                found += np.take(drawn.shocks[:, corner, :, m], self.builds[rows, corner], axis=1)
        return found


def error_sources(
    result: StudyResult,
    effects: Sequence[Effect] = (),
    run_to_run: Mapping[str, float] | None = None,
    vehicle: VehicleSource = VehicleSource.MODEL,
) -> ErrorSources:
    """Return the sources of the errors of a study's measures.

    The relative error of a measure that is zero or negative for a setup is not known.
    """
    names = tuple(measure.name for measure in result.measures)
    predicted, axes = _predicted_levels(result), Axes.of(result)
    positive = axes.positive
    done = result.done[:, None]
    stated, spectra, car = _stated_measures(result), result.provenance.above_band, result.study.vehicle.name
    pairs = [_vehicle_uncertainty(one, stated, car, spectra.get(one.name)) for one in result.measures]
    found = [one if is_positive else None for (one, _), is_positive in zip(pairs, positive, strict=True)]
    bases = [UNKNOWN if one is None else basis for one, (_, basis) in zip(found, pairs, strict=True)]
    if vehicle is VehicleSource.REPLACED:
        found = [None for _ in names]
    if vehicle is not VehicleSource.MODEL:
        kept = bases if vehicle is VehicleSource.ADDED else [UNKNOWN for _ in names]
        bases = [FILE if base == UNKNOWN and positive[m] else base for m, base in enumerate(kept)]
    shared, changes = _effects(result, effects, names)
    copies, modes = np.array([effect.copies for effect in effects]), _modes(effects)
    noise = run_to_run or {}
    return ErrorSources(
        names=names,
        predicted=predicted,
        shift=np.array([0.0 if one is None else -one.bias for one in found]),
        common=np.array([0.0 if one is None else one.common for one in found]),
        own=np.array([0.0 if one is None else one.own for one in found]),
        bases=tuple(bases),
        positions=np.where(done, axes.position(np.where(done, predicted, 1.0)), 0.0),
        builds=result.places(list(result.study.bank)),
        shared=modes.T @ shared,
        changes=np.tensordot(modes.T, changes, axes=1),
        copies=(copies[:, None, None, None] * changes)[copies > 0.0],
        coupling=_coupling(result, predicted),
        run_to_run=np.array([noise.get(name, np.nan) for name in names]),
    )


def _effects(result: StudyResult, effects: Sequence[Effect], names: Sequence[str]) -> tuple[Array, Array]:
    study = result.study
    corners, builds = list(study.corners), list(study.bank)
    shared = np.array([[e.shared.get(name, 0.0) for name in names] for e in effects]).reshape(-1, len(names))
    changes = np.zeros((len(effects), len(corners), len(builds), len(names)))
    for f, effect in enumerate(effects):
        for corner, by_build in effect.changes.items():
            for build, by_measure in by_build.items():
                row = [by_measure.get(name, 0.0) for name in names]
                changes[f, corners.index(corner), builds.index(build)] = row
    return shared, changes


def _modes(effects: Sequence[Effect]) -> Array:
    """Return the errors of the parameters (F,), in standard deviations, as sums of independent modes (F, F)."""
    found = np.eye(len(effects))
    places = {(effect.part, effect.parameter): place for place, effect in enumerate(effects)}
    for place, effect in enumerate(effects):
        for build, correlation in effect.correlations.items():
            found[place, places.get((build, effect.parameter), place)] = correlation
    np.fill_diagonal(found, 1.0)
    return square_root(found)


def _coupling(result: StudyResult, predicted: Array) -> Array:
    """Return the relative error due to the coupling (R, M); 0 where it is not known."""
    names = [error_column(measure.name) for measure in result.measures]
    known = result.table.columns
    errors = [result.column(name) if name in known else np.zeros(len(result)) for name in names]
    size = np.where(predicted == 0.0, np.nan, np.abs(predicted))
    return np.nan_to_num(np.abs(np.stack(errors, axis=1)) / size)


# ==== Effects of uncertain parameters on the measures, from runs with one changed parameter at a time ================

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
    for build, made in result.study.bank.items():
        stated = _stated_uncertainty(result, made.fmu) if build in result.study.allowed else ModelUncertainty()
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
    sweep: Sweep,
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
        sweep: The study, whose FMUs the runs use.
        vehicles: FMUs of equivalent vehicles, such as fits of other records. All vehicles are taken to have
            errors of the same size, so that half of the square of a difference belongs to the study's.
    """
    ranking = result.ranking()
    rows = ranking if ranking.size else np.flatnonzero(result.done)
    own = [one for one in parameters if one.part in result.study.bank]
    cars = [one for one in parameters if one.part == result.study.vehicle.name]
    if not rows.size or not (own or cars or vehicles):
        return ()
    runs = _Runs(result, result.setup(int(rows[0])).builds, sweep, workers)
    corners = list(result.study.corners)
    total, count = len(corners) * (1 + len(cars) + len(vehicles)), 0
    nominal, shocks = _Table(), _Table()
    progress(0, total)
    for corner in corners:
        for key, row in runs.at(corner, result.study, own).items():
            (shocks if _CHANGED in key[1] else nominal)[key] = row
        progress(count := count + 1, total)
    found = correlated([runs.shock_effect(one, nominal, shocks) for one in own], [one.left_out for one in own])
    vehicle, others = result.study.vehicle, list[tuple[str, float, float, Vehicle]]()
    for one in cars:
        changed_car = replace(vehicle, parameters={**vehicle.parameters, one.stated.name: one.changed})
        others.append((one.stated.name, one.stated.deviation, one.sign, changed_car))
    share = (2.0 * len(vehicles)) ** -0.5 if vehicles else 0.0
    others += [(path.name, 1.0, share, replace(vehicle, fmu=path)) for path in vehicles]
    for name, deviation, factor, car in others:
        changed = _Table()
        for corner in corners:
            changed |= runs.at(corner, replace(result.study, vehicle=car))
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


#: Measures of setups that differ from the best one at one corner, by corner and build.
_Table = dict[tuple[str, str], dict[str, float]]


@dataclass(frozen=True, slots=True, eq=False)
class _Runs:
    """Runs about the best setup."""

    result: StudyResult  #: Result of the study.
    base: Mapping[str, str]  #: Builds of the best setup.
    sweep: Sweep  #: The study, whose FMUs the runs use.
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
        runs = self.sweep.variant(local, self.sweep.folder / "certainty")
        found = runs.request(self.workers, coupling_of(self.result), list(keys.values()))
        rows = dict(zip(found.setups.tolist(), range(len(found)), strict=True))
        names = [measure.name for measure in study.measures]
        return {
            (corner, build): {name: float(found.values(name)[rows[index]]) for name in names}
            for build, index in keys.items()
            if found.done[rows[index]]
        }

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
    return {
        name: sign * float(np.log(value / nominal[name]))
        for name, value in changed.items()
        if 0.0 < value < inf and 0.0 < nominal[name] < inf
    }
