"""`eightpost run`."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from rich.console import Console
from rich.markup import escape

from eightpost.app.options import Assignment, Quantity
from eightpost.app.progress import bar
from eightpost.errors import InputError
from eightpost.files import check_output_folder

if TYPE_CHECKING:
    import cosim
    from cosim.system_file import Case
    from eightpost.signals import TimeSeries

SCHEMES = ("default", "jacobi", "gauss-seidel", "implicit", "adaptive")

#: Number of panels of traces.png, and the length that it shows of a long run [s].
_PANELS, _SHOWN = 12, 4.0


@click.command()
@click.argument("case_file", metavar="SYSTEM", type=click.Path(path_type=Path))
@click.option("-o", "--output", type=click.Path(path_type=Path), default=Path("out"), show_default=True,
              help="Output folder for series.parquet, series.csv, result.json and traces.png.")  # fmt: skip
@click.option("--fmu", "swaps", type=Assignment("NAME=FILE"), multiple=True, metavar="NAME=FILE",
              help="Another FMU for a component, e.g. lf=dist/soft.fmu; may be repeated.")  # fmt: skip
@click.option("--drive", type=click.Path(path_type=Path), metavar="FILE",
              help="Drive file for the open inputs of a package; default: none.")  # fmt: skip
@click.option("--input", "inputs", type=Assignment("NAME=VALUE"), multiple=True, metavar="NAME=VALUE",
              help="Constant for an open input of a package, e.g. 'car.aero_force=500 lbf'; may be "
              "repeated.")  # fmt: skip
@click.option("--stop", type=Quantity("s", bare=True), metavar="TIME",
              help="Length of a package's run, e.g. '30 s'; default: stop time of the "
              "package.")  # fmt: skip
@click.option("--record-step", type=Quantity("s", bare=True), metavar="TIME",
              help="Time between recorded samples of a package's run, e.g. '2 ms'; default: every "
              "coupling step.")  # fmt: skip
@click.option("--algorithm", type=click.Choice(SCHEMES),
              help="Coupling algorithm; default: that of the file. The algorithm `default` uses gauss-seidel, or "
              "implicit if gauss-seidel is not stable, and finds a step that meets the tolerance.")  # fmt: skip
@click.option("--step", type=Quantity("s", bare=True), metavar="TIME",
              help="Coupling step, e.g. '1 ms'; default: that of the file or of the "
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
@click.pass_context
def run(
    ctx: click.Context,
    /,
    case_file: Path,
    output: Path,
    verify: bool,
    report: bool,
    no_comparison: bool,
    **options: Any,
) -> None:
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
    import cosim
    from eightpost.app.show import show_result, show_verification

    check_output_folder(output)
    folder = output.absolute()  # an FMU may change the working directory
    case = _case(case_file, **options)
    console = Console()
    for note in case.notes:
        console.print(f"[yellow]note[/] {escape(note)}", highlight=False)
    try:
        result = run_with_progress(console, case, compared=not no_comparison)
    except cosim.RunInterrupted as interrupted:
        result = interrupted.result
    show_result(console, case.name, result)
    if verify and not result.partial:
        verification = cosim.verify(case.system, case.scenario, case.algorithm, result)
        show_verification(console, verification, result)
    paths = _write(case, result, folder, report=report)
    console.print(f"wrote {', '.join(str(output / path.name) for path in paths)}", soft_wrap=True, highlight=False)
    _show_window(console, result)
    ctx.exit(0 if result.acceptable else 1)


def _case(
    path: Path,
    *,
    swaps: tuple[tuple[str, str], ...],
    drive: Path | None,
    inputs: tuple[tuple[str, str], ...],
    stop: float | None,
    record_step: float | None,
    algorithm: str | None,
    step: float | None,
    tolerance: float | None,
    isolate: bool,
    compile_missing: bool,
) -> Case:
    """Read the case and apply the options of the command line."""
    import cosim
    from cosim.ssp import Given
    from cosim.system_file import read_case

    given = Given(drive, stop, record_step, dict(inputs))
    swapped = {name: Path(file) for name, file in swaps}
    case = read_case(path, fmus=swapped, given=given, isolate=isolate, compile_missing=compile_missing)
    chosen, size = case.algorithm, case.step
    if algorithm is not None and algorithm != chosen.name:
        chosen = cosim.SCHEMES[algorithm]
        size = None if isinstance(chosen, cosim.Automatic) else size
    if step is not None:
        size = step
    if tolerance is not None:
        chosen = _with_tolerance(chosen, tolerance)
    return replace(case, algorithm=chosen, step=size)


def _with_tolerance(algorithm: cosim.Algorithm | cosim.Automatic, percent: float) -> cosim.Algorithm | cosim.Automatic:
    import cosim

    if isinstance(algorithm, cosim.Automatic):
        return replace(algorithm, tolerance=percent)
    if isinstance(algorithm, cosim.Adaptive):
        return replace(algorithm, relative=0.01 * percent)
    raise InputError(f"--tolerance: the algorithm {algorithm.name} has no tolerance; use it with default or adaptive")


def _write(case: Case, result: cosim.Result, output: Path, *, report: bool) -> list[Path]:
    """Write the files of a run and return their paths."""
    from cosim.plots import plot_traces

    paths = [*result.write(output), output / "traces.png"]
    shown, (first, last) = result.series.names[:_PANELS], _window(result.series)
    plot_traces({case.name: result.series}, shown, paths[-1], start=first, stop=last, title=case.name)
    if report:
        from cosim.report import write_report

        page = output / "report.html"
        paths.append(write_report(page, result, case.system, case.scenario, title=case.name, files=case.fmus))
    return paths


def _show_window(console: Console, result: cosim.Result) -> None:
    """Print which channels and which part of a run traces.png shows."""
    count, (first, last) = len(result.series.names), _window(result.series)
    console.print(
        f"traces.png shows {min(count, _PANELS)} of {count} channels from {first:g} to {last:g} s", highlight=False
    )


def run_with_progress(console: Console, case: Case, *, compared: bool = True) -> cosim.Result:
    """Run a case with a progress bar; `compared` has the meaning that it has in `cosim.run`."""
    import cosim

    with bar(console, case.name, 1.0) as advance:
        return cosim.run(
            case.system,
            case.scenario,
            algorithm=case.algorithm,
            step=case.step,
            compared=compared,
            progress=advance,
        )


def _window(series: TimeSeries) -> tuple[float, float]:
    """Return the middle four seconds of a long run, or the whole of a short run."""
    last = float(series.time[-1])
    return (0.0, last) if last <= 2.0 * _SHOWN else (0.5 * (last - _SHOWN), 0.5 * (last + _SHOWN))
