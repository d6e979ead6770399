"""Virtual dynamometer: programs of motion, temperature, sensors."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import numpy as np

from eightpost.array_types import Array
from eightpost.rig.excitations import bump, random_multisine, sine_tests, static_steps
from eightpost.signals.timeseries import TimeSeries
from eightpost.units import convert

if TYPE_CHECKING:
    from eightpost.rig.actuator import Actuator
    from eightpost.rig.dyno_test import DynoTest
    from eightpost.signals.drivefile import Drivefile


# ---- Tests of the virtual dynamometer and their drive files, by name (dissertation 3.2.3) ---------------------------

#: Length of the random test [s].
RANDOM_DURATION = 30.0


def program(*, seed: int) -> dict[str, Drivefile]:
    """Return all tests of 3.2.3 by name. There are two random tests: one to fit, and another draw to validate.

    Args:
        seed: Seed of the phases of the first random test; the second test uses the next seed.
    """
    tests = {
        "random": random_multisine(seed, duration=RANDOM_DURATION),
        "random_validation": random_multisine(seed + 1, duration=RANDOM_DURATION),
    }
    tests |= {f"sine_{test.name}": test.drivefile for test in sine_tests()}
    return tests | {"static": static_steps(), "bump": bump()}


# ---- Effect of temperature on the force, estimated from runs that are repeated at several temperatures --------------

#: Runs are repetitions if the standard deviations of their velocities agree within this share.
ALIKE = 0.05
#: Minimum range of temperature [K] for an estimate.
SMALLEST_SPREAD = 1.0


@dataclass(frozen=True, slots=True)
class TemperatureEffect:
    """Change of force with temperature, estimated from repeated runs.

    Attributes:
        per_kelvin: Relative change of the force's standard deviation [1/K]; negative if the shock becomes softer.
        error: Standard error of per_kelvin [1/K]; NaN if it is determined exactly by two runs.
        runs: Number of runs.
        spread: Range of the mean temperatures of the runs [K].
    """

    per_kelvin: float
    error: float
    runs: int
    spread: float


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


# ---- Virtual shock dynamometer --------------------------------------------------------------------------------------


class Damper(Protocol):
    """Interface of a damper that the dynamometer can test."""

    def respond(self, motion: TimeSeries, *, rate: float) -> TimeSeries:
        """Return displacement [m], velocity [m/s], force [N] and optional channels for a displacement command [m].

        An optional channel `warming` [K] is the temperature rise of the body since the start.
        """
        ...


@dataclass(frozen=True, slots=True)
class Sensor:
    """A sensor that adds white noise and rounds to its resolution.

    Attributes:
        noise: Standard deviation of the noise, in the channel's SI unit.
        resolution: Step between readings, in the channel's SI unit.
    """

    noise: float
    resolution: float

    def read(self, values: Array, generator: np.random.Generator) -> Array:
        """Return the readings (N,) of `values` (N,)."""
        noisy = values + self.noise * generator.standard_normal(values.size)
        return np.asarray(self.resolution * np.round(noisy / self.resolution), dtype=np.float64)


@dataclass(frozen=True, slots=True)
class Sensors:
    """Sensors of a dynamometer; the default resolutions are 0.1 lbf, 0.0001 in, 0.01 in/s and 0.1 K.

    Attributes:
        displacement: Displacement sensor [m].
        velocity: Velocity sensor [m/s].
        force: Load cell [N].
        temperature: Temperature sensor [K].
    """

    displacement: Sensor = Sensor(convert(1e-4, "in", "m"), convert(1e-4, "in", "m"))
    velocity: Sensor = Sensor(convert(0.02, "in/s", "m/s"), convert(0.01, "in/s", "m/s"))
    force: Sensor = Sensor(convert(0.5, "lbf", "N"), convert(0.1, "lbf", "N"))
    temperature: Sensor = Sensor(0.05, 0.1)


#: Start temperature [K] and its rate of change [K/s] for a damper without the channel `warming`; plausible for a short
#: run.
START_TEMPERATURE, WARMING = 300.0, 0.2

#: Start temperature [K] for a damper with the channel `warming`: warmed up to 110 degF before the test (3.2.1).
WARM_START = convert(110.0, "degF", "K")


def measure(
    damper: Damper,
    drivefile: Drivefile,
    *,
    rate: float = 2000.0,
    sensors: Sensors | None = None,
    actuator: Actuator | None = None,
    seed: int = 0,
) -> TimeSeries:
    """Test a damper with a displacement drive file and return the sensor readings.

    The sensors have no lag. Without an actuator model, the machine follows the command exactly.

    Args:
        damper: Damper to test.
        drivefile: Command with the channel `displacement` [m], finely and evenly sampled.
        rate: Sample rate [Hz].
        sensors: Noise and resolution of the four sensors.
        actuator: Model of the deviation of the motion from the command.
        seed: Seed of the noise generator.

    Returns:
        displacement [m], velocity [m/s], force [N] (positive in compression), temperature [K].
    """
    motion = actuator.follow(drivefile.series) if actuator else drivefile.series
    return read_out(damper.respond(motion, rate=rate), sensors=sensors, seed=seed)


def read_out(response: TimeSeries, *, sensors: Sensors | None = None, seed: int = 0) -> TimeSeries:
    """Return the sensor readings for a damper's response; see `measure` for arguments and result."""
    sensors = sensors or Sensors()
    generator = np.random.default_rng(seed)
    return TimeSeries.from_channels(
        response.time,
        {
            "displacement": ("m", sensors.displacement.read(response["displacement"], generator)),
            "velocity": ("m/s", sensors.velocity.read(response["velocity"], generator)),
            "force": ("N", sensors.force.read(response["force"], generator)),
            "temperature": ("K", sensors.temperature.read(_temperature(response), generator)),
        },
    )


def _temperature(response: TimeSeries) -> Array:
    """Return the body's temperature (N,) [K]."""
    if "warming" in response:
        return WARM_START + response["warming"]
    return np.asarray(START_TEMPERATURE + WARMING * (response.time - response.time[0]), dtype=np.float64)
