"""`eightpost rig`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import click
from rich.console import Console

from eightpost import __version__, units
from eightpost.errors import InputError, ParameterError
from eightpost.rig import configuration, demo_damper, shim_build
from eightpost.rig.post import (
    NO_DRIFT,
    TRUTHS,
    LinearDamper,
    RigConditions,
    RigSensors,
    bump_drive,
    quarter_random,
    random_drive,
    run_test,
    sine_drive,
    static_drive,
    track_drive,
)
from eightpost.shock.file import read_shock

if TYPE_CHECKING:
    from eightpost.rig.post import Car, RigTest, Shock
    from eightpost.signals import Drivefile

_TESTS = ("random", "single", "sine", "bump", "static", "track")

#: Length of each test that has one to choose [s] (6.1.3).
_LENGTHS = {"random": 800.0, "single": 100.0, "sine": 20.0, "bump": 50.0, "track": 30.0}


@dataclass(frozen=True, slots=True)
class _Options:
    """What the drivefile is made of."""

    test: str
    duration: float
    only: str
    mode: str
    frequency: float
    amplitude: float
    seed: int


@click.command()
@click.option("--car", "truth", type=click.Choice(list(TRUTHS)), default="eight_post", show_default=True,
              help="The truth.")  # fmt: skip
@click.option("--test", "test_name", type=click.Choice(_TESTS), default="random", show_default=True,
              help="The drivefile of 4.5.1 or 6.1.3.")  # fmt: skip
@click.option("--shock", "shocks", multiple=True, metavar="SHOCK",
              help="Once for all corners, or four times in the order lf, rf, lr, rr: 'demo:A' to C, 'configuration:1' "
              "to 12, 'build:C/B', '20 lbf.s/in' for a linear damper, or a shock.json. Default demo:A.")  # fmt: skip
@click.option(
    "--duration", metavar="TIME", help="Default 800 s random, 100 s single, 50 s bump, 30 s track, 20 s sine."
)
@click.option("--only", default="", metavar="INPUT", help="The actuator of a single test (or static), as lf.road.")
@click.option("--mode", default="heave", show_default=True, help="Of sine and static: heave, pitch, roll or warp.")
@click.option("--frequency", default="2 Hz", show_default=True, help="Of the sine.")
@click.option("--amplitude", default="0.5 in", show_default=True, help="Of the sine.")
@click.option("--seed", type=click.IntRange(min=0), default=1, show_default=True, help="Of the drivefile.")
@click.option("--run", "run_seed", type=click.IntRange(min=0), default=0, show_default=True,
              help="Of the sensors' noise and the run-to-run drift: another number is another run.")  # fmt: skip
@click.option("--noise", type=click.Choice(["rig", "none"]), default="rig", show_default=True,
              help="none: perfect sensors and no drift.")  # fmt: skip
@click.option("--friction", type=click.Choice(["on", "off"]), default="on", show_default=True)
@click.option("-o", "--output", type=click.Path(path_type=Path, dir_okay=False), required=True,
              help="A .parquet or .csv file.")  # fmt: skip
def rig(  # one parameter per option
    truth: str,
    test_name: str,
    shocks: tuple[str, ...],
    duration: str | None,
    only: str,
    mode: str,
    frequency: str,
    amplitude: str,
    seed: int,
    run_seed: int,
    noise: str,
    friction: str,
    output: Path,
) -> None:
    """Test a car on the virtual rig; the data are SYNTHETIC.

    The car is none of the models that are identified (docs/rig.md). Channels are those of Table 6.1 at 1250 Hz.

    \b
    Examples:
      eightpost rig --test random --duration '100 s' -o baseline.parquet
      eightpost rig --shock demo:C --shock demo:A --shock demo:A --shock demo:A -o lf_alternate.parquet
      eightpost rig --test single --only lf.road -o lf_road.parquet
      eightpost rig --car quarter_car --test random --duration '120 s' --shock configuration:1 -o quarter.parquet
      eightpost rig --test static --mode warp -o warp.csv
    """
    if output.suffix not in (".parquet", ".csv"):
        raise InputError(f"{output}: write a .parquet or a .csv file")
    car = TRUTHS[truth]() if friction == "on" else TRUTHS[truth]().without_friction()
    length = _si(duration, "s", "--duration") if duration else _LENGTHS.get(test_name, 0.0)
    options = _Options(
        test_name, length, only, mode, _si(frequency, "Hz", "--frequency"), _si(amplitude, "m", "--amplitude"), seed
    )
    names = _per_corner(shocks or ("demo:A",), len(car.corners))
    drivefile = _drivefile(car, options)
    note = f"SYNTHETIC: eightpost rig {__version__}, {truth}, friction {friction}, noise {noise}, drivefile seed {seed}"
    test = run_test(
        car,
        drivefile,
        _shocks(names),
        seed=run_seed,
        sensors=RigSensors() if noise == "rig" else RigSensors.perfect(),
        drift=None if noise == "rig" else NO_DRIFT,
        conditions=RigConditions(drivefile=test_name, shocks=names, synthetic=note),
    )
    test.write(output)
    _say(Console(), car, test, output)


def _per_corner(names: tuple[str, ...], corners: int) -> tuple[str, ...]:
    if len(names) not in (1, corners):
        raise InputError(f"give --shock once or {corners} times, not {len(names)} times")
    return names * corners if len(names) == 1 else names


def _shocks(names: tuple[str, ...]) -> tuple[Shock, ...]:
    made = {name: _shock(name) for name in dict.fromkeys(names)}
    return tuple(made[name] for name in names)


def _shock(name: str) -> Shock:
    kind, _, what = name.partition(":")
    try:
        if kind == "demo" and what:
            return demo_damper(what)
        if kind == "configuration" and what:
            return configuration(int(what))
        if kind == "build" and what:
            return shim_build(what)
    except ValueError as error:
        raise InputError(f"--shock {name}: {error}") from error
    if Path(name).suffix == ".json":
        return read_shock(name).law
    return LinearDamper(_si(name, "N.s/m", "--shock"))


def _drivefile(car: Car, options: _Options) -> Drivefile:
    if options.test == "single" and not options.only:
        raise InputError(f"--test single needs --only, one of {', '.join(car.inputs)}")
    if options.test == "random" and len(car.corners) == 1:
        return quarter_random(options.seed, duration=options.duration)
    if options.test in ("random", "single"):
        active = (options.only,) if options.only else ()
        return random_drive(car, options.seed, duration=options.duration, active=active)
    if options.test == "sine":
        return sine_drive(car, options.frequency, options.amplitude, mode=options.mode, duration=options.duration)
    if options.test == "bump":
        return bump_drive(car, duration=options.duration)
    if options.test == "static":
        return static_drive(car, options.only or options.mode)
    return track_drive(car, options.seed, duration=options.duration)


def _say(console: Console, car: Car, test: RigTest, output: Path) -> None:
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
    )


def _si(text: str, unit: str, option: str) -> float:
    try:
        number, given = units.quantity(text)
        value = units.convert(number, given, unit)
    except InputError as error:
        raise InputError(f"{option} {text!r}: {error}") from error
    if not value > 0.0:
        raise ParameterError(f"{option} must be above 0, not {text!r}")
    return float(value)
