"""The options of `eightpost dyno`."""

from __future__ import annotations

from pathlib import Path

import click

from eightpost.verbs.body import body

TESTS = ("random", "sine", "static", "bump", "all")


@click.command()
@click.option("--configuration", "number", type=int, metavar="1..12", help="A shock of Table 3.1, by its row.")
@click.option("--build", metavar="COMPRESSION/REBOUND",
              help="A shock on a linear piston by two codes of Table 7.2, as in Table 7.3: C/B.")  # fmt: skip
@click.option("--gas", "gas_text", metavar="PRESSURE", help="Of a --build, gauge; default '150 psi'.")
@click.option("--clicks", type=int,
              help="Rebound bleed of a --build, 0 to 28 from fully open, more is more closed; default 1.")  # fmt: skip
@click.option("--test", "test_name", type=click.Choice(TESTS), default="random", show_default=True,
              help="all: every test of 3.2.3, a file each, into a folder.")  # fmt: skip
@click.option("--amplitude", metavar="LENGTH", help="Of the sine, as '1 in'.")
@click.option("--speed", metavar="SPEED", help="The sine's peak velocity, as '10 in/s'.")
@click.option("--duration", metavar="TIME", help="Of the random test; default '30 s'. The signal repeats every 10 s.")
@click.option("--seed", type=click.IntRange(min=0), default=1, show_default=True,
              help="Of the random phases and of the sensors' noise.")  # fmt: skip
@click.option("-o", "--output", type=click.Path(path_type=Path), required=True,
              help="A .csv or .parquet file; a folder for all.")  # fmt: skip
@body
def dyno() -> None:
    """Test a physical shock on the virtual dynamometer; the data are SYNTHETIC.

    The shock is none of the laws that are fitted: two compressible chambers, shim valves, head valve, gas, friction
    (docs/dynamometer.md). Position is counted from the 3 in offset; force is positive in compression.

    \b
    Examples:
      eightpost dyno --configuration 1 --test random --seed 1 -o dyno.parquet
      eightpost dyno --build C/B --gas '150 psi' --clicks 14 -o c_b.csv
      eightpost dyno --configuration 5 --test sine --amplitude '1 in' --speed '10 in/s' -o sine.parquet
      eightpost dyno --configuration 1 --test all -o tests/
    """
