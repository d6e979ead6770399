"""`eightpost dyno`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import click
from rich.console import Console
from rich.markup import escape

from eightpost import __version__
from eightpost.app.options import Quantity, seed_option
from eightpost.errors import InputError, ParameterError
from eightpost.files import check_output_folder

if TYPE_CHECKING:
    from eightpost.rig import PhysicalDamper
    from eightpost.signals import Drivefile, TimeSeries

TESTS = ("random", "sine", "static", "bump", "all")

#: Units of a .csv file, as dynamometers write them; a .parquet file is in SI units.
_CSV_UNITS = {"displacement": "in", "velocity": "in/s", "force": "lbf", "temperature": "degF"}
_CSV_DECIMALS = {"time": 4, "displacement": 4, "velocity": 2, "force": 1, "temperature": 1}


@dataclass(frozen=True, slots=True)
class _Specimen:
    """A damper under test and its title in files."""

    damper: PhysicalDamper
    title: str


@click.command()
@click.option("--configuration", "number", type=int, metavar="1..12",
              help="Row of Table 3.1 that names the shock, e.g. 5. Default: the shock of --build.")  # fmt: skip
@click.option("--build", metavar="COMPRESSION/REBOUND",
              help="Shim codes of Table 7.2 for a shock on a linear piston, as in Table 7.3, e.g. C/B. Default: the "
              "shock of --configuration.")  # fmt: skip
@click.option("--gas", type=Quantity("Pa"), metavar="PRESSURE",
              help="Gauge gas pressure of a --build; default '150 psi'.")  # fmt: skip
@click.option("--clicks", type=int, metavar="0..28",
              help="Rebound bleed of a --build in clicks from fully open, 0 to 28: more clicks close it. Default "
              "1.")  # fmt: skip
@click.option("--test", "test_name", type=click.Choice(TESTS), default="random", show_default=True,
              help="Motion of the dynamometer. all: every test of 3.2.3, each in a file of its own.")  # fmt: skip
@click.option("--amplitude", type=Quantity("m"), metavar="LENGTH",
              help="Amplitude of the sine, e.g. '1 in'; no default: --test sine needs it.")  # fmt: skip
@click.option("--speed", type=Quantity("m/s"), metavar="SPEED",
              help="Peak velocity of the sine, e.g. '10 in/s'; no default: --test sine needs it.")  # fmt: skip
@click.option("--duration", type=Quantity("s"), metavar="TIME",
              help="Length of the random test; default '30 s'. The signal repeats every 10 s.")  # fmt: skip
@seed_option(1, "Seed of the random phases and of the sensor noise.")
@click.option("-o", "--output", type=click.Path(path_type=Path), required=True,
              help="Output file (.csv or .parquet); with --test all, the output folder.")  # fmt: skip
def dyno(  # one parameter per option
    number: int | None,
    build: str | None,
    gas: float | None,
    clicks: int | None,
    test_name: str,
    amplitude: float | None,
    speed: float | None,
    duration: float | None,
    seed: int,
    output: Path,
) -> None:
    """Test a physical shock on the virtual dynamometer; the data are SYNTHETIC.

    The shock model differs from all laws that can be fitted: it has two compressible chambers, shim valves, a head
    valve, gas and friction (docs/dynamometer.md). Position is measured from the 3 in offset; force is positive in
    compression.

    \b
    Examples:
      eightpost dyno --configuration 1 --test random --seed 1 -o dyno.parquet
      eightpost dyno --build C/B --gas '150 psi' --clicks 14 -o c_b.csv
      eightpost dyno --configuration 5 --test sine --amplitude '1 in' --speed '10 in/s' -o sine.parquet
      eightpost dyno --configuration 1 --test all -o tests/
    """
    from eightpost.rig.dynamometer import program

    console = Console()
    _check_options(test_name, amplitude=amplitude, speed=speed, duration=duration)
    specimen = _specimen(number, build, gas, clicks)
    console.print(f"shock: {escape(specimen.title)}", highlight=False, soft_wrap=True)
    if test_name == "all":
        check_output_folder(output)
        for name, drivefile in program(seed=seed).items():
            _run(console, specimen, drivefile, name, seed, output / f"{name}.parquet")
        return
    _check_file(output)
    drivefile = _drivefile(test_name, amplitude=amplitude, speed=speed, duration=duration, seed=seed)
    _run(console, specimen, drivefile, test_name, seed, output)


def _check_options(test_name: str, *, amplitude: float | None, speed: float | None, duration: float | None) -> None:
    """Refuse options that do not apply to the test, and a sine without amplitude and speed."""
    if test_name == "sine" and (amplitude is None or speed is None):
        raise InputError(
            "--test sine needs --amplitude '1 in' and --speed '10 in/s'; --test all runs the sines of Table 3.3"
        )
    if test_name != "sine" and (amplitude is not None or speed is not None):
        raise InputError(f"--amplitude and --speed are options of --test sine; omit them with --test {test_name}")
    if test_name != "random" and duration is not None:
        raise InputError(f"--duration is an option of --test random; omit it with --test {test_name}")


def _specimen(number: int | None, build: str | None, gas: float | None, clicks: int | None) -> _Specimen:
    from eightpost import units
    from eightpost.rig import shim_build

    if (number is None) == (build is None):
        raise InputError("give one shock: --configuration 1 to 12 (Table 3.1), or --build, e.g. C/B")
    if number is not None:
        return _configured(number, gas, clicks)
    gas = units.convert(150.0, "psi", "Pa") if gas is None else gas
    clicks = 1 if clicks is None else clicks
    damper = shim_build(str(build), clicks=clicks, gas_pressure=gas)
    nominal = units.convert(damper.nominal_damping(), "N.s/m", "lbf.s/in")
    title = f"{build}, {units.convert(gas, 'Pa', 'psi'):.4g} psi, {clicks} clicks"
    return _Specimen(damper, f"{title}; nominal damping {nominal:.1f} lbf/(in/s)")


def _configured(number: int, gas: float | None, clicks: int | None) -> _Specimen:
    from eightpost import units
    from eightpost.rig import CONFIGURATIONS, configuration
    from eightpost.rig.damper import SHIMS_OF_BUILD

    if gas is not None or clicks is not None:
        raise InputError("omit --gas and --clicks: Table 3.1 sets them for a --configuration")
    damper, setting = configuration(number), CONFIGURATIONS[number]
    shims = SHIMS_OF_BUILD[setting.build]
    psi = units.convert(setting.gas_pressure, "Pa", "psi")
    return _Specimen(
        damper,
        f"configuration {number}: build {setting.build} ({shims.compression}/{shims.rebound}, head valve "
        f"{shims.head}), {psi:.0f} psi, {setting.clicks} clicks",
    )


def _drivefile(
    test_name: str, *, amplitude: float | None, speed: float | None, duration: float | None, seed: int
) -> Drivefile:
    from eightpost.rig import bump, random_multisine, sine_test, static_steps
    from eightpost.rig.dynamometer import RANDOM_DURATION

    if amplitude is not None and speed is not None:
        return sine_test(amplitude, speed).drivefile
    if test_name == "random":
        seconds = RANDOM_DURATION if duration is None else duration
        if not 0.5 <= seconds <= 600.0:
            raise ParameterError(f"--duration must be 0.5 to 600 s, not {seconds:g} s")
        return random_multisine(seed, duration=seconds)
    return static_steps() if test_name == "static" else bump()


def _check_file(output: Path) -> None:
    if output.suffix not in (".csv", ".parquet"):
        raise InputError(f"{output}: the output must be a .csv or .parquet file; only --test all writes a folder")
    if output.is_dir():
        raise InputError(f"{output} is a folder; name a file in it")


def _run(console: Console, specimen: _Specimen, drivefile: Drivefile, name: str, seed: int, path: Path) -> None:
    """Run a test, write its record and print a summary."""
    from eightpost.rig import Actuator, read_out

    truth = specimen.damper.respond(Actuator().follow(drivefile.series), rate=2000.0)
    note = f"SYNTHETIC: eightpost dyno {__version__}, {specimen.title}, test {name}, seed {seed}"
    _write(read_out(truth, seed=seed), path, note)
    console.print(f"{name}: {_summary(truth)}; wrote {path}", highlight=False, soft_wrap=True)


def _summary(truth: TimeSeries) -> str:
    from eightpost import units
    from eightpost.rig import cavitation

    force = units.convert(truth["force"], "N", "lbf")
    cavity = cavitation(truth)
    lowest = units.convert(cavity.lowest, "Pa", "psi")
    verdict = "cavitates" if cavity.cavitates else "does not cavitate"
    share = f"for {100.0 * cavity.share:.1f} % of the time" if cavity.share else "never"
    return (
        f"{truth.duration:.1f} s at {truth.sample_rate:.0f} Hz, force {force.min():.0f} to {force.max():.0f} lbf, std "
        f"{force.std():.1f} lbf; {verdict} (chamber pressure below 30 kPa {share}, minimum {lowest:.1f} psi absolute)"
    )


def _write(series: TimeSeries, path: Path, note: str) -> None:
    from eightpost.signals.csv_file import write_csv
    from eightpost.signals.parquet_file import write_parquet

    path.parent.mkdir(parents=True, exist_ok=True)
    if path.suffix == ".parquet":
        write_parquet(series, path, note=note)
    else:
        write_csv(series, path, units=_CSV_UNITS, decimals=_CSV_DECIMALS, preamble=(note,))
