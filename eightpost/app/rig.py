"""`eightpost rig`."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import click
from rich.console import Console

from eightpost import __version__
from eightpost.app.options import Quantity, seed_option
from eightpost.app.progress import each
from eightpost.errors import InputError, ParameterError

if TYPE_CHECKING:
    from eightpost.rig.post import Car, PlannedTest, RigTest, Shock
    from eightpost.signals import Drivefile

TESTS = ("random", "single", "sine", "bump", "static", "track")
CARS = ("quarter_car", "seven_dof", "eight_post")
PROGRAMS = ("identification", "single", "sine", "bump", "static", "track", "all")


# ---- Shocks of the virtual rig, by their names on the command line --------------------------------------------------


def per_corner(names: tuple[str, ...], corners: int) -> tuple[str, ...]:
    """Return one name for each corner, from one name for all or one for each."""
    if len(names) not in (1, corners):
        raise InputError(f"give --shock once or {corners} times, not {len(names)} times")
    return names * corners if len(names) == 1 else names


def shocks_named(names: Iterable[str]) -> dict[str, Shock]:
    """Return each different shock by its name: 'demo:A', 'configuration:1', 'build:C/B', a damping, or a shock.json."""
    return {name: _shock(name) for name in dict.fromkeys(names)}


def _shock(name: str) -> Shock:
    from eightpost.rig import configuration, demo_damper, shim_build
    from eightpost.rig.post import LinearDamper
    from eightpost.shock.file import read_shock

    kind, _, own_name = name.partition(":")
    try:
        if kind == "demo" and own_name:
            return demo_damper(own_name)
        if kind == "configuration" and own_name:
            return configuration(int(own_name))
        if kind == "build" and own_name:
            return shim_build(own_name)
    except ValueError as error:
        raise InputError(f"--shock {name}: {error}") from error
    if Path(name).suffix == ".json":
        return read_shock(name).law
    return LinearDamper(si(name, "N.s/m", "--shock"))


def si(text: str, unit: str, option: str) -> float:
    """Return the positive quantity that was given to an option, in an SI unit."""
    from eightpost import units

    try:
        number, given = units.quantity(text)
        value = units.convert(number, given, unit)
    except InputError as error:
        raise InputError(f"{option} {text!r}: {error}") from error
    if not value > 0.0:
        raise ParameterError(f"{option} must be above 0, not {text!r}")
    return float(value)


# ---- `eightpost rig` ------------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class _Options:
    """Settings of the drive file of a single test; without a duration, that of the dissertation applies."""

    test: str
    duration: float | None
    only: str
    mode: str
    frequency: float
    amplitude: float
    seed: int


@dataclass(frozen=True, slots=True)
class _Rig:
    """Settings common to all tests of a call."""

    car: Car
    noise: str
    run: int
    note: str

    def record(self, drivefile: Drivefile, shocks: Sequence[str], words: str, number: int = 0) -> RigTest:
        """Run a test; each number is another run with its own drift and noise."""
        from eightpost.rig.post import NO_DRIFT, RigConditions, RigSensors, run_test

        bank = shocks_named(shocks)
        return run_test(
            self.car,
            drivefile,
            [bank[name] for name in shocks],
            seed=self.run + number,
            sensors=RigSensors() if self.noise == "rig" else RigSensors.perfect(),
            drift=None if self.noise == "rig" else NO_DRIFT,
            conditions=RigConditions(drivefile=words, shocks=tuple(shocks), synthetic=self.note),
        )


@click.command()
@click.option("--car", "truth", type=click.Choice(CARS), default="eight_post", show_default=True,
              help="Model of the car under test (docs/rig.md).")  # fmt: skip
@click.option("--test", "test_name", type=click.Choice(TESTS), default="random", show_default=True,
              help="Drive file of a single test (4.5.1, 6.1.3).")  # fmt: skip
@click.option("--program", "program_name", type=click.Choice(PROGRAMS),
              help="Series of tests, written into a folder. identification: the baseline, and an alternate shock at "
              "each corner (6.1.5). sine: Table 6.2. all: every test. Default: the one test of --test.")  # fmt: skip
@click.option("--shock", "shocks", multiple=True, metavar="SHOCK",
              help="Shock of all corners, or four shocks in the order lf, rf, lr, rr: demo:A to C, configuration:1 "
              "to 12, build:C/B, a linear damper such as '20 lbf.s/in', or a shock.json. Default demo:A.")  # fmt: skip
@click.option("--alternate", default="demo:C", show_default=True, metavar="SHOCK",
              help="Shock that a program mounts at one corner after the other.")  # fmt: skip
@click.option("--draws", type=click.Choice(["same", "other"]), default="same", show_default=True,
              help="Drive files of a program's alternate tests: the baseline's (same), or other random phases "
              "(other).")  # fmt: skip
@click.option("--duration", type=Quantity("s", positive=True), metavar="TIME",
              help="Length of the test, or of the random tests of a program, e.g. '100 s'. Default: random 800 s "
              "(quarter car 120 s), single 100 s, bump 50 s (quarter car 60 s), track 33 s, sine 20 s.")  # fmt: skip
@click.option("--only", default="", metavar="INPUT",
              help="Actuator of a single or static test, e.g. lf.road; no default for single, --mode for "
              "static.")  # fmt: skip
@click.option("--mode", default="heave", show_default=True,
              help="Mode of a sine or static test: heave, pitch, roll or warp.")  # fmt: skip
@click.option(
    "--frequency",
    type=Quantity("Hz", positive=True),
    default="2 Hz",
    show_default=True,
    metavar="FREQUENCY",
    help="Sine frequency [Hz].",
)
@click.option("--amplitude", type=Quantity("m", positive=True), default="0.5 in", show_default=True, metavar="LENGTH",
              help="Sine amplitude, e.g. '10 mm'.")  # fmt: skip
@seed_option(1, "Seed of the drive file.")
@click.option("--run", "run_seed", type=click.IntRange(min=0), metavar="N", default=0, show_default=True,
              help="Seed of the sensor noise and of the run-to-run drift; another number is another run.")  # fmt: skip
@click.option("--noise", type=click.Choice(["rig", "none"]), default="rig", show_default=True,
              help="Sensors of the rig. none: perfect sensors and no drift.")  # fmt: skip
@click.option("--friction", type=click.Choice(["on", "off"]), default="on", show_default=True,
              help="Friction of the car along its shocks.")  # fmt: skip
@click.option("--format", "suffix", type=click.Choice(["parquet", "csv"]), default="parquet", show_default=True,
              help="File format of a program's records.")  # fmt: skip
@click.option("-o", "--output", type=click.Path(path_type=Path), required=True,
              help="Output file (.parquet or .csv); with --program, the output folder.")  # fmt: skip
def rig(  # one parameter per option
    truth: str,
    test_name: str,
    program_name: str | None,
    shocks: tuple[str, ...],
    alternate: str,
    draws: str,
    duration: float | None,
    only: str,
    mode: str,
    frequency: float,
    amplitude: float,
    seed: int,
    run_seed: int,
    noise: str,
    friction: str,
    suffix: str,
    output: Path,
) -> None:
    """Test a car on the virtual rig; the data are SYNTHETIC.

    The model of the car differs from all models that can be identified (docs/rig.md). The records have the channels of
    Table 6.1 at 1250 Hz.

    \b
    Examples:
      eightpost rig --program identification -o rig/
      eightpost rig --program all --duration '100 s' --shock build:B/B --alternate build:C/C -o rig/
      eightpost rig --test random --duration '100 s' -o baseline.parquet
      eightpost rig --test single --only lf.road -o lf_road.parquet
      eightpost rig --car quarter_car --test random --shock configuration:1 -o quarter.parquet
      eightpost rig --test static --mode warp -o warp.csv
    """
    from eightpost.rig.post import TRUTHS, program

    car = TRUTHS[truth]() if friction == "on" else TRUTHS[truth]().without_friction()
    note = f"SYNTHETIC: eightpost rig {__version__}, {truth}, friction {friction}, noise {noise}, drivefile seed {seed}"
    bench = _Rig(car, noise, run_seed, note)
    names = per_corner(shocks or ("demo:A",), len(car.corners))
    shocks_named((*names, alternate))  # an unknown shock is an error before the first test
    if program_name is not None:
        planned = program(program_name, car, seed, duration=duration, draws="other" if draws == "other" else "same")
        _run_program(bench, planned, names, alternate, (output, suffix))
        return
    _check_file(output)
    test = bench.record(
        _drivefile(car, _Options(test_name, duration, only, mode, frequency, amplitude, seed)), names, test_name
    )
    test.write(output)
    _show(Console(), car, test, output)


def _check_file(output: Path) -> None:
    if output.suffix not in (".parquet", ".csv"):
        raise InputError(f"{output}: the output must be a .parquet or .csv file; only --program writes a folder")


def _run_program(
    bench: _Rig, planned: Sequence[PlannedTest], baseline: tuple[str, ...], alternate: str, target: tuple[Path, str]
) -> None:
    """Run all tests and write each record when it is done; an existing file is replaced."""
    folder, suffix = target
    if folder.exists() and not folder.is_dir():
        raise InputError(f"{folder} is a file; --program needs a folder")
    folder.mkdir(parents=True, exist_ok=True)
    console = Console()
    for number, test in enumerate(each(console, planned, "tests", len(planned))):
        names = [alternate if c == test.alternate else s for c, s in zip(bench.car.corners, baseline, strict=True)]
        _run_planned(bench, test, names, number, folder / f"{test.name}.{suffix}", console)


def _run_planned(
    bench: _Rig, planned: PlannedTest, names: Sequence[str], number: int, output: Path, console: Console
) -> None:
    """Run, write and report one test; its record (800 s are large) is freed before the next test."""
    test = bench.record(planned.draw(), names, planned.drivefile, number)
    test.write(output)
    _show(console, bench.car, test, output)


def _drivefile(car: Car, options: _Options) -> Drivefile:
    from eightpost.rig.post import bump_test, random_drive, random_test, sine_drive, static_drive, track_drive
    from eightpost.rig.post.program import SINGLE, random_length

    duration = options.duration
    if options.test == "single":
        if not options.only:
            raise InputError(f"--test single needs --only, one of {', '.join(car.inputs)}")
        return random_drive(car, options.seed, duration=duration or SINGLE, active=(options.only,))
    if options.test == "random":
        return random_test(car, options.seed, duration=duration or random_length(car))
    if options.test == "sine":
        return sine_drive(car, options.frequency, options.amplitude, mode=options.mode, duration=duration or 20.0)
    if options.test == "bump":
        return bump_test(car, duration=duration)
    if options.test == "static":
        return static_drive(car, options.only or options.mode)
    return track_drive(car, options.seed, duration=duration or 33.0)


def _show(console: Console, car: Car, test: RigTest, output: Path) -> None:
    from eightpost import units

    series = test.series
    loads = [units.convert(series[name].std(), "N", "lbf") for name in car.named("tire_force")]
    speeds = [units.convert(series[name].std(), "m/s", "in/s") for name in car.named("velocity")]
    console.print(
        f"{car.name}, shocks {', '.join(test.conditions.shocks)}: {series.duration:.1f} s at "
        f"{series.sample_rate:.0f} Hz, {len(series.names)} channels; tire force std "
        f"{' '.join(f'{x:.0f}' for x in loads)} lbf, shock velocity std {' '.join(f'{x:.2f}' for x in speeds)} in/s; "
        f"wrote {output}",
        highlight=False,
        soft_wrap=True,
        markup=False,
        emoji=False,  # ':A:' in the names of shocks is not an emoji
    )
