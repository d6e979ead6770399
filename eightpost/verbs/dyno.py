"""Options of `eightpost dyno`."""

from __future__ import annotations

from pathlib import Path

import click

from eightpost.verbs.body import body

TESTS = ("random", "sine", "static", "bump", "all")


@click.command()
@click.option("--configuration", "number", type=int, metavar="1..12",
              help="Row of Table 3.1 that names the shock, e.g. 5. Default: the shock of --build.")  # fmt: skip
@click.option("--build", metavar="COMPRESSION/REBOUND",
              help="Shim codes of Table 7.2 for a shock on a linear piston, as in Table 7.3, e.g. C/B. Default: the "
              "shock of --configuration.")  # fmt: skip
@click.option("--gas", "gas_text", metavar="PRESSURE",
              help="Gauge gas pressure of a --build; default '150 psi'.")  # fmt: skip
@click.option("--clicks", type=int, metavar="0..28",
              help="Rebound bleed of a --build in clicks from fully open, 0 to 28: more clicks close it. Default "
              "1.")  # fmt: skip
@click.option("--test", "test_name", type=click.Choice(TESTS), default="random", show_default=True,
              help="Motion of the dynamometer. all: every test of 3.2.3, each in a file of its own.")  # fmt: skip
@click.option("--amplitude", metavar="LENGTH",
              help="Amplitude of the sine, e.g. '1 in'; no default: --test sine needs it.")  # fmt: skip
@click.option("--speed", metavar="SPEED",
              help="Peak velocity of the sine, e.g. '10 in/s'; no default: --test sine needs it.")  # fmt: skip
@click.option("--duration", metavar="TIME",
              help="Length of the random test; default '30 s'. The signal repeats every 10 s.")  # fmt: skip
@click.option("--seed", type=click.IntRange(min=0), metavar="N", default=1, show_default=True,
              help="Seed of the random phases and of the sensor noise.")  # fmt: skip
@click.option("-o", "--output", type=click.Path(path_type=Path), required=True,
              help="Output file (.csv or .parquet); with --test all, the output folder.")  # fmt: skip
@body
def dyno() -> None:
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
