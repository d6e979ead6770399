"""Virtual dynamometer: excitations, shocks under test, actuator and sensors."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.ndimage import uniform_filter1d

from eightpost import __version__
from eightpost.array_types import Array
from eightpost.errors import ParameterError
from eightpost.signals.csv_file import write_csv
from eightpost.signals.drivefile import Drivefile
from eightpost.signals.parquet_file import write_parquet
from eightpost.signals.timeseries import TimeSeries
from eightpost.units import convert
from eightpost.virtual.damper import CONFIGURATIONS, SHIMS_OF_BUILD, PhysicalDamper, configuration, shim_build
from eightpost.virtual.shocks import TruthDamper
from eightpost.virtual.valves import cavitation

#: Sample rate of the motions [Hz].
RATE = 2000.0

# ==== Excitations: multisines, single sines and steps ================================================================

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
    seed: int, *, duration: float = 30.0, rate: float = RATE, peak: float = 0.0254, draws: int = 50
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
class _SineTest:
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


def sine_test(amplitude: float, speed: float, *, cycles: int = 3) -> _SineTest:
    """Return a sine that starts from rest.

        x = A w(t) sin(omega t),  w a raised cosine from 0 to 1 over the first whole cycles, half a second or more

    With a fade-in over a whole cycle, the velocity never exceeds the steady peak velocity.

    Args:
        amplitude: Amplitude A [m].
        speed: Peak velocity A omega [m/s].
        cycles: Minimum number of steady cycles; increased if they take less than 3 s.

    Raises:
        ParameterError: A value is not positive, there are fewer than 20 samples per cycle, or the test takes longer
            than an hour.
    """
    for name, value in (("amplitude", amplitude), ("speed", speed)):
        if not (value > 0.0 and math.isfinite(value)):
            raise ParameterError(f"the sine's {name} must be above 0, not {value:g}")
    frequency = speed / (2.0 * math.pi * amplitude)
    if 20.0 * frequency > RATE:
        raise ParameterError(
            f"a sine of {frequency:.4g} Hz needs a sample rate of at least {20.0 * frequency:.0f} Hz, not {RATE:g} Hz"
        )
    start = math.ceil(max(1.0, 0.5 * frequency)) / frequency
    stop = start + math.ceil(max(cycles, STEADY * frequency)) / frequency
    if stop > LONGEST:
        raise ParameterError(
            f"a sine of {frequency:.4g} Hz with its fade-in lasts {stop:.4g} s, at most {LONGEST:g} s; use a higher "
            "speed, or a smaller amplitude"
        )
    time = np.arange(math.ceil(stop * RATE) + 1) / RATE
    fade = 0.5 - 0.5 * np.cos(np.pi * np.minimum(time / start, 1.0))
    displacement = amplitude * fade * np.sin(2.0 * np.pi * frequency * time)
    series = TimeSeries.from_channels(time, {"displacement": ("m", displacement)})
    return _SineTest(amplitude, speed, start, Drivefile(series))


def sine_tests() -> tuple[_SineTest, ...]:
    """Return the 14 sines of Table 3.3 in the order of the table."""
    table = [(convert(a, "in", "m"), convert(v, "in/s", "m/s")) for a, v in TABLE_3_3]
    return tuple(sine_test(amplitude, speed) for amplitude, speed in table)


# ---- Drive files with ramps and holds -------------------------------------------------------------------------------

#: Zero position of the dynamometer's commands, near the middle of the travel (3.2.1) [m].
OFFSET = convert(3.0, "in", "m")

_INCH = convert(1.0, "in", "m")


def static_steps() -> Drivefile:
    """Return the static profile (Fig 3.12) of `displacement` [m].

    It holds each position for 20 s: from 2 in, which is -1 in from the zero position, three steps of 1 in up and down
    again at 0.2 in/s.
    """
    climb = [2.0 * _INCH - OFFSET + _INCH * i for i in range(4)]
    return _ramps([*climb, *climb[-2::-1]], speed=convert(0.2, "in/s", "m/s"), hold=20.0, rounding=0.05)


def bump() -> Drivefile:
    """Return the bump (Fig 3.13) of `displacement` [m]: hold, a ramp up of 0.5 in at 30 in/s, hold, a ramp down, hold.

    The holds take 1 s. The speed is reached within 4 ms, because an actuator cannot start instantly.
    """
    return _ramps([0.0, 0.5 * _INCH, 0.0], speed=convert(30.0, "in/s", "m/s"), hold=1.0, rounding=0.004)


def _ramps(positions: Sequence[float], *, speed: float, hold: float, rounding: float) -> Drivefile:
    """Return holds at positions [m] connected by ramps, with corners rounded by two moving averages."""
    corners = [(0.0, positions[0]), (hold, positions[0])]
    for here, there in itertools.pairwise(positions):
        arrival = corners[-1][0] + abs(there - here) / speed
        corners += [(arrival, there), (arrival + hold, there)]
    times, values = np.array(corners).T
    time = np.arange(round(times[-1] * RATE) + 1) / RATE
    displacement = np.interp(time, times, values)
    # With two averages of half the length, the acceleration is a triangle and the velocity is smooth.
    width = max(round(0.5 * rounding * RATE), 1) // 2 * 2 + 1
    for _ in range(2):
        displacement = uniform_filter1d(displacement, width, mode="nearest")
    return Drivefile(TimeSeries.from_channels(time, {"displacement": ("m", displacement)}))


# ==== The dynamometer ================================================================================================

# ---- Tests of the virtual dynamometer and their drive files, by name (dissertation 3.2.3) ---------------------------

#: Length of the random test [s].
RANDOM_DURATION = 30.0

#: Peak displacement of the random test, and the largest one for which the shock has travel [m].
RANDOM_PEAK, LARGEST_PEAK = convert(1.0, "in", "m"), convert(2.0, "in", "m")


def program(*, seed: int) -> dict[str, Drivefile]:
    """Return all tests of 3.2.3 by name. There are two random tests: one to fit, and another draw to validate.

    The second random test uses the next seed.
    """
    tests = {
        "random": random_multisine(seed, duration=RANDOM_DURATION),
        "random_validation": random_multisine(seed + 1, duration=RANDOM_DURATION),
    }
    tests |= {f"sine_{test.name}": test.drivefile for test in sine_tests()}
    return tests | {"static": static_steps(), "bump": bump()}


def drivefile_of(
    test: str, seed: int, *, amplitude: float | None = None, speed: float | None = None, duration: float | None = None
) -> Drivefile:
    """Return the motion of a test of 3.2.3: random, sine, static or bump.

    The amplitude [m] is that of a sine or the peak of a random test, the speed [m/s] that of a sine, the duration [s]
    that of a random test.

    Raises:
        ParameterError: The duration or the peak displacement of a random test, or the speed of a sine is out of range.
    """
    if amplitude is not None and speed is not None:
        return sine_test(amplitude, speed).drivefile
    if test == "random":
        seconds = RANDOM_DURATION if duration is None else duration
        peak = RANDOM_PEAK if amplitude is None else amplitude
        if not 0.5 <= seconds <= 600.0:
            raise ParameterError(f"--set duration must be 0.5 to 600 s, not {seconds:g} s")
        if not 0.0 < peak <= LARGEST_PEAK:
            inches = convert(peak, "m", "in")
            raise ParameterError(
                f"--set amplitude of the random test must be above 0 and at most 2 in, not {inches:g} in"
            )
        return random_multisine(seed, duration=seconds, peak=peak)
    return static_steps() if test == "static" else bump()


# ---- Actuator, whose position deviates from the command because of magnetic cogging ---------------------------------


@dataclass(frozen=True, slots=True)
class Actuator:
    """A linear motor whose cogging causes a position error with the pitch of its magnets (the ripple of 3.4.4).

        x = x_cmd + r sin(2 pi x_cmd / p)

    The ripple is real motion: it acts on the damper, and the sensors measure it.
    """

    #: Amplitude r of the ripple [m]. The velocity ripple is 2 pi r / p of the velocity: 1 % with the defaults;
    #: plausible values are 0 to 3 %.
    ripple: float = 5e-5
    pitch: float = convert(1.2, "in", "m")  #: Pitch p of the magnets [m]; 20 to 60 mm for motors of this force.

    def follow(self, command: TimeSeries) -> TimeSeries:
        """Return the motion along a command with the channel `displacement` [m]."""
        target = command["displacement"]
        actual = target + self.ripple * np.sin(2.0 * np.pi * target / self.pitch)
        return command.with_channel("displacement", "m", actual)


# ---- Sensors and measurement ----------------------------------------------------------------------------------------


#: Unit of each channel, standard deviation of its sensor's white noise, and the step between readings, in this unit.
SENSORS: Mapping[str, tuple[str, float, float]] = {
    "displacement": ("m", convert(1e-4, "in", "m"), convert(1e-4, "in", "m")),
    "velocity": ("m/s", convert(0.02, "in/s", "m/s"), convert(0.01, "in/s", "m/s")),
    "force": ("N", convert(0.5, "lbf", "N"), convert(0.1, "lbf", "N")),
    "temperature": ("K", 0.05, 0.1),
}

#: Start temperature [K] and its rate of change [K/s] for a damper without the channel `warming`; plausible for a short
#: run.
START_TEMPERATURE, WARMING = 300.0, 0.2

#: Start temperature [K] for a damper with the channel `warming`: warmed up to 110 degF before the test (3.2.1).
WARM_START = convert(110.0, "degF", "K")


def measure(
    damper: TruthDamper | PhysicalDamper,
    drivefile: Drivefile,
    *,
    rate: float = RATE,
    actuator: Actuator | None = None,
    seed: int = 0,
) -> TimeSeries:
    """Test a damper with a displacement drive file and return the sensor readings.

    The sensors have no lag. Without an actuator model, the machine follows the command exactly.

    Args:
        damper: Damper to test.
        drivefile: Command with the channel `displacement` [m], finely and evenly sampled.
        rate: Sample rate [Hz].
        actuator: Model of the deviation of the motion from the command.
        seed: Seed of the noise generator.

    Returns:
        displacement [m], velocity [m/s], force [N] (positive in compression), temperature [K].
    """
    motion = actuator.follow(drivefile.series) if actuator else drivefile.series
    return read_out(damper.respond(motion, rate=rate), seed=seed)


def read_out(response: TimeSeries, *, seed: int = 0) -> TimeSeries:
    """Return the sensor readings for a damper's response; see `measure` for arguments and result."""
    generator, channels = np.random.default_rng(seed), {}
    temperature = START_TEMPERATURE + WARMING * (response.time - response.time[0])
    if "warming" in response:
        temperature = WARM_START + response["warming"]
    for name, (unit, noise, resolution) in SENSORS.items():
        values = temperature if name == "temperature" else response[name]
        noisy = values + noise * generator.standard_normal(values.size)
        channels[name] = (unit, resolution * np.round(noisy / resolution))
    return TimeSeries.from_channels(response.time, channels)


# ---- Physical shocks under test, with the files that the dynamometer writes -----------------------------------------

#: Units of a .csv file, as dynamometers write them; a .parquet file is in SI units.
_CSV_UNITS = {"displacement": "in", "velocity": "in/s", "force": "lbf", "temperature": "degF"}
_CSV_DECIMALS = {"time": 4, "displacement": 4, "velocity": 2, "force": 1, "temperature": 1}


@dataclass(frozen=True, slots=True)
class Specimen:
    """A shock under test and its title in files."""

    damper: PhysicalDamper
    title: str

    @classmethod
    def configured(cls, number: int) -> Specimen:
        """Return the shock of a row of Table 3.1."""
        damper, setting = configuration(number), CONFIGURATIONS[number]
        shims = SHIMS_OF_BUILD[setting.build]
        psi = convert(setting.gas_pressure, "Pa", "psi")
        return cls(
            damper,
            f"configuration {number}: build {setting.build} ({shims.compression}/{shims.rebound}, head valve "
            f"{shims.head}), {psi:.0f} psi, {setting.clicks} clicks",
        )

    @classmethod
    def built(cls, build: str, *, clicks: int | None = None, gas: float | None = None) -> Specimen:
        """Return a shock of Table 7.3, such as `C/B`: by default 1 click from fully open and 150 psi [Pa]."""
        gas = convert(150.0, "psi", "Pa") if gas is None else gas
        clicks = 1 if clicks is None else clicks
        damper = shim_build(build, clicks=clicks, gas_pressure=gas)
        nominal = convert(damper.nominal_damping(), "N.s/m", "lbf.s/in")
        title = f"{build}, {convert(gas, 'Pa', 'psi'):.4g} psi, {clicks} clicks"
        return cls(damper, f"{title}; nominal damping {nominal:.1f} lbf/(in/s)")

    def test(self, drivefile: Drivefile, name: str, seed: int, path: Path) -> str:
        """Run a test, write its record as .csv or .parquet, and return a sentence about it."""
        response = self.damper.respond(Actuator().follow(drivefile.series), rate=RATE)
        record = read_out(response, seed=seed)
        note = f"SYNTHETIC: eightpost dyno {__version__}, {self.title}, test {name}, seed {seed}"
        path.parent.mkdir(parents=True, exist_ok=True)
        if path.suffix == ".parquet":
            write_parquet(record, path, note=note)
        else:
            write_csv(record, path, units=_CSV_UNITS, decimals=_CSV_DECIMALS, preamble=(note,))
        return f"{name}: {_summary(response)}; wrote {path}"


def _summary(truth: TimeSeries) -> str:
    force = convert(truth["force"], "N", "lbf")
    cavity = cavitation(truth)
    lowest = convert(cavity.lowest, "Pa", "psi")
    verdict = "cavitates" if cavity.cavitates else "does not cavitate"
    share = f"for {100.0 * cavity.share:.1f} % of the time" if cavity.share else "never"
    return (
        f"{truth.duration:.1f} s at {truth.sample_rate:.0f} Hz, force {force.min():.0f} to {force.max():.0f} lbf, std "
        f"{force.std():.1f} lbf; {verdict} (chamber pressure below 30 kPa {share}, minimum {lowest:.1f} psi absolute)"
    )
