"""Options of `eightpost run`."""

from __future__ import annotations

from pathlib import Path

import click

from eightpost.verbs.body import body

SCHEMES = ("default", "jacobi", "gauss-seidel", "implicit", "adaptive")


@click.command()
@click.argument("case_file", metavar="SYSTEM", type=click.Path(path_type=Path))
@click.option("-o", "--output", type=click.Path(path_type=Path), default=Path("out"), show_default=True,
              help="Output folder for series.parquet, series.csv, result.json and traces.png.")  # fmt: skip
@click.option("--fmu", "swaps", multiple=True, metavar="NAME=FILE",
              help="Another FMU for a component, e.g. lf=dist/soft.fmu; may be repeated.")  # fmt: skip
@click.option("--drive", type=click.Path(path_type=Path), metavar="FILE",
              help="Drive file for the open inputs of a package; default: none.")  # fmt: skip
@click.option("--input", "inputs", multiple=True, metavar="NAME=VALUE",
              help="Constant for an open input of a package, e.g. 'car.aero_force=500 lbf'; may be "
              "repeated.")  # fmt: skip
@click.option("--stop", metavar="TIME",
              help="Length of a package's run [s], or with a unit, e.g. '30 s'; default: stop time of the "
              "package.")  # fmt: skip
@click.option("--record-step", metavar="TIME",
              help="Time between recorded samples of a package's run [s], or with a unit, e.g. '2 ms'; default: every "
              "coupling step.")  # fmt: skip
@click.option("--algorithm", type=click.Choice(SCHEMES),
              help="Coupling algorithm; default: that of the file. The algorithm `default` uses gauss-seidel, or "
              "implicit if gauss-seidel is not stable, and finds a step that meets the tolerance.")  # fmt: skip
@click.option("--step", metavar="TIME",
              help="Coupling step [s], or with a unit, e.g. '1 ms'; default: that of the file or of the "
              "algorithm.")  # fmt: skip
@click.option("--no-comparison", is_flag=True,
              help="Run once only if the coupling step is given. The coupling error is then not stated.")  # fmt: skip
@click.option("--tolerance", type=float, metavar="PERCENT",
              help="Tolerated coupling error [%]. Algorithm `default`: of each signal's standard deviation, default "
              "0.2. Algorithm `adaptive`: of the largest value, in each step, default 0.01.")  # fmt: skip
@click.option("--verify", is_flag=True,
              help="Repeat the run at half the coupling step and print the difference of each channel.")  # fmt: skip
@click.option("--isolate", is_flag=True,
              help="Run each FMU in a process of its own. If an FMU crashes or hangs, the run ends with a report of "
              "the FMU, the time and its inputs. Costs about 0.2 ms per step and FMU; the results are identical bit "
              "by bit. For FMUs that you do not trust yet (docs/foreign_fmus.md).")  # fmt: skip
@click.option("--compile", "compile_missing", is_flag=True,
              help="Compile the C sources of an FMU that has no binary for this platform, with the system's C compiler "
              "or PyPI's ziglang. The binary is kept for later runs. The code is that of the FMU's maker: use this "
              "only for FMUs whose maker you trust.")  # fmt: skip
@click.option("--report", is_flag=True,
              help="Write also report.html: the run as one interactive page (docs/report.md).")  # fmt: skip
@body
def run() -> None:
    """Run a system of coupled FMUs.

    SYSTEM is a TOML file with components, bonds and a scenario; examples/seven_dof.toml is an example with comments.
    SYSTEM may also be an SSP package of any maker (.ssp), or its description (.ssd) in a folder. Whatever the package
    lacks is given by --drive, --input, --stop and --record-step.

    The exit code is 1 if the result is not usable (docs/verdict.md): the coupled start did not converge, the coupling
    error is too large, the coupling creates or loses energy, a model is used far outside its range, or the run ended
    early. Ctrl-C ends a run after the current step: the results so far are written and marked as partial.

    \b
    Examples:
      eightpost run examples/seven_dof.toml -o out/
      eightpost run examples/seven_dof.toml -o out/ --fmu lf=dist/dyno_B.fmu
      eightpost run car.ssp --drive examples/data/track.parquet -o out/
    """
