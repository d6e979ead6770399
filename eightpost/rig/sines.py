"""Sine drive files of Table 3.3."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from eightpost.errors import ParameterError
from eightpost.signals.drivefile import Drivefile
from eightpost.signals.timeseries import TimeSeries
from eightpost.units import convert

#: Table 3.3: amplitude [in] and peak velocity [in/s]. The frequencies follow as velocity / (2 pi amplitude).
TABLE_3_3 = (
    (1.0, 1.0), (1.0, 3.0), (1.0, 6.0), (1.0, 10.0), (1.0, 20.0), (1.0, 30.0),
    (0.5, 5.0), (0.5, 10.0), (0.5, 20.0),
    (0.25, 10.0), (0.25, 20.0),
    (0.1, 2.5), (0.1, 5.0), (0.1, 10.0),
)  # fmt: skip

#: Minimum duration of the steady part of a sine [s].
STEADY = 3.0


@dataclass(frozen=True, slots=True, eq=False)
class SineTest:
    """A sine test of the dynamometer.

    Attributes:
        amplitude: Amplitude [m].
        speed: Peak velocity [m/s].
        start: Start time of the steady part [s], which has whole cycles.
        drivefile: Drive file with the channel `displacement` [m].
    """

    amplitude: float
    speed: float
    start: float
    drivefile: Drivefile

    @property
    def frequency(self) -> float:
        """Frequency [Hz]."""
        return self.speed / (2.0 * math.pi * self.amplitude)

    @property
    def name(self) -> str:
        """Name of the test, such as `1in_10ips`."""
        return f"{convert(self.amplitude, 'm', 'in'):.3g}in_{convert(self.speed, 'm/s', 'in/s'):.3g}ips"


def sine_test(amplitude: float, speed: float, *, cycles: int = 3, rate: float = 2000.0) -> SineTest:
    """Return a sine that starts from rest.

        x = A w(t) sin(omega t),  w a raised cosine from 0 to 1 over the first whole cycles, half a second or more

    With a fade-in over a whole cycle, the velocity never exceeds the steady peak velocity.

    Args:
        amplitude: Amplitude A [m].
        speed: Peak velocity A omega [m/s].
        cycles: Minimum number of steady cycles; increased if they take less than 3 s.
        rate: Sample rate [Hz], at least 20 samples per cycle.

    Raises:
        ParameterError: A value is not positive, or the sample rate is too low.
    """
    for name, value in (("amplitude", amplitude), ("speed", speed), ("cycles", cycles), ("rate", rate)):
        if not (value > 0.0 and math.isfinite(value)):
            raise ParameterError(f"the sine's {name} must be above 0, not {value:g}")
    frequency = speed / (2.0 * math.pi * amplitude)
    if rate < 20.0 * frequency:
        raise ParameterError(
            f"a sine of {frequency:.4g} Hz needs a sample rate of at least {20.0 * frequency:.0f} Hz, not {rate:g} Hz"
        )
    start = math.ceil(max(1.0, 0.5 * frequency)) / frequency
    stop = start + math.ceil(max(cycles, STEADY * frequency)) / frequency
    time = np.arange(math.ceil(stop * rate) + 1) / rate
    fade = 0.5 - 0.5 * np.cos(np.pi * np.minimum(time / start, 1.0))
    displacement = amplitude * fade * np.sin(2.0 * np.pi * frequency * time)
    series = TimeSeries.from_channels(time, {"displacement": ("m", displacement)})
    return SineTest(amplitude, speed, start, Drivefile(series))


def sine_tests(*, cycles: int = 3, rate: float = 2000.0) -> tuple[SineTest, ...]:
    """Return the 14 sines of Table 3.3 in the order of the table; see `sine_test` for the arguments."""
    table = [(convert(a, "in", "m"), convert(v, "in/s", "m/s")) for a, v in TABLE_3_3]
    return tuple(sine_test(amplitude, speed, cycles=cycles, rate=rate) for amplitude, speed in table)
