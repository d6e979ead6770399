"""Virtual shock dynamometer: moves a damper and measures it with realistic sensors."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import numpy as np

from eightpost.signals.timeseries import TimeSeries
from eightpost.units import convert

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from eightpost.rig.actuator import Actuator
    from eightpost.signals.drivefile import Drivefile

    Array = NDArray[np.float64]


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
