"""Excitations: multisines, single sines and steps."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import uniform_filter1d

from eightpost.array_types import Array
from eightpost.errors import ParameterError
from eightpost.signals.drivefile import Drivefile
from eightpost.signals.timeseries import TimeSeries
from eightpost.units import convert

# ---- Random multisine of the shock dynamometer (dissertation 3.2.3) -------------------------------------------------

#: Table 3.2: frequency [Hz] and relative amplitude of the displacement [1].
TABLE_3_2 = (
    (0.1, 1.0), (1.0, 1.0), (2.0, 0.8), (3.0, 0.7), (4.0, 0.5), (5.0, 0.3), (8.0, 0.2), (10.0, 0.1),
    (20.0, 0.05), (30.0, 0.01),
)  # fmt: skip

#: Spacing of the sines [Hz]; the signal repeats every 1 / SPACING = 10 s.
SPACING = 0.1


def multisine_spectrum() -> tuple[Array, Array]:
    """Return the frequencies (300,) [Hz] and relative amplitudes (300,) [1] of Table 3.2 in steps of 0.1 Hz."""
    frequencies = SPACING * np.arange(1, 301, dtype=np.float64)
    table = np.array(TABLE_3_2)
    return frequencies, np.interp(frequencies, table[:, 0], table[:, 1])


def random_multisine(
    seed: int, *, duration: float = 30.0, rate: float = 2000.0, peak: float = 0.0254, draws: int = 50
) -> Drivefile:
    """Return a random displacement command for the dynamometer (Eq 3.26).

        x(t) = scale * sum_i A_i sin(2 pi f_i t + phi_i)

    The phases are uniformly random. Of `draws` draws, the one with the lowest crest factor is used and scaled to the
    peak.

    Args:
        seed: Seed of the phases.
        duration: Duration [s]; 30 in the dissertation. The signal repeats every 10 s.
        rate: Sample rate [Hz], above 60 and a multiple of 0.1.
        peak: Maximum magnitude over a period [m]; 1 in in the dissertation.
        draws: Number of phase draws.

    Returns:
        Drive file with the channel `displacement` [m].

    Raises:
        ValueError: The sample rate is too low for 30 Hz, or 10 s are not a whole number of samples.
    """
    count = round(rate / SPACING)
    if rate <= 60.0 or abs(count * SPACING - rate) > 1e-9 * rate:
        raise ValueError(f"the rate must be above 60 Hz and a multiple of 0.1 Hz, not {rate:g} Hz")
    generator = np.random.default_rng(seed)
    period = min((_period(generator, count) for _ in range(draws)), key=crest_factor)
    samples = np.arange(round(duration * rate) + 1)
    values = np.resize(period * (peak / np.abs(period).max()), samples.size)
    return Drivefile(TimeSeries.from_channels(samples / rate, {"displacement": ("m", values)}))


def _period(generator: np.random.Generator, count: int) -> Array:
    """Return one period (count,) of the unscaled sum for a new draw of phases."""
    _, amplitudes = multisine_spectrum()
    phases = generator.uniform(0.0, 2.0 * np.pi, amplitudes.size)
    lines = np.zeros(count // 2 + 1, dtype=np.complex128)
    # A sin(w t + phi) is the real part of -i A exp(i phi) exp(i w t).
    lines[1 : amplitudes.size + 1] = -0.5j * count * amplitudes * np.exp(1j * phases)
    return np.fft.irfft(lines, count)


def crest_factor(values: Array) -> float:
    """Return the peak magnitude of `values` (N,) over their root mean square [1]."""
    return float(np.abs(values).max() / np.sqrt(np.mean(values**2)))


# ---- Sine drive files of Table 3.3 ----------------------------------------------------------------------------------

#: Table 3.3: amplitude [in] and peak velocity [in/s]. The frequencies follow as velocity / (2 pi amplitude).
TABLE_3_3 = (
    (1.0, 1.0), (1.0, 3.0), (1.0, 6.0), (1.0, 10.0), (1.0, 20.0), (1.0, 30.0),
    (0.5, 5.0), (0.5, 10.0), (0.5, 20.0),
    (0.25, 10.0), (0.25, 20.0),
    (0.1, 2.5), (0.1, 5.0), (0.1, 10.0),
)  # fmt: skip

#: Minimum duration of the steady part of a sine, and maximum duration of the whole test [s].
STEADY, LONGEST = 3.0, 3600.0


@dataclass(frozen=True, slots=True, eq=False)
class SineTest:
    """A sine test of the dynamometer."""

    amplitude: float  #: Amplitude [m].
    speed: float  #: Peak velocity [m/s].
    start: float  #: Start time of the steady part [s], which has whole cycles.
    drivefile: Drivefile  #: Drive file with the channel `displacement` [m].

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
        ParameterError: A value is not positive, the sample rate is too low, or the test takes longer than an hour.
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
    if stop > LONGEST:
        raise ParameterError(
            f"a sine of {frequency:.4g} Hz with its fade-in lasts {stop:.4g} s, at most {LONGEST:g} s; use a higher "
            "speed, or a smaller amplitude"
        )
    time = np.arange(math.ceil(stop * rate) + 1) / rate
    fade = 0.5 - 0.5 * np.cos(np.pi * np.minimum(time / start, 1.0))
    displacement = amplitude * fade * np.sin(2.0 * np.pi * frequency * time)
    series = TimeSeries.from_channels(time, {"displacement": ("m", displacement)})
    return SineTest(amplitude, speed, start, Drivefile(series))


def sine_tests() -> tuple[SineTest, ...]:
    """Return the 14 sines of Table 3.3 in the order of the table."""
    table = [(convert(a, "in", "m"), convert(v, "in/s", "m/s")) for a, v in TABLE_3_3]
    return tuple(sine_test(amplitude, speed) for amplitude, speed in table)


# ---- Drive files with ramps and holds -------------------------------------------------------------------------------

#: Zero position of the dynamometer's commands, near the middle of the travel (3.2.1) [m].
OFFSET = convert(3.0, "in", "m")

_INCH = convert(1.0, "in", "m")


def static_steps(
    *,
    start: float = 2.0 * _INCH - OFFSET,
    step: float = _INCH,
    steps: int = 3,
    speed: float = convert(0.2, "in/s", "m/s"),
    hold: float = 20.0,
    rate: float = 2000.0,
) -> Drivefile:
    """Return the static profile (Fig 3.12): hold, move one step, hold, up and down again.

    Args:
        start: First position relative to the 3 in zero position [m]; default 2 in, which is -1 in.
        step: Height of a step [m]; default 1 in.
        steps: Number of steps up, and the same number down; default 3.
        speed: Speed between positions [m/s]; default 0.2 in/s.
        hold: Duration at each position [s]; default 20.
        rate: Sample rate [Hz].

    Returns:
        Drive file with the channel `displacement` [m].

    Raises:
        ParameterError: A value is not positive.
    """
    _check(step=step, steps=steps, speed=speed, hold=hold, rate=rate)
    climb = [start + step * i for i in range(steps + 1)]
    return _ramps([*climb, *climb[-2::-1]], speed=speed, hold=hold, rounding=0.05, rate=rate)


def bump(
    *,
    height: float = 0.5 * _INCH,
    speed: float = convert(30.0, "in/s", "m/s"),
    hold: float = 1.0,
    rounding: float = 0.004,
    rate: float = 2000.0,
) -> Drivefile:
    """Return the bump (Fig 3.13): hold, one ramp up, hold, one ramp down, hold.

    Args:
        height: Height of the bump [m]; default 0.5 in.
        speed: Speed in the straight part of the ramps [m/s]; default 30 in/s.
        hold: Duration of each hold [s].
        rounding: Time to reach the speed [s], because an actuator cannot start instantly.
        rate: Sample rate [Hz].

    Returns:
        Drive file with the channel `displacement` [m].

    Raises:
        ParameterError: A value is not positive, or the ramp has no straight part.
    """
    _check(height=height, speed=speed, hold=hold, rounding=rounding, rate=rate)
    if 2.0 * rounding > height / speed:
        raise ParameterError(
            f"a ramp of {height:g} m at {speed:g} m/s takes {height / speed:g} s and cannot be rounded over "
            f"{rounding:g} s at each end; lower the speed or the rounding"
        )
    return _ramps([0.0, height, 0.0], speed=speed, hold=hold, rounding=rounding, rate=rate)


def _check(**values: float) -> None:
    for name, value in values.items():
        if not (value > 0.0 and np.isfinite(value)):
            raise ParameterError(f"{name} must be above 0, not {value:g}")


def _ramps(positions: Sequence[float], *, speed: float, hold: float, rounding: float, rate: float) -> Drivefile:
    """Return holds at positions [m] connected by ramps, with corners rounded by two moving averages."""
    corners = [(0.0, positions[0]), (hold, positions[0])]
    for here, there in itertools.pairwise(positions):
        arrival = corners[-1][0] + abs(there - here) / speed
        corners += [(arrival, there), (arrival + hold, there)]
    times, values = np.array(corners).T
    time = np.arange(round(times[-1] * rate) + 1) / rate
    displacement = np.interp(time, times, values)
    # With two averages of half the length, the acceleration is a triangle and the velocity is smooth.
    width = max(round(0.5 * rounding * rate), 1) // 2 * 2 + 1
    for _ in range(2):
        displacement = uniform_filter1d(displacement, width, mode="nearest")
    return Drivefile(TimeSeries.from_channels(time, {"displacement": ("m", displacement)}))
