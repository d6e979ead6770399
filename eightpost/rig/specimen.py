"""Physical shocks under test on the virtual dynamometer, with the files that it writes."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from eightpost import __version__, units
from eightpost.errors import ParameterError
from eightpost.rig.actuator import Actuator
from eightpost.rig.damper import CONFIGURATIONS, SHIMS_OF_BUILD, PhysicalDamper, cavitation, configuration, shim_build
from eightpost.rig.dynamometer import RANDOM_DURATION, read_out
from eightpost.rig.excitations import bump, random_multisine, sine_test, static_steps
from eightpost.signals.csv_file import write_csv
from eightpost.signals.drivefile import Drivefile
from eightpost.signals.parquet_file import write_parquet
from eightpost.signals.timeseries import TimeSeries

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
        psi = units.convert(setting.gas_pressure, "Pa", "psi")
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
        gas = units.convert(150.0, "psi", "Pa") if gas is None else gas
        clicks = 1 if clicks is None else clicks
        damper = shim_build(build, clicks=clicks, gas_pressure=gas)
        nominal = units.convert(damper.nominal_damping(), "N.s/m", "lbf.s/in")
        title = f"{build}, {units.convert(gas, 'Pa', 'psi'):.4g} psi, {clicks} clicks"
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


def drivefile_of(
    test: str, seed: int, *, amplitude: float | None = None, speed: float | None = None, duration: float | None = None
) -> Drivefile:
    """Return the motion of a test of 3.2.3.

    Args:
        test: Kind of the test: random, sine, static or bump.
        seed: Seed of the random phases.
        amplitude: Amplitude of a sine [m].
        speed: Peak velocity of a sine [m/s].
        duration: Length of a random test [s].
    """
    if amplitude is not None and speed is not None:
        return sine_test(amplitude, speed).drivefile
    if test == "random":
        seconds = RANDOM_DURATION if duration is None else duration
        if not 0.5 <= seconds <= 600.0:
            raise ParameterError(f"--duration must be 0.5 to 600 s, not {seconds:g} s")
        return random_multisine(seed, duration=seconds)
    return static_steps() if test == "static" else bump()


def _summary(truth: TimeSeries) -> str:
    force = units.convert(truth["force"], "N", "lbf")
    cavity = cavitation(truth)
    lowest = units.convert(cavity.lowest, "Pa", "psi")
    verdict = "cavitates" if cavity.cavitates else "does not cavitate"
    share = f"for {100.0 * cavity.share:.1f} % of the time" if cavity.share else "never"
    return (
        f"{truth.duration:.1f} s at {truth.sample_rate:.0f} Hz, force {force.min():.0f} to {force.max():.0f} lbf, std "
        f"{force.std():.1f} lbf; {verdict} (chamber pressure below 30 kPa {share}, minimum {lowest:.1f} psi absolute)"
    )
