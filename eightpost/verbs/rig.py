"""The options of `eightpost rig`."""

from __future__ import annotations

from pathlib import Path

import click

from eightpost.verbs.body import body

TESTS = ("random", "single", "sine", "bump", "static", "track")
CARS = ("quarter_car", "seven_dof", "eight_post")
PROGRAMS = ("identification", "single", "sine", "bump", "static", "track", "all")


@click.command()
@click.option("--car", "truth", type=click.Choice(CARS), default="eight_post", show_default=True,
              help="The truth.")  # fmt: skip
@click.option("--test", "test_name", type=click.Choice(TESTS), default="random", show_default=True,
              help="One drivefile of 4.5.1 or 6.1.3.")  # fmt: skip
@click.option("--program", "program_name", type=click.Choice(PROGRAMS),
              help="Many tests instead, into a folder: identification is the baseline and an alternate at each corner "
              "(6.1.5), sine Table 6.2, all every one of them.")  # fmt: skip
@click.option("--shock", "shocks", multiple=True, metavar="SHOCK",
              help="Once for all corners, or four times in the order lf, rf, lr, rr: 'demo:A' to C, 'configuration:1' "
              "to 12, 'build:C/B', '20 lbf.s/in' for a linear damper, or a shock.json. Default demo:A.")  # fmt: skip
@click.option("--alternate", default="demo:C", show_default=True, metavar="SHOCK",
              help="Of a program: the shock that replaces one after the other.")  # fmt: skip
@click.option("--draws", type=click.Choice(["same", "other"]), default="same", show_default=True,
              help="Of a program: whether the alternate tests repeat the baseline's drivefile.")  # fmt: skip
@click.option("--duration", metavar="TIME",
              help="Default 800 s random (quarter car 120 s), 100 s single, 50 s bump (quarter car 60 s), 33 s track, "
              "20 s sine. In a program: of its random tests.")  # fmt: skip
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
@click.option("--format", "suffix", type=click.Choice(["parquet", "csv"]), default="parquet", show_default=True,
              help="Of a program's files.")  # fmt: skip
@click.option("-o", "--output", type=click.Path(path_type=Path), required=True,
              help="A .parquet or .csv file; the folder of a program.")  # fmt: skip
@body
def rig() -> None:
    """Test a car on the virtual rig; the data are SYNTHETIC.

    The car is none of the models that are identified (docs/rig.md). Channels are those of Table 6.1 at 1250 Hz.

    \b
    Examples:
      eightpost rig --program identification -o rig/
      eightpost rig --program all --duration '100 s' --shock build:B/B --alternate build:C/C -o rig/
      eightpost rig --test random --duration '100 s' -o baseline.parquet
      eightpost rig --test single --only lf.road -o lf_road.parquet
      eightpost rig --car quarter_car --test random --shock configuration:1 -o quarter.parquet
      eightpost rig --test static --mode warp -o warp.csv
    """
