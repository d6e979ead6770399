"""`eightpost run`."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import click
from rich.console import Console
from rich.markup import escape
from rich.progress import Progress

import cosim
from cosim.plots import plot_traces
from cosim.ssp import Given
from cosim.system_file import Case, read_case
from eightpost import units
from eightpost.commands.show import show_result, show_verification
from eightpost.errors import InputError, UnknownUnitError
from eightpost.files import check_output_folder
from eightpost.signals import TimeSeries

#: Number of panels of traces.png, and the length that it shows of a long run [s].
_PANELS, _SHOWN = 12, 4.0


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
    """Run a system of coupled FMUs."""
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
    swaps: tuple[str, ...],
    drive: Path | None,
    inputs: tuple[str, ...],
    stop: str | None,
    record_step: str | None,
    algorithm: str | None,
    step: str | None,
    tolerance: float | None,
    isolate: bool,
    compile_missing: bool,
) -> Case:
    """Read the case and apply the options of the command line."""
    given = Given(drive, _seconds(stop, "--stop"), _seconds(record_step, "--record-step"), dict(map(_input, inputs)))
    swapped = dict(_swap(text) for text in swaps)
    case = read_case(path, fmus=swapped, given=given, isolate=isolate, compile_missing=compile_missing)
    chosen, size = case.algorithm, case.step
    if algorithm is not None and algorithm != chosen.name:
        chosen = cosim.SCHEMES[algorithm]
        size = None if isinstance(chosen, cosim.Automatic) else size
    if step is not None:
        size = _seconds(step, "--step")
    if tolerance is not None:
        chosen = _with_tolerance(chosen, tolerance)
    return replace(case, algorithm=chosen, step=size)


def _with_tolerance(algorithm: cosim.Algorithm | cosim.Automatic, percent: float) -> cosim.Algorithm | cosim.Automatic:
    if isinstance(algorithm, cosim.Automatic):
        return replace(algorithm, tolerance=percent)
    if isinstance(algorithm, cosim.Adaptive):
        return replace(algorithm, relative=0.01 * percent)
    raise InputError(f"--tolerance: the algorithm {algorithm.name} has no tolerance; use it with default or adaptive")


def _write(case: Case, result: cosim.Result, output: Path, *, report: bool) -> list[Path]:
    """Write the files of a run and return their paths."""
    paths = [*result.write(output), output / "traces.png"]
    shown, (first, last) = result.series.names[:_PANELS], _window(result.series)
    plot_traces({case.name: result.series}, shown, paths[-1], start=first, stop=last, title=case.name)
    if report:
        from cosim.report import write_report  # noqa: PLC0415 -- most runs write none

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
    with Progress(console=console, transient=True) as progress:
        task = progress.add_task(case.name, total=1.0)
        return cosim.run(
            case.system,
            case.scenario,
            algorithm=case.algorithm,
            step=case.step,
            compared=compared,
            progress=lambda share: progress.update(task, completed=share),
        )


def _window(series: TimeSeries) -> tuple[float, float]:
    """Return the middle four seconds of a long run, or the whole of a short run."""
    last = float(series.time[-1])
    return (0.0, last) if last <= 2.0 * _SHOWN else (0.5 * (last - _SHOWN), 0.5 * (last + _SHOWN))


def _swap(text: str) -> tuple[str, Path]:
    name, equals, path = text.partition("=")
    if not (name and equals and path):
        raise click.BadParameter(f"{text!r}: write it as NAME=FILE", param_hint="--fmu")
    return name, Path(path)


def _input(text: str) -> tuple[str, str]:
    name, equals, value = text.partition("=")
    if not (name and equals and value):
        raise click.BadParameter(f"{text!r}: write it as NAME=VALUE", param_hint="--input")
    return name, value


def _seconds(text: str | None, option: str) -> float | None:
    """Return a time [s] from a number or a value with its unit."""
    if text is None:
        return None
    try:
        return float(text)
    except ValueError:
        pass
    try:
        return units.convert(*units.quantity(text), "s")
    except UnknownUnitError as error:
        raise InputError(f"{option}: {error}") from error
