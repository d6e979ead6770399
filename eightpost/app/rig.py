"""`eightpost rig`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click
from rich.console import Console

from eightpost import completion
from eightpost.app.options import OutputFile, Quantity, Verb, car_seed_option, seed_option
from eightpost.app.progress import each
from eightpost.outputs import RECORD

if TYPE_CHECKING:
    from eightpost.rig import RigTest
    from eightpost.virtual.program import Draws

TESTS = ("random", "single", "sine", "bump", "static", "track")
CARS = ("quarter_car", "seven_dof", "eight_post", "flexible")
PROGRAMS = ("identification", "single", "sine", "bump", "static", "track", "all")


@click.command(cls=Verb)
@click.option("--car", "truth", type=click.Choice(CARS), default="eight_post", show_default=True,
              help="Model of the car under test (docs/explanation/rig.md).")  # fmt: skip
@car_seed_option
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
@click.option("--duration", type=Quantity("s", positive=True, most=7200.0), metavar="TIME",
              help="Length of the test, or of the random tests of a program, e.g. '100 s', at most two hours. Default: "
              "random 800 s (quarter car 120 s), single 100 s, bump 50 s (quarter car 60 s), track 33 s, sine "
              "20 s.")  # fmt: skip
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
              help="Friction of the car.")  # fmt: skip
@click.option("--format", "suffix", type=click.Choice(["parquet", "csv"]), default="parquet", show_default=True,
              help="File format of a program's records.")  # fmt: skip
@click.option("-o", "--output", required=True,
              type=OutputFile(RECORD, is_folder=lambda given: given["program_name"] is not None),
              help="Output file (.parquet or .csv); with --program, the output folder.")  # fmt: skip
def rig(  # one parameter per option
    truth: str,
    car_seed: int | None,
    test_name: str,
    program_name: str | None,
    shocks: tuple[str, ...],
    alternate: str,
    draws: Draws,
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

    The model of the car differs from all models that can be identified (docs/explanation/rig.md). The records have the
    channels of Table 6.1 at 1250 Hz.

    \b
    Examples:
      eightpost rig --program identification -o rig/
      eightpost rig --program all --duration '100 s' --shock build:B/B --alternate build:C/C -o rig/
      eightpost rig --test random --duration '100 s' -o baseline.parquet
      eightpost rig --test single --only lf.road -o lf_road.parquet
      eightpost rig --car quarter_car --test random --shock configuration:1 -o quarter.parquet
      eightpost rig --test static --mode warp -o warp.csv
    """
    from eightpost.virtual import program
    from eightpost.virtual.program import Bench
    from eightpost.virtual.shocks import shocks_named

    bench = Bench.of(truth, car_seed=car_seed, friction=friction == "on", noise=noise == "rig", run=run_seed, seed=seed)
    names = bench.shocks(shocks or ("demo:A",))
    shocks_named((*names, alternate))  # an unknown shock is an error before the first test
    console = Console()

    def finish(test: RigTest, path: Path) -> None:
        test.write(path)
        text = f"{bench.summary(test)}; wrote {path}"
        # ':A:' in the names of shocks is not an emoji
        console.print(text, highlight=False, soft_wrap=True, markup=False, emoji=False)

    if program_name is None:
        drivefile = bench.drivefile(
            test_name, seed, duration=duration, only=only, mode=mode, frequency=frequency, amplitude=amplitude
        )
        finish(bench.record(drivefile, names, test_name), output)
        return
    planned = program(program_name, bench.car, seed, duration=duration, draws=draws)
    completion.begin(output)
    # Each record is written when it is done and freed before the next test, because 800 s are large.
    for number, test in each(console, enumerate(planned), "tests", len(planned)):
        finish(bench.record_planned(test, number, names, alternate), output / f"{test.name}.{suffix}")
