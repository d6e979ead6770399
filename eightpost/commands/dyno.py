"""`eightpost dyno`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Console
from rich.markup import escape

from eightpost import __version__, units
from eightpost.errors import InputError, ParameterError
from eightpost.files import check_output_folder
from eightpost.rig import (
    CONFIGURATIONS,
    Actuator,
    bump,
    cavitation,
    configuration,
    random_multisine,
    read_out,
    shim_build,
    sine_test,
    static_steps,
)
from eightpost.rig.damper import SHIMS_OF_BUILD
from eightpost.rig.dynamometer import RANDOM_DURATION, program
from eightpost.signals.csv_file import write_csv
from eightpost.signals.parquet_file import write_parquet

if TYPE_CHECKING:
    from eightpost.rig import PhysicalDamper
    from eightpost.signals import Drivefile, TimeSeries

#: Units of a .csv file, as dynamometers write them; a .parquet file is in SI units.
_CSV_UNITS = {"displacement": "in", "velocity": "in/s", "force": "lbf", "temperature": "degF"}
_CSV_DECIMALS = {"time": 4, "displacement": 4, "velocity": 2, "force": 1, "temperature": 1}


@dataclass(frozen=True, slots=True)
class _Specimen:
    """A damper under test and its title in files."""

    damper: PhysicalDamper
    title: str


def dyno(  # one parameter per option
    number: int | None,
    build: str | None,
    gas_text: str | None,
    clicks: int | None,
    test_name: str,
    amplitude: str | None,
    speed: str | None,
    duration: str | None,
    seed: int,
    output: Path,
) -> None:
    """Test a physical shock on the virtual dynamometer; the data are SYNTHETIC."""
    console = Console()
    _check_options(test_name, amplitude=amplitude, speed=speed, duration=duration)
    specimen = _specimen(number, build, gas_text, clicks)
    console.print(f"shock: {escape(specimen.title)}", highlight=False, soft_wrap=True)
    if test_name == "all":
        check_output_folder(output)
        for name, drivefile in program(seed=seed).items():
            _run(console, specimen, drivefile, name, seed, output / f"{name}.parquet")
        return
    _check_file(output)
    drivefile = _drivefile(test_name, amplitude=amplitude, speed=speed, duration=duration, seed=seed)
    _run(console, specimen, drivefile, test_name, seed, output)


def _check_options(test_name: str, *, amplitude: str | None, speed: str | None, duration: str | None) -> None:
    """Refuse options that do not apply to the test, and a sine without amplitude and speed."""
    if test_name == "sine" and not (amplitude and speed):
        raise InputError(
            "--test sine needs --amplitude '1 in' and --speed '10 in/s'; --test all runs the sines of Table 3.3"
        )
    if test_name != "sine" and (amplitude or speed):
        raise InputError(f"--amplitude and --speed are options of --test sine; omit them with --test {test_name}")
    if test_name != "random" and duration:
        raise InputError(f"--duration is an option of --test random; omit it with --test {test_name}")


def _specimen(number: int | None, build: str | None, gas_text: str | None, clicks: int | None) -> _Specimen:
    if (number is None) == (build is None):
        raise InputError("give one shock: --configuration 1 to 12 (Table 3.1), or --build, e.g. C/B")
    if number is not None:
        return _configured(number, gas_text, clicks)
    gas = _si(gas_text or "150 psi", "Pa", "--gas")
    clicks = 1 if clicks is None else clicks
    damper = shim_build(str(build), clicks=clicks, gas_pressure=gas)
    nominal = units.convert(damper.nominal_damping(), "N.s/m", "lbf.s/in")
    title = f"{build}, {units.convert(gas, 'Pa', 'psi'):.4g} psi, {clicks} clicks"
    return _Specimen(damper, f"{title}; nominal damping {nominal:.1f} lbf/(in/s)")


def _configured(number: int, gas_text: str | None, clicks: int | None) -> _Specimen:
    if gas_text is not None or clicks is not None:
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
    test_name: str, *, amplitude: str | None, speed: str | None, duration: str | None, seed: int
) -> Drivefile:
    if test_name == "sine":
        return sine_test(_si(str(amplitude), "m", "--amplitude"), _si(str(speed), "m/s", "--speed")).drivefile
    if test_name == "random":
        seconds = _si(duration, "s", "--duration") if duration else RANDOM_DURATION
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
    truth = specimen.damper.respond(Actuator().follow(drivefile.series), rate=2000.0)
    note = f"SYNTHETIC: eightpost dyno {__version__}, {specimen.title}, test {name}, seed {seed}"
    _write(read_out(truth, seed=seed), path, note)
    console.print(f"{name}: {_summary(truth)}; wrote {path}", highlight=False, soft_wrap=True)


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


def _write(series: TimeSeries, path: Path, note: str) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    if path.suffix == ".parquet":
        write_parquet(series, path, note=note)
    else:
        write_csv(series, path, units=_CSV_UNITS, decimals=_CSV_DECIMALS, preamble=(note,))


def _si(text: str, unit: str, option: str) -> float:
    number, given = units.quantity(text)
    try:
        return units.convert(number, given, unit)
    except InputError as error:
        raise InputError(f"{option} {text!r}: {error}") from error
