"""The options of `eightpost run`."""

from __future__ import annotations

from pathlib import Path

import click

from eightpost.verbs.body import body

SCHEMES = ("default", "jacobi", "gauss-seidel", "implicit", "adaptive")


@click.command()
@click.argument("case_file", metavar="SYSTEM", type=click.Path(path_type=Path))
@click.option("-o", "--output", type=click.Path(path_type=Path), default=Path("out"), show_default=True,
              help="Folder for series.parquet, series.csv, result.json and traces.png.")  # fmt: skip
@click.option("--fmu", "swaps", multiple=True, metavar="NAME=FILE",
              help="Take another FMU for a component: --fmu lf=dist/soft.fmu")  # fmt: skip
@click.option("--drive", type=click.Path(path_type=Path), help="A package's drivefile for its open inputs.")
@click.option("--input", "inputs", multiple=True, metavar="NAME=VALUE",
              help="A constant for a package's open input: --input 'car.aero_force=500 lbf'")  # fmt: skip
@click.option("--stop", metavar="TIME", help="Length of a package's run [s], or as '30 s'.")
@click.option("--record-step", metavar="TIME", help="Time between recorded samples of a package's run [s].")
@click.option("--algorithm", type=click.Choice(SCHEMES),
              help="In place of the file's. The default uses gauss-seidel, or implicit where that is not stable, at a "
              "step that meets the tolerance.")  # fmt: skip
@click.option("--step", metavar="TIME", help="Coupling step in place of the file's or the default's, as '1 ms'.")
@click.option("--no-comparison", is_flag=True,
              help="Make one run only where the step is given. Its coupling error is then not stated.")  # fmt: skip
@click.option("--tolerance", type=float, metavar="PERCENT",
              help="Coupling error that the default aims at, in percent of each signal's standard deviation; of "
              "adaptive: of each step, in percent of the largest value.")  # fmt: skip
@click.option("--verify", is_flag=True,
              help="Run again at half the coupling step and print the difference per channel.")  # fmt: skip
@click.option("--isolate", is_flag=True,
              help="Run each FMU in a process of its own: one that crashes or hangs ends the run with a report of "
              "which, when and with what inputs, and nothing else. A step costs some 0.2 ms more per FMU; the results "
              "are the same to the bit. For FMUs that you do not trust yet (docs/foreign_fmus.md).")  # fmt: skip
@click.option("--compile", "compile_missing", is_flag=True,
              help="Compile the C sources that an FMU carries where it has no binary for this platform, with the "
              "system's C compiler or PyPI's ziglang. What is compiled is kept for the next run. It is the FMU maker's "
              "code: use it for FMUs whose maker you trust.")  # fmt: skip
@click.option(
    "--report", is_flag=True, help="Also write report.html: the run as one interactive page (docs/report.md)."
)
@body
def run() -> None:
    """Run a system of coupled FMUs.

    SYSTEM is a TOML file with components, bonds and a scenario; examples/seven_dof.toml is one with comments. Or it is
    an SSP package of any maker (.ssp), or its description (.ssd) in a folder: what a package lacks comes from
    --drive, --input, --stop and --record-step.

    Exits 1 if the result is not usable (docs/verdict.md): the coupled start did not converge, the coupling error is too
    large, the coupling makes or loses energy, a model is used far outside its range, or the run ended early. Ctrl-C
    ends a run between two steps: what was computed is written and marked partial.

    \b
    Example:
      eightpost run examples/seven_dof.toml -o out/
      eightpost run examples/seven_dof.toml -o out/ --fmu lf=dist/dyno_B.fmu
      eightpost run car.ssp --drive examples/data/track.parquet -o out/
    """
