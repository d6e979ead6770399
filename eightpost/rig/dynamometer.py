"""Virtual dynamometer: tests, shocks under test, actuator and sensors."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np

from eightpost import __version__
from eightpost.array_types import Array
from eightpost.errors import ParameterError
from eightpost.rig.damper import CONFIGURATIONS, SHIMS_OF_BUILD, PhysicalDamper, cavitation, configuration, shim_build
from eightpost.rig.excitations import bump, random_multisine, sine_test, sine_tests, static_steps
from eightpost.signals.csv_file import write_csv
from eightpost.signals.drivefile import Drivefile
from eightpost.signals.parquet_file import write_parquet
from eightpost.signals.timeseries import TimeSeries
from eightpost.units import convert

# ---- Tests of the virtual dynamometer and their drive files, by name (dissertation 3.2.3) ---------------------------

#: Length of the random test [s].
RANDOM_DURATION = 30.0

#: Peak displacement of the random test, and the largest one for which the shock has travel [m].
RANDOM_PEAK, LARGEST_PEAK = convert(1.0, "in", "m"), convert(2.0, "in", "m")


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


def drivefile_of(
    test: str, seed: int, *, amplitude: float | None = None, speed: float | None = None, duration: float | None = None
) -> Drivefile:
    """Return the motion of a test of 3.2.3.

    Args:
        test: Kind of the test: random, sine, static or bump.
        seed: Seed of the random phases.
        amplitude: Amplitude of a sine, or peak displacement of a random test [m].
        speed: Peak velocity of a sine [m/s].
        duration: Length of a random test [s].

    Raises:
        ParameterError: The duration or the peak displacement of a random test, or the speed of a sine is out of range.
    """
    if amplitude is not None and speed is not None:
        return sine_test(amplitude, speed).drivefile
    if test == "random":
        seconds = RANDOM_DURATION if duration is None else duration
        peak = RANDOM_PEAK if amplitude is None else amplitude
        if not 0.5 <= seconds <= 600.0:
            raise ParameterError(f"--duration must be 0.5 to 600 s, not {seconds:g} s")
        if not 0.0 < peak <= LARGEST_PEAK:
            inches = convert(peak, "m", "in")
            raise ParameterError(f"--amplitude of the random test must be above 0 and at most 2 in, not {inches:g} in")
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


class Damper(Protocol):
    """Interface of a damper that the dynamometer can test."""

    def respond(self, motion: TimeSeries, *, rate: float) -> TimeSeries:
        """Return displacement [m], velocity [m/s], force [N] and optional channels for a displacement command [m].

        An optional channel `warming` [K] is the temperature rise of the body since the start.
        """
        ...


@dataclass(frozen=True, slots=True)
class Sensor:
    """A sensor that adds white noise and rounds to its resolution."""

    noise: float  #: Standard deviation of the noise, in the channel's SI unit.
    resolution: float  #: Step between readings, in the channel's SI unit.

    def read(self, values: Array, generator: np.random.Generator) -> Array:
        """Return the readings (N,) of `values` (N,)."""
        noisy = values + self.noise * generator.standard_normal(values.size)
        return np.asarray(self.resolution * np.round(noisy / self.resolution), dtype=np.float64)


@dataclass(frozen=True, slots=True)
class Sensors:
    """Sensors of a dynamometer; the default resolutions are 0.1 lbf, 0.0001 in, 0.01 in/s and 0.1 K."""

    displacement: Sensor = Sensor(convert(1e-4, "in", "m"), convert(1e-4, "in", "m"))  #: Displacement sensor [m].
    velocity: Sensor = Sensor(convert(0.02, "in/s", "m/s"), convert(0.01, "in/s", "m/s"))  #: Velocity sensor [m/s].
    force: Sensor = Sensor(convert(0.5, "lbf", "N"), convert(0.1, "lbf", "N"))  #: Load cell [N].
    temperature: Sensor = Sensor(0.05, 0.1)  #: Temperature sensor [K].


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
        """Return a shock of Table 7.3.

        Args:
            build: Shim codes, such as `C/B`.
            clicks: Rebound bleed in clicks from fully open; None: 1.
            gas: Gauge gas pressure [Pa]; None: 150 psi.
        """
        gas = convert(150.0, "psi", "Pa") if gas is None else gas
        clicks = 1 if clicks is None else clicks
        damper = shim_build(build, clicks=clicks, gas_pressure=gas)
        nominal = convert(damper.nominal_damping(), "N.s/m", "lbf.s/in")
        title = f"{build}, {convert(gas, 'Pa', 'psi'):.4g} psi, {clicks} clicks"
        return cls(damper, f"{title}; nominal damping {nominal:.1f} lbf/(in/s)")

    def test(self, drivefile: Drivefile, name: str, seed: int, path: Path) -> str:
        """Run a test and write its record.

        Args:
            drivefile: Motion of the dynamometer.
            name: Name of the test.
            seed: Seed of the sensor noise.
            path: Record to write, .csv or .parquet.

        Returns:
            A sentence about the test.
        """
        response = self.damper.respond(Actuator().follow(drivefile.series), rate=2000.0)
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
