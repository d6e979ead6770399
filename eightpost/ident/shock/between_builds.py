"""Spread between the builds of a shock whose records are fitted together.

Every build is fitted alone with the law, the recipe and the kind of curve of the common fit. The standard deviation of
the builds' curves at a velocity, without the error of their fits, is the build-to-build uncertainty of the common
curve:

    s(v)^2 = max(variance of f_b(v) over the builds b - mean of the squared standard errors of f_b(v), 0)
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from eightpost.array_types import Array
from eightpost.errors import EightpostError
from eightpost.ident.shock.problem import Solution, standard_error
from eightpost.ident.shock.runs import Runs
from eightpost.ident.shock.verdict import parameters_of

#: Number of velocities at which the spread is stated.
POINTS = 61

#: Sides of a curve: sign of the velocity by the name of the FMU's parameter that scales the side.
_SIDES = {"compression_scale": 1.0, "rebound_scale": -1.0}


@dataclass(frozen=True, slots=True, eq=False)
class BuildSpread:
    """Spread between B builds of a shock."""

    builds: tuple[str, ...]  #: Names of the builds (B,).
    runs: tuple[int, ...]  #: Number of runs of each.
    velocity: Array  #: Velocities (M,) that all builds reach [m/s].
    force: Array  #: Static force of each build (B, M) [N].
    deviation: Array  #: Standard deviation between the builds (M,) [N], without the error of their fits.
    #: Scale of each build relative to the common curve (B,) [1], by `compression_scale` and `rebound_scale`.
    scales: dict[str, Array]
    #: Values (B,) and SI unit of each of the law's scalar parameters and of the gas force, by name.
    parameters: dict[str, tuple[Array, str]]
    notes: tuple[str, ...] = ()  #: Builds that could not be fitted alone, one sentence each.

    def percent(self, scale: str) -> float:
        """Return the standard deviation between the builds of `compression_scale` or `rebound_scale` in percent."""
        return 100.0 * _deviation(self.scales[scale])

    def summary(self) -> str:
        """Return one sentence."""
        return (
            f"{len(self.builds)} builds ({', '.join(self.builds)}): the static force differs from build to build by "
            f"{self.percent('compression_scale'):.2g} % in compression and {self.percent('rebound_scale'):.2g} % in "
            "rebound (standard deviation)"
        )

    def to_json(self) -> dict[str, Any]:
        """Return the spread as JSON values; docs/explanation/shock_law.md describes the keys."""
        return {
            "builds": list(self.builds),
            "runs": list(self.runs),
            "velocity [m/s]": self.velocity.tolist(),
            "force [N]": dict(zip(self.builds, self.force.tolist(), strict=True)),
            "standard_deviation [N]": self.deviation.tolist(),
            "parameters": {
                **{name: _entry(values, "1") for name, values in self.scales.items()},
                **{name: _entry(values, unit) for name, (values, unit) in self.parameters.items()},
            },
            "notes": list(self.notes),
        }


def _entry(values: Array, unit: str) -> dict[str, Any]:
    return {
        "values": values.tolist(),
        "mean": float(values.mean()),
        "standard_deviation": _deviation(values),
        "unit": unit,
    }


def _deviation(values: Array) -> float:
    return float(np.std(values, ddof=1))


def build_spread(
    runs: Runs, common: Solution, fit_alone: Callable[[Runs], Solution]
) -> tuple[BuildSpread | None, tuple[str, ...]]:
    """Return the spread between the builds of runs that were fitted together, and notes.

    Args:
        runs: Runs of all builds.
        common: Common fit.
        fit_alone: Function that fits the runs of one build like the common fit.

    Returns:
        The spread, None if the runs are of one build, or if fewer than two builds can be fitted alone.
    """
    found: dict[str, Solution] = {}
    notes: list[str] = []
    for build in runs.builds:
        own = Runs.of([p for p in runs.prepared if p.build == build])
        try:
            found[build] = fit_alone(own)
        except (EightpostError, ValueError) as error:  # laws and fits reject data by a ValueError
            notes.append(f"build {build} is not part of the spread between builds: {error}")
    if len(found) < 2:
        return None, tuple(notes)
    return _spread(found, common, tuple(notes)), tuple(notes)


def _spread(found: dict[str, Solution], common: Solution, notes: tuple[str, ...]) -> BuildSpread:
    solutions = list(found.values())
    velocity = _shared_velocities(solutions)
    force, errors = (np.array(rows) for rows in zip(*(_curve(one, velocity) for one in solutions), strict=True))
    middle = _curve(common, velocity)[0]
    variance = np.var(force, axis=0, ddof=1) - np.mean(errors**2, axis=0)
    known = [{p.name: p for p in parameters_of(one)} for one in solutions]
    shared = [name for name in known[0] if all(name in parameters for parameters in known)]
    return BuildSpread(
        tuple(found),
        tuple(len(one.model.runs.prepared) for one in solutions),
        velocity,
        force,
        np.sqrt(np.maximum(variance, 0.0)),
        side_scales(force, middle, velocity),
        {name: (np.array([one[name].value for one in known]), known[0][name].unit) for name in shared},
        notes,
    )


def side_scales(force: Array, common: Array, velocity: Array) -> dict[str, Array]:
    """Return the scales (B,) with which a common curve (M,) is closest to the curves (B, M) of builds, by its side.

    Args:
        force: Force of each build (B, M) [N].
        common: Force of the common curve (M,) [N].
        velocity: Velocities (M,) [m/s].
    """
    found = {}
    for name, sign in _SIDES.items():
        side = sign * velocity > 0.0
        found[name] = np.asarray(force[:, side] @ common[side] / (common[side] @ common[side]))
    return found


def _shared_velocities(solutions: Sequence[Solution]) -> Array:
    inside = [one.model.runs.velocity[one.model.runs.inside] for one in solutions]
    return np.linspace(max(float(v.min()) for v in inside), min(float(v.max()) for v in inside), POINTS)


def _curve(solution: Solution, velocity: Array) -> tuple[Array, Array]:
    """Return the static force (M,) [N] of a fit and its standard errors [N]."""
    model = solution.model
    n, columns = model.curve_count, model.basis.at(velocity)
    errors = standard_error(columns, np.nan_to_num(solution.covariance[:, :n, :n]))
    return np.asarray(columns @ solution.parameters[:n]), errors
