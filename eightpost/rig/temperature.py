"""Effect of temperature on the force, estimated from runs that are repeated at several temperatures."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from eightpost.array_types import Array
from eightpost.rig.dyno_test import DynoTest

#: Runs are repetitions if the standard deviations of their velocities agree within this share.
ALIKE = 0.05
#: Minimum range of temperature [K] for an estimate.
SMALLEST_SPREAD = 1.0


@dataclass(frozen=True, slots=True)
class TemperatureEffect:
    """Change of force with temperature, estimated from repeated runs."""

    per_kelvin: float  #: Relative change of the force's standard deviation [1/K]; negative if the shock becomes softer.
    error: float  #: Standard error of per_kelvin [1/K]; NaN if it is determined exactly by two runs.
    runs: int  #: Number of runs.
    spread: float  #: Range of the mean temperatures of the runs [K].

    def __str__(self) -> str:
        return (
            f"force changes by {100.0 * self.per_kelvin:+.2f} %/K (standard error {100.0 * self.error:.2f}), from "
            f"{self.runs} repeated runs over a range of {self.spread:.1f} K"
        )


def temperature_effect(tests: Iterable[DynoTest]) -> TemperatureEffect | None:
    """Estimate the change of force with temperature from runs that repeat each other.

    The model log(standard deviation of force) = g_k + b T is fitted by least squares. The groups k are runs with the
    same velocity (standard deviation within 5 %); within a group, the force is assumed proportional to the velocity.
    The result is None if no runs are repeated, or if their temperatures differ by less than 1 K.

    Args:
        tests: Runs from `split_runs` or from several files of one build.
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
    return _regress(temperatures, logs)


def _groups(tests: Sequence[DynoTest]) -> list[list[DynoTest]]:
    """Return the runs in groups with the same standard deviation of velocity."""
    groups: list[list[DynoTest]] = []
    for test in sorted(tests, key=_speed):
        if groups and _speed(test) <= (1.0 + ALIKE) * _speed(groups[-1][0]):
            groups[-1].append(test)
        else:
            groups.append([test])
    return groups


def _speed(test: DynoTest) -> float:
    return float(test.series["velocity"].std())


def _regress(temperatures: list[Array], logs: list[Array]) -> TemperatureEffect:
    heat, force = np.concatenate(temperatures), np.concatenate(logs)
    slope = float(heat @ force / (heat @ heat))
    free = heat.size - len(temperatures) - 1
    residual = force - slope * heat
    error = float(np.sqrt(residual @ residual / free / (heat @ heat))) if free > 0 else float("nan")
    spread = max(float(np.ptp(group)) for group in temperatures)
    return TemperatureEffect(slope, error, heat.size, spread)
