"""`eightpost run`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import click
from rich.console import Console

from eightpost import completion
from eightpost.app.options import (
    Assignment,
    FilePath,
    OutputFile,
    OutputFolder,
    Quantity,
    argument,
    check_outputs,
    check_report_folder,
    group,
    option,
    setting,
    verb,
)
from eightpost.app.show import bar, show_files, show_notes, show_result, show_verification
from eightpost.outputs import PICTURE, RECORD, RESULT

if TYPE_CHECKING:
    import cosim
    from cosim.session.run import Case

#: Files that every run writes.
FILES = {"series.parquet": RECORD, "series.csv": RECORD, "result.json": RESULT}

SCHEMES = ("default", "jacobi", "gauss-seidel", "implicit", "adaptive")


@dataclass(frozen=True, slots=True)
class _RunOptions:
    """Options of `eightpost run`."""

    # fmt: off
    case_file: Path = argument("SYSTEM", kind=FilePath())
    output: Path = option(
        "Output folder for series.parquet, series.csv and result.json.",
        "-o", "--output", kind=OutputFolder(FILES), default=Path("out"),
    )
    swaps: tuple[tuple[str, str], ...] = option(
        "Another FMU for a component, e.g. lf=dist/soft.fmu; may be repeated.",
        "--fmu", kind=Assignment("NAME=FILE"), metavar="NAME=FILE",
    )
    drive: Path | None = option(
        "Drive file for the open inputs of a package; default: none.", kind=FilePath(), metavar="FILE"
    )
    inputs: tuple[tuple[str, str], ...] = option(
        "Constant for an open input of a package, e.g. 'car.aero_force=500 lbf'; may be repeated.",
        "--input", kind=Assignment("NAME=VALUE"), metavar="NAME=VALUE",
    )
    algorithm: str | None = option(
        "Coupling algorithm; default: that of the file. The algorithm `default` uses gauss-seidel, or implicit if "
        "gauss-seidel is not stable, and finds a step that meets the tolerance.",
        kind=SCHEMES,
    )
    step: float | None = option(
        "Coupling step, e.g. '1 ms'; default: that of the file or of the algorithm.",
        kind=Quantity("s", bare=True), metavar="TIME",
    )
    tolerance: float | None = option(
        "Tolerated coupling error [%]. Algorithm `default`: of each signal's standard deviation, default 0.2. "
        "Algorithm `adaptive`: of the largest value, in each step, default 0.01.",
        kind=click.FLOAT, metavar="PERCENT",
    )
    isolate: bool = option(
        "Run each FMU in a process of its own. If an FMU crashes or hangs, the run ends with a report of the FMU, the "
        "time and its inputs. Costs about 0.2 ms per step and FMU; the results are identical bit by bit. For FMUs "
        "that you do not trust yet (docs/how_to/foreign_fmus.md).",
    )
    compile_missing: bool = setting(
        "Compile the C sources of an FMU that has no binary for this platform, with the system's C compiler or PyPI's "
        "ziglang. The binary is kept for later runs. The code is that of the FMU's maker: use this only for FMUs "
        "whose maker you trust.",
        "compile", default=False,
    )
    report: bool = option("Write also report.html: the run as one interactive page (docs/how_to/report.md).")
    plot: Path | None = option(
        "Picture of the first 12 channels in the middle of the run; default: none.", kind=OutputFile(PICTURE)
    )
    stop: float | None = setting(
        "Length of a package's run, e.g. '30 s'; default: stop time of the package.", kind=Quantity("s", bare=True)
    )
    record_step: float | None = setting(
        "Time between recorded samples of a package's run, e.g. '2 ms'; default: every coupling step.",
        kind=Quantity("s", bare=True),
    )
    comparison: bool = setting(
        "Run again at another step, so that the coupling error is stated; `no` only if the coupling step is given.",
        default=True,
    )
    verify: bool = setting(
        "Repeat the run at half the coupling step and print the difference of each channel.", default=False
    )
    # fmt: on


@verb
def run(ctx: click.Context, asked: _RunOptions = group(_RunOptions)) -> None:
    """Run a system of coupled FMUs.

    SYSTEM is a TOML file with components, bonds and a scenario; examples/seven_dof.toml is an example with comments.
    SYSTEM may also be an SSP package of any maker (.ssp), or its description (.ssd) in a folder. Whatever the package
    lacks is given by --drive, --input and --set.

    The exit code is 1 if the result is not usable (docs/reference/verdict.md): the coupled start did not converge, the
    coupling error is too large, the coupling creates or loses energy, a model is used far outside its range, or the run
    ended early. Ctrl-C ends a run after the current step: the results so far are written and marked as partial.

    \b
    Examples:
      eightpost run examples/seven_dof.toml -o out/
      eightpost run examples/seven_dof.toml -o out/ --fmu lf=dist/dyno_B.fmu
      eightpost run car.ssp --drive examples/data/track.parquet -o out/
    """
    import cosim
    from cosim.ssp import Given
    from cosim.system_file import read_case
    from eightpost.api.reading import existing_toml

    if asked.report:
        import cosim.report  # refuses a page that cannot be written before the run

        check_report_folder(asked.output, "run")
    if asked.plot is not None:
        import eightpost.report.pictures  # noqa: F401 -- refuses a picture that cannot be drawn before the run
    existing_toml(asked.case_file, "system")
    folder, picture = asked.output.absolute(), asked.plot and asked.plot.absolute()  # an FMU may change the folder
    given = Given(asked.drive, asked.stop, asked.record_step, dict(asked.inputs))
    fmus = {name: Path(file) for name, file in asked.swaps}
    compiles = asked.compile_missing
    case = read_case(asked.case_file, fmus=fmus, given=given, isolate=asked.isolate, compile_missing=compiles)
    check_outputs()  # the files that the system names are now known
    case = case.with_coupling(asked.algorithm, asked.step, asked.tolerance)
    console = Console()
    show_notes(console, case.notes, most=1)
    completion.begin(asked.output)
    try:
        result = run_with_progress(console, case, compared=asked.comparison)
    except cosim.RunInterrupted as interrupted:
        result = interrupted.result
    show_result(console, case.name, result)
    if asked.verify and not result.partial:
        verification = cosim.verify(case.system, case.scenario, case.algorithm, result)
        show_verification(console, verification, result)
    written = [asked.output / path.name for path in result.write(folder)]
    if asked.report:
        page = folder / "report.html"
        cosim.report.write_report(page, result, case.system, case.scenario, title=case.name, files=case.fmus)
        written.append(asked.output / page.name)
    if picture is not None and asked.plot is not None:
        result.series.plot(title=case.name).save(picture)
        written.append(asked.plot)
    show_files(console, written)
    ctx.exit(0 if result.acceptable else 1)


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
