"""Sources of the errors of a study's measures, as one linear model of independent variables.

    e[k, m] = ln(true / predicted)
            = shift[m] + common[m] + own[m] . z[k] + sum over corners of the shock there + coupling[k, m]

for setup k and measure m. The shift is known: minus the vehicle's bias. The position `z` of a setup has three parts.
The first are the outputs, `x - mean of x` with
`x = ln(measures) / sqrt(O)`; the second are `local_features` of the first; every measure depends on both. The third are
`ln(measure)` minus its mean, of all M measures; only the measure itself depends on its own one: its range over the
setups is wrong by a factor. All Z parts together give the separation that MeasureUncertainty describes. The common
error and the gradient `own` have Student's t distribution (MeasureUncertainty): a normal distribution whose scale is
unknown. All other variables are normal. The fit of a build has the same error at every corner, and each copy of it
another one. The errors of several fits are correlated if these had the same test (`Effect.correlations`): they are
sums of independent variables, the modes.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from cosim.study.certainty.certainty import Effect, VehicleSource
from cosim.study.certainty.positions import Axes, predicted_levels
from cosim.study.certainty.vehicle_errors import FILE, UNKNOWN, vehicle_uncertainties
from cosim.study.columns import error_column
from cosim.study.result import StudyResult
from eightpost.array_types import Array, Integers
from eightpost.left_out_blocks import square_root


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

    def only(self, rows: Integers) -> ErrorSources:
        """Return the sources of the errors of some setups."""
        own = {name: getattr(self, name)[rows] for name in ("predicted", "positions", "builds", "coupling")}
        return replace(self, **own)

    def draw(self, scales: Scales, count: int, generator: np.random.Generator) -> Variables:
        """Return drawn variables.

        Args:
            scales: Factors of the scales (M,), the same for all draws.
            count: Number of draws.
            generator: Random number generator.
        """
        corners = self.builds.shape[1]
        normal = generator.standard_normal
        fit = normal((count, self.parameters))
        common = self.shift + normal((count, len(self.names))) * (self.common * scales.common) + fit @ self.shared
        gradient = (self.own * scales.own)[:, None] * self.directions
        own = normal((count, *gradient.shape)) * gradient
        shocks = np.zeros((count, *self.changes.shape[1:]))
        for corner in range(corners):
            shocks[:, corner] = np.tensordot(fit, self.changes[:, corner], axes=1)
            if len(self.copies):
                shocks[:, corner] += np.tensordot(normal((count, len(self.copies))), self.copies[:, corner], axes=1)
        return Variables(common, own, shocks)

    def errors(self, drawn: Variables, rows: Integers, m: int) -> Array:
        """Return the errors (D, K) of a measure of K setups, without the coupling's."""
        found = drawn.common[:, m, None] + drawn.own[:, m] @ self.positions[rows].T
        if self.parameters:
            for corner in range(self.builds.shape[1]):
                found += drawn.shocks[:, corner, :, m][:, self.builds[rows, corner]]
        return np.asarray(found)


def error_sources(
    result: StudyResult,
    effects: Sequence[Effect] = (),
    run_to_run: Mapping[str, float] | None = None,
    vehicle: VehicleSource = VehicleSource.MODEL,
) -> ErrorSources:
    """Return the sources of the errors of a study's measures.

    Args:
        result: Result of the study.
        effects: Effects of uncertain parameters of shocks and vehicle.
        run_to_run: Standard deviation of one rig run by measure, SI.
        vehicle: Origin of the uncertainty of the vehicle.

    The relative error of a measure that is zero or negative for a setup is not known.
    """
    names = tuple(measure.name for measure in result.measures)
    predicted, axes = predicted_levels(result), Axes.of(result)
    positive = axes.positive
    done = result.done[:, None]
    stated = vehicle_uncertainties(result)
    found = [stated[name][0] if positive[m] else None for m, name in enumerate(names)]
    bases = [UNKNOWN if one is None else stated[n][1] for n, one in zip(names, found, strict=True)]
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
    columns = result.table.column_names
    names = [error_column(measure.name) for measure in result.measures]
    errors = [result.table[n].to_numpy(zero_copy_only=False) if n in columns else np.zeros(len(result)) for n in names]
    size = np.where(predicted == 0.0, np.nan, np.abs(predicted))
    return np.nan_to_num(np.abs(np.stack(errors, axis=1).astype(np.float64)) / size)
