"""What is known about each target curve: its band, the builds of the bank and the valving near it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from cosim.study.choice.continuous import Optimum, Problem, ShockSpace
from cosim.study.choice.gain_band import Band
from cosim.study.study import Build
from eightpost.array_types import Array
from eightpost.rig.damper.valving import NearestValving, nearest_valving
from eightpost.shock import read_shock
from eightpost.shock.shape import Shape, ShapeFit, difference, fit_force


@dataclass(frozen=True, slots=True)
class Neighbour:
    """A build of the bank near a target."""

    build: str  #: Name of the build.
    difference: float  #: RMS difference of the forces [N].
    relative: float  #: The same as a share of the target's RMS force [1].
    objective: float  #: Objective with this build at the target's corners and the targets elsewhere.


@dataclass(frozen=True, slots=True, eq=False)
class Target:
    """The curve to aim at for a group of corners."""

    corners: tuple[str, ...]  #: Corners with this shock.
    shape: Shape  #: Target.
    velocity: Array  #: Velocities (N,) [m/s].
    low: Array  #: Lowest force at `velocity` within the band (N,) [N].
    high: Array  #: Highest force at `velocity` within the band (N,) [N].
    #: Interval of each varied number that keeps the gain while the others stay [SI].
    alone: Mapping[str, tuple[float, float]]
    at_limit: tuple[str, ...]  #: Numbers that are at an end of their range.
    neighbours: tuple[Neighbour, ...]  #: Builds of the bank, nearest first.
    valving: NearestValving  #: Nearest valving of the virtual damper.
    valving_shape: Shape  #: Shape of its static curve, with the lag of the target.
    valving_objective: float  #: Objective with that shape at the target's corners and the targets elsewhere.

    @property
    def name(self) -> str:
        """Name of the group: its corners joined by +."""
        return "+".join(self.corners)


#: Velocities at which the band is stated [m/s].
_VELOCITY = np.concatenate([-(np.linspace(1.0, 0.0, 41) ** 2), np.linspace(0.0, 1.0, 41)[1:] ** 2])

#: Distance from an end of the range that counts as being there, as a share of the range.
_AT_LIMIT = 0.01


def targets_of(
    problem: Problem,
    optimum: Optimum,
    kept: Band | None,
    shapes: Mapping[tuple[str, ...], Shape],
    bases: Mapping[tuple[str, ...], Shape],
    fits: Mapping[str, ShapeFit],
    sources: Mapping[str, Path],
) -> tuple[Target, ...]:
    """Return the targets with band, nearest builds and valving; builds and valvings are run in one batch."""
    space, study = problem.space, problem.trials.study
    planned = space.trial(space.values(optimum.point[None])[0])
    valvings = {group: nearest_valving(shape.curve().force) for group, shape in shapes.items()}
    trials, keys = list[Mapping[str, Build]](), list[tuple[tuple[str, ...], str]]()
    given = {}
    for group, shape in shapes.items():
        for name in fits:
            keys.append((group, name))
            trials.append({**planned, **dict.fromkeys(group, study.bank[name])})
        same = _shape_of_valving(valvings[group], shape)
        keys.append((group, ""))
        given[group] = same
        any_fmu = planned[group[0]].fmu
        trials.append({**planned, **dict.fromkeys(group, Build(any_fmu, same.parameters()))})
    objectives = dict(zip(keys, problem.scores(trials).objectives[:, 0].tolist(), strict=True))
    found = []
    for place, (group, shape) in enumerate(shapes.items()):
        low, high = _force_band(space, kept, place, bases[group], shape)
        neighbours = []
        for name in fits:
            apart = difference(shape, read_shock(sources[name]).law.curve.force)
            neighbours.append(Neighbour(name, *apart, objectives[group, name]))
        neighbours.sort(key=lambda one: one.difference)
        alone, limits = _intervals(space, optimum, kept, place)
        found.append(Target(group, shape, _VELOCITY, low, high, alone, limits, tuple(neighbours), valvings[group],
                            given[group], objectives[group, ""]))  # fmt: skip
    return tuple(found)


def _shape_of_valving(found: NearestValving, target: Shape) -> Shape:
    """Return the shape of the static force of a valving, with seal friction and level, and the lag of its target."""

    def force(velocity: float) -> float:
        return float(np.interp(velocity, found.velocity, found.force))

    end = float(found.velocity[-1])
    shape = fit_force(force, end, end).shape
    return replace(shape, lag=target.lag, lag_force=target.lag_force, gas=target.gas)


def _force_band(
    space: ShockSpace, kept: Band | None, place: int, base: Shape, shape: Shape
) -> tuple[Array, Array]:  # fmt: skip
    """Return the lowest and the highest force (N,) [N] of the shapes in the band of a group."""
    points = np.empty((0, space.size)) if kept is None else kept.points
    shapes = [base.with_numbers(space.numbers(values)[place]) for values in space.values(points)]
    curves = [one.curve() for one in (shape, *shapes)]
    forces = np.array([[curve.force(v) for v in _VELOCITY.tolist()] for curve in curves])
    return forces.min(axis=0), forces.max(axis=0)


def _intervals(
    space: ShockSpace, optimum: Optimum, kept: Band | None, place: int
) -> tuple[dict[str, tuple[float, float]], tuple[str, ...]]:
    """Return the interval of each number that keeps the gain alone, and the numbers at an end of their range."""
    own = slice(place * len(space.ranges), (place + 1) * len(space.ranges))
    places = optimum.point[own]
    ends = np.repeat(places[:, None], 2, axis=1) if kept is None else kept.alone[own]
    alone = {one.name: (float(one.value(low)), float(one.value(high)))
             for one, (low, high) in zip(space.ranges, ends, strict=True)}  # fmt: skip
    limits = tuple(one.name for one, at in zip(space.ranges, places, strict=True) if abs(at - 0.5) >= 0.5 - _AT_LIMIT)
    return alone, limits
