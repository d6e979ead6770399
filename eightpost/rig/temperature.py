"""What temperature does to the force, where runs or cycles repeat at several temperatures."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from numpy.typing import NDArray

    from eightpost.rig.dyno_test import DynoTest

    Array = NDArray[np.float64]

#: Runs repeat each other when stroke speed (standard deviation) agrees within this share.
ALIKE = 0.05
#: Smallest spread of temperature [K] that says something.
SMALLEST_SPREAD = 1.0


@dataclass(frozen=True, slots=True)
class TemperatureEffect:
    """The change of force with temperature, from repeated runs.

    Attributes:
        per_kelvin: Relative change of the force's standard deviation [1/K]; negative where the shock softens.
        error: Its standard error [1/K]; NaN where two runs determine it exactly.
        runs: How many runs it is from.
        spread: Range of their mean temperatures [K].
    """

    per_kelvin: float
    error: float
    runs: int
    spread: float


def temperature_effect(tests: Iterable[DynoTest]) -> TemperatureEffect | None:
    """Estimate the change of force with temperature from runs that repeat each other.

    log(standard deviation of force) = g_k + b T over the groups k of runs with the same velocity (standard deviation
    within 5 %), least squares; the differences of speed inside a group are taken as proportional. None where no two
    runs repeat, or their temperatures differ by less than 1 K.

    Args:
        tests: Runs, as `split_runs` gives them or from several files of one build.
    """
    known = [test for test in tests if "temperature" in test.series]
    temperatures, logs = [], []
    for group in _groups(known):
        if len(group) > 1:
            heat = np.array([test.series["temperature"].mean() for test in group])
            force = np.array([np.log(test.series["force"].std() / test.series["velocity"].std()) for test in group])
            temperatures.append(heat - heat.mean())
            logs.append(force - force.mean())
    if not temperatures or max(float(np.ptp(heat)) for heat in temperatures) < SMALLEST_SPREAD:
        return None
    return _regressed(temperatures, logs)


def _groups(tests: Sequence[DynoTest]) -> list[list[DynoTest]]:
    """Return the runs by the standard deviation of their velocity."""
    groups: list[list[DynoTest]] = []
    for test in sorted(tests, key=_speed):
        if groups and _speed(test) <= (1.0 + ALIKE) * _speed(groups[-1][0]):
            groups[-1].append(test)
        else:
            groups.append([test])
    return groups


def _speed(test: DynoTest) -> float:
    return float(test.series["velocity"].std())


def _regressed(temperatures: list[Array], logs: list[Array]) -> TemperatureEffect:
    heat, force = np.concatenate(temperatures), np.concatenate(logs)
    slope = float(heat @ force / (heat @ heat))
    free = heat.size - len(temperatures) - 1
    residual = force - slope * heat
    error = float(np.sqrt(residual @ residual / free / (heat @ heat))) if free > 0 else float("nan")
    spread = max(float(np.ptp(group)) for group in temperatures)
    return TemperatureEffect(slope, error, heat.size, spread)
