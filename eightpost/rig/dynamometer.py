"""A virtual shock dynamometer: drive a damper, measure it with real sensors."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from eightpost.signals.timeseries import TimeSeries
from eightpost.units import convert

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from eightpost.rig.truth_damper import TruthDamper
    from eightpost.signals.drivefile import Drivefile

    Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Sensor:
    """A sensor: white noise, then rounding to its resolution.

    Attributes:
        noise: Standard deviation, in the channel's SI unit.
        resolution: Step of the readings, in the channel's SI unit.
    """

    noise: float
    resolution: float

    def read(self, values: Array, generator: np.random.Generator) -> Array:
        """Return the readings (N,) of `values` (N,)."""
        noisy = values + self.noise * generator.standard_normal(values.size)
        return np.asarray(self.resolution * np.round(noisy / self.resolution), dtype=np.float64)


@dataclass(frozen=True, slots=True)
class Sensors:
    """The sensors of a dynamometer; the defaults resolve 0.1 lbf, 0.0001 in, 0.01 in/s and 0.1 K.

    Attributes:
        displacement: [m].
        velocity: [m/s].
        force: [N].
        temperature: [K].
    """

    displacement: Sensor = Sensor(convert(1e-4, "in", "m"), convert(1e-4, "in", "m"))
    velocity: Sensor = Sensor(convert(0.02, "in/s", "m/s"), convert(0.01, "in/s", "m/s"))
    force: Sensor = Sensor(convert(0.5, "lbf", "N"), convert(0.1, "lbf", "N"))
    temperature: Sensor = Sensor(0.05, 0.1)


#: Temperature of the damper when a test starts [K] and how fast it warms [K/s]: a plausible short run.
START_TEMPERATURE, WARMING = 300.0, 0.2


def measure(
    damper: TruthDamper,
    drivefile: Drivefile,
    *,
    rate: float = 2000.0,
    sensors: Sensors | None = None,
    seed: int = 0,
) -> TimeSeries:
    """Run a damper along a displacement drivefile and return what the sensors say.

    The actuator follows the command exactly and the sensors have no lag.

    Args:
        damper: The damper.
        drivefile: A command with the channel `displacement` [m], finely and evenly sampled.
        rate: Samples per second [Hz].
        sensors: Noise and resolution of the four sensors.
        seed: Seed of the noise.

    Returns:
        displacement [m], velocity [m/s], force [N] (positive in compression), temperature [K].
    """
    sensors = sensors or Sensors()
    generator = np.random.default_rng(seed)
    truth = damper.respond(drivefile.series, rate=rate)
    temperature = START_TEMPERATURE + WARMING * (truth.time - truth.time[0])
    return TimeSeries.from_channels(
        truth.time,
        {
            "displacement": ("m", sensors.displacement.read(truth["displacement"], generator)),
            "velocity": ("m/s", sensors.velocity.read(truth["velocity"], generator)),
            "force": ("N", sensors.force.read(truth["force"], generator)),
            "temperature": ("K", sensors.temperature.read(temperature, generator)),
        },
    )
