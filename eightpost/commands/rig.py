"""`eightpost rig`."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Console
from rich.progress import Progress

from eightpost import __version__, units
from eightpost.errors import InputError, ParameterError
from eightpost.rig import configuration, demo_damper, shim_build
from eightpost.rig.post import (
    NO_DRIFT,
    TRUTHS,
    LinearDamper,
    RigConditions,
    RigSensors,
    bump_test,
    program,
    random_drive,
    random_test,
    run_test,
    sine_drive,
    static_drive,
    track_drive,
)
from eightpost.rig.post.program import SINGLE, random_length
from eightpost.shock.file import read_shock

if TYPE_CHECKING:
    from eightpost.rig.post import Car, PlannedTest, RigTest, Shock
    from eightpost.signals import Drivefile


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


def rig(  # one parameter per option
    truth: str,
    test_name: str,
    program_name: str | None,
    shocks: tuple[str, ...],
    alternate: str,
    draws: str,
    duration: str | None,
    only: str,
    mode: str,
    frequency: str,
    amplitude: str,
    seed: int,
    run_seed: int,
    noise: str,
    friction: str,
    suffix: str,
    output: Path,
) -> None:
    """Test a car on the virtual rig; the data are SYNTHETIC."""
    car = TRUTHS[truth]() if friction == "on" else TRUTHS[truth]().without_friction()
    note = f"SYNTHETIC: eightpost rig {__version__}, {truth}, friction {friction}, noise {noise}, drivefile seed {seed}"
    bench = _Rig(car, noise, run_seed, note)
    names = per_corner(shocks or ("demo:A",), len(car.corners))
    shocks_named((*names, alternate))  # an unknown shock is an error before the first test
    length = si(duration, "s", "--duration") if duration else None
    if program_name is not None:
        planned = program(program_name, car, seed, duration=length, draws="other" if draws == "other" else "same")
        _run_program(bench, planned, names, alternate, (output, suffix))
        return
    _check_file(output)
    sine = (si(frequency, "Hz", "--frequency"), si(amplitude, "m", "--amplitude"))
    test = bench.record(_drivefile(car, _Options(test_name, length, only, mode, *sine, seed)), names, test_name)
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
    with Progress(console=console, transient=True) as progress:
        task = progress.add_task("tests", total=len(planned))
        for number, test in enumerate(planned):
            progress.update(task, description=test.name)
            names = [alternate if c == test.alternate else s for c, s in zip(bench.car.corners, baseline, strict=True)]
            _run_planned(bench, test, names, number, folder / f"{test.name}.{suffix}", console)
            progress.advance(task)


def _run_planned(
    bench: _Rig, planned: PlannedTest, names: Sequence[str], number: int, output: Path, console: Console
) -> None:
    """Run, write and report one test; its record (800 s are large) is freed before the next test."""
    test = bench.record(planned.draw(), names, planned.drivefile, number)
    test.write(output)
    _show(console, bench.car, test, output)


def _drivefile(car: Car, options: _Options) -> Drivefile:
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
