"""`eightpost run`."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import click
from rich.console import Console
from rich.markup import escape
from rich.progress import Progress
from rich.table import Column, Table

import cosim
from cosim.plots import DISPLAY, plot_traces
from cosim.system_file import Case, read_case
from eightpost import units
from eightpost.files import check_output_folder
from eightpost.signals import TimeSeries

#: Panels of the picture that every run leaves, and how much of a long run it shows [s].
_PANELS, _SHOWN = 12, 4.0


@click.command()
@click.argument("case_file", metavar="SYSTEM", type=click.Path(path_type=Path))
@click.option("-o", "--output", type=click.Path(path_type=Path), default=Path("out"), show_default=True,
              help="Folder for series.parquet, series.csv, result.json and traces.png.")  # fmt: skip
@click.option("--fmu", "swaps", multiple=True, metavar="NAME=FILE",
              help="Take another FMU for a component: --fmu lf=dist/soft.fmu")  # fmt: skip
@click.option("--step", metavar="TIME", help="Coupling step in place of the file's, as '1 ms'.")
@click.option("--algorithm", type=click.Choice(list(cosim.ALGORITHMS)), help="In place of the file's.")
@click.pass_context
def run(
    ctx: click.Context, case_file: Path, output: Path, swaps: tuple[str, ...], step: str | None, algorithm: str | None
) -> None:
    """Run a system of coupled FMUs.

    SYSTEM is a TOML file with components, bonds and a scenario; examples/seven_dof.toml is one with comments.
    Exits 1 if the coupled start did not converge or the coupling makes or loses energy.

    \b
    Example:
      eightpost run examples/seven_dof.toml -o out/
      eightpost run examples/seven_dof.toml -o out/ --fmu lf=dist/dyno_B.fmu
    """
    check_output_folder(output)
    case = read_case(case_file, fmus=dict(_swap(text) for text in swaps))
    if algorithm and algorithm != case.algorithm.name:
        case = replace(case, algorithm=cosim.ALGORITHMS[algorithm])
    if step is not None:
        case = replace(case, step=units.convert(*units.quantity(step), "s"))
    console = Console()
    result = run_with_progress(console, case)
    show_result(console, case.name, result)
    paths = [*result.write(output), output / "traces.png"]
    shown, (start, stop) = result.series.names[:_PANELS], _window(result.series)
    plot_traces({case.name: result.series}, shown, paths[-1], start=start, stop=stop, title=case.name)
    console.print(f"wrote {', '.join(map(str, paths))}", soft_wrap=True, highlight=False)
    console.print(
        f"traces.png shows {len(shown)} of {len(result.series.names)} channels from {start:g} to {stop:g} s",
        highlight=False,
    )
    ctx.exit(0 if result.acceptable else 1)


def run_with_progress(console: Console, case: Case) -> cosim.Result:
    """Run a case behind a progress bar."""
    with Progress(console=console, transient=True) as progress:
        task = progress.add_task(case.name, total=1.0)
        return cosim.run(
            case.system,
            case.scenario,
            algorithm=case.algorithm,
            step=case.step,
            progress=lambda share: progress.update(task, completed=share),
        )


def show_result(console: Console, name: str, result: cosim.Result) -> None:
    """Print how the run went and a table of what was recorded."""
    console.print(
        f"{escape(name)}: {result.steps} steps of {result.step * 1e3:g} ms, {result.algorithm} "
        f"({', '.join(result.order)}), {result.seconds:.1f} s",
        highlight=False,
    )
    console.print(_statistics(result))
    for bond, energy in result.energy.items():
        console.print(f"bond {bond}: energy residual {energy.residual:+.2e} J of {energy.transferred:.3g} J "
                      f"({energy.relative:+.1e})", highlight=False)  # fmt: skip
    for shock, share in result.share_beyond_fit.items():
        if share > 0.0:
            console.print(f"[yellow]note[/] {shock} is beyond its fitted velocities {share:.1%} of the time")
    for tire, share_off in result.share_tire_off.items():
        if share_off:
            console.print(f"[yellow]note[/] {tire} is below zero load {share_off:.1%} of the time: the tire lifts off")
    if any(share is None for share in result.share_tire_off.values()):
        console.print("[yellow]note[/] no static tire force is given, so lift-off cannot be told")
    if result.held_direct:
        console.print(
            f"[yellow]note[/] {len(result.held_direct)} outputs, such as {result.held_direct[0]}, follow an input that "
            "was held over each step: their error is proportional to it (docs/coupling.md; all in result.json)",
            highlight=False,
        )
    for note in result.notes:
        console.print(f"[yellow]note[/] {escape(note)}", highlight=False)


def _window(series: TimeSeries) -> tuple[float, float]:
    """Return four seconds from the middle of a long run, else all of it."""
    last = float(series.time[-1])
    return (0.0, last) if last <= 2.0 * _SHOWN else (0.5 * (last - _SHOWN), 0.5 * (last + _SHOWN))


def _statistics(result: cosim.Result) -> Table:
    table = Table(
        Column("channel", no_wrap=True), "unit", "mean", "RMS", "least", "greatest", caption="RMS about the mean"
    )
    series = result.settled()
    for channel in series.names:
        unit = DISPLAY.get(series.unit(channel), series.unit(channel))
        values = units.convert(series[channel], series.unit(channel), unit)
        numbers = (values.mean(), values.std(), values.min(), values.max())
        table.add_row(channel, unit, *(f"{number:.4g}" for number in numbers))
    return table


def _swap(text: str) -> tuple[str, Path]:
    name, equals, path = text.partition("=")
    if not (name and equals and path):
        raise click.BadParameter(f"{text!r}: write it as NAME=FILE", param_hint="--fmu")
    return name, Path(path)
