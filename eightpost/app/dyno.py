"""`eightpost dyno`."""

from __future__ import annotations

from pathlib import Path

import click
from rich.console import Console
from rich.markup import escape

from eightpost import completion
from eightpost.app.options import OutputFile, Quantity, Verb, seed_option
from eightpost.errors import InputError
from eightpost.outputs import RECORD

TESTS = ("random", "sine", "static", "bump", "all")


@click.command(cls=Verb)
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
              help="Amplitude of the sine, e.g. '1 in', which --test sine needs; or peak displacement of the random "
              "test, default '1 in'.")  # fmt: skip
@click.option("--speed", type=Quantity("m/s"), metavar="SPEED",
              help="Peak velocity of the sine, e.g. '10 in/s'; no default: --test sine needs it.")  # fmt: skip
@click.option("--duration", type=Quantity("s"), metavar="TIME",
              help="Length of the random test; default '30 s'. The signal repeats every 10 s.")  # fmt: skip
@seed_option(1, "Seed of the random phases and of the sensor noise.")
@click.option("-o", "--output", required=True,
              type=OutputFile(RECORD, is_folder=lambda given: given["test_name"] == "all"),
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
    valve, gas and friction (docs/explanation/dynamometer.md). Position is measured from the 3 in offset; force is
    positive in compression.

    \b
    Examples:
      eightpost dyno --configuration 1 --test random --seed 1 -o dyno.parquet
      eightpost dyno --build C/B --gas '150 psi' --clicks 14 -o c_b.csv
      eightpost dyno --configuration 5 --test sine --amplitude '1 in' --speed '10 in/s' -o sine.parquet
      eightpost dyno --build C/B --amplitude '0.5 in' --seed 7 -o as_on_the_lap.parquet
      eightpost dyno --configuration 1 --test all -o tests/
    """
    from eightpost.virtual.dynamometer import Specimen, drivefile_of, program

    console = Console()
    _check_options(test_name, amplitude=amplitude, speed=speed, duration=duration)
    if number is None and build is not None:
        specimen = Specimen.built(build, clicks=clicks, gas=gas)
    elif number is not None and build is None:
        if gas is not None or clicks is not None:
            raise InputError("omit --gas and --clicks: Table 3.1 sets them for a --configuration")
        specimen = Specimen.configured(number)
    else:
        raise InputError("give one shock: --configuration 1 to 12 (Table 3.1), or --build, e.g. C/B")
    console.print(f"shock: {escape(specimen.title)}", highlight=False, soft_wrap=True)
    if test_name == "all":
        completion.begin(output)
        tests = {name: (drive, output / f"{name}.parquet") for name, drive in program(seed=seed).items()}
    else:
        drive = drivefile_of(test_name, seed, amplitude=amplitude, speed=speed, duration=duration)
        tests = {test_name: (drive, output)}
    for name, (drive, path) in tests.items():
        console.print(specimen.test(drive, name, seed, path), highlight=False, soft_wrap=True)


def _check_options(test_name: str, *, amplitude: float | None, speed: float | None, duration: float | None) -> None:
    """Refuse options that do not apply to the test, and a sine without amplitude and speed."""
    if test_name == "sine" and (amplitude is None or speed is None):
        raise InputError(
            "--test sine needs --amplitude '1 in' and --speed '10 in/s'; --test all runs the sines of Table 3.3"
        )
    if test_name != "sine" and speed is not None:
        raise InputError(f"--speed is an option of --test sine; omit it with --test {test_name}")
    if test_name not in ("sine", "random") and amplitude is not None:
        raise InputError(f"--amplitude is an option of --test sine and random; omit it with --test {test_name}")
    if test_name != "random" and duration is not None:
        raise InputError(f"--duration is an option of --test random; omit it with --test {test_name}")
