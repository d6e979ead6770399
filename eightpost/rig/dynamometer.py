"""A virtual shock dynamometer: drive a damper, measure it with real sensors."""

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
    """What can be put into the dynamometer."""

    def respond(self, motion: TimeSeries, *, rate: float) -> TimeSeries:
        """Return displacement [m], velocity [m/s], force [N] and perhaps more along a displacement command [m].

        A channel `warming` [K] is what the body's temperature has risen since the start.
        """
        ...


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


#: Temperature of a damper that does not say how it warms: at the start [K], and how fast [K/s]; a plausible short run.
START_TEMPERATURE, WARMING = 300.0, 0.2

#: Temperature that a damper which says how it warms was brought to before the test: 110 degF (3.2.1) [K].
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
    """Run a damper along a displacement drivefile and return what the sensors say.

    The sensors have no lag; without an actuator of its own the machine follows the command exactly.

    Args:
        damper: The damper.
        drivefile: A command with the channel `displacement` [m], finely and evenly sampled.
        rate: Samples per second [Hz].
        sensors: Noise and resolution of the four sensors.
        actuator: How the motion departs from the command.
        seed: Seed of the noise.

    Returns:
        displacement [m], velocity [m/s], force [N] (positive in compression), temperature [K].
    """
    motion = actuator.follow(drivefile.series) if actuator else drivefile.series
    return read_out(damper.respond(motion, rate=rate), sensors=sensors, seed=seed)


def read_out(response: TimeSeries, *, sensors: Sensors | None = None, seed: int = 0) -> TimeSeries:
    """Return what the sensors say of a damper's response; arguments and result as `measure`."""
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
