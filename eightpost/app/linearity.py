"""`eightpost linearity`: where a linear model can predict a car on the rig."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click
from rich.box import SIMPLE
from rich.console import Console

from eightpost import completion
from eightpost.app.options import FilePath, OutputFolder, Quantity, Verb, map_option
from eightpost.app.progress import each
from eightpost.report.console import Table, console_table

if TYPE_CHECKING:
    from eightpost.ident.linearity import Linearity
    from eightpost.rig import RigTest
    from eightpost.signals import ChannelMap


@click.command(cls=Verb)
@click.argument("files", metavar="RIG...", nargs=-1, required=True, type=FilePath())
@map_option("docs/how_to/rig_data.md")
@click.option("--preparation", "how_file", type=FilePath(), metavar="TOML",
              help="File with rate, delays, geometry and other settings (docs/how_to/rig_data.md); default: "
              "decimation to 125 Hz only.")  # fmt: skip
@click.option("--width", type=Quantity("Hz", bare=True), default="0.5 Hz", show_default=True, metavar="FREQUENCY",
              help="Width of the frequency bands in which the noise is estimated.")  # fmt: skip
@click.option("--high", type=Quantity("Hz", bare=True), default="25 Hz", show_default=True, metavar="FREQUENCY",
              help="Highest frequency to judge.")  # fmt: skip
@click.option("--coherence", default=0.5, show_default=True, metavar="0..1",
              help="Lower limit of a high coherence, 0 to 1.")  # fmt: skip
@click.option("--level", default=-20.0, show_default=True, metavar="DB",
              help="Lower limit of a high response [dB], relative to the output's largest response.")  # fmt: skip
@click.option("--output", "outputs", multiple=True, metavar="CHANNEL",
              help="Output to judge, e.g. lf.tire_force; may be repeated. Default: shock velocities, tire forces and "
              "ride heights.")  # fmt: skip
@click.option("-o", "folder", default="linearity", show_default=True, type=OutputFolder(),
              help="Output folder.")  # fmt: skip
def linearity(
    files: tuple[Path, ...],
    channel_map: ChannelMap | None,
    how_file: Path | None,
    width: float,
    high: float,
    coherence: float,
    level: float,
    outputs: tuple[str, ...],
    folder: Path,
) -> None:
    """Judge where a linear model can predict a car on the rig: coherence against response energy.

    This is Table 6.4 of the dissertation. RIG files are tests with one actuator each, at one amplitude or at several.
    Optionally, a baseline test with all actuators may follow, and then tests of the same drive with another shock at
    one corner each. The exit code is 0 if a linear model predicts all high responses, and 1 if it misses one (Condition
    III, or a response that changes with the amplitude).

    \b
    Example:
      eightpost rig --test single --only lf.road -o rig/lf_road.parquet
      eightpost rig --test single --only rf.road -o rig/rf_road.parquet
      eightpost linearity rig/*.parquet -o linearity/
    """
    from eightpost.ident.linearity import Condition, Thresholds, judge_linearity
    from eightpost.ident.linearity_plots import plot_conditions, plot_output, write_effects, write_paths
    from eightpost.ident.preparation import prepare, read_preparation
    from eightpost.ident.vehicle.estimators import LocalPolynomial

    console = Console(soft_wrap=True, highlight=False)
    how = read_preparation(how_file) if how_file else None
    completion.begin(folder)
    prepared = prepare(_tests(files, channel_map), how)
    for line in prepared.summary():
        console.print(line, markup=False)
    recipe = LocalPolynomial.of_width(width, high)
    assessment = judge_linearity(prepared, outputs=outputs, recipe=recipe, thresholds=Thresholds(coherence, level))
    _show(console, assessment)
    written = [folder / "paths.csv", folder / "conditions.png"]
    write_paths(written[0], assessment, sources=prepared.sources)
    plot_conditions(assessment, written[1])
    for output in assessment.outputs:
        written.append(folder / f"{output}.png")
        plot_output(assessment, output, written[-1])
    if assessment.effects:
        written.append(folder / "amplitude.csv")
        write_effects(written[-1], assessment)
    console.print(f"wrote {', '.join(str(path) for path in written)}", markup=False)
    lost = any(each.condition is Condition.III for each in assessment.verdicts)
    click.get_current_context().exit(int(lost or any(effect.is_notable for effect in assessment.effects)))


def _tests(files: Sequence[Path], channel_map: ChannelMap | None) -> Iterator[RigTest]:
    from eightpost.rig import read_rig_test

    for path in each(Console(stderr=True), files, "reading", len(files)):
        yield read_rig_test(path, channel_map=channel_map)


def _show(console: Console, assessment: Linearity) -> None:
    from eightpost.ident.linearity import Condition
    from eightpost.units import convert

    console.print(_condition_table(assessment))
    for kind in Condition:
        console.print(f"{kind.name}: {kind.meaning}", markup=False)
    for output in assessment.outputs:
        lost = max(
            (each for each in assessment.verdicts if each.output == output), key=lambda v: v.shares[Condition.III]
        )
        share = convert(lost.shares[Condition.III], "1", "%")
        if share >= 1.0:
            console.print(
                f"{output}: {share:.1f} % of its energy from {lost.input} is not predictable (III)", markup=False
            )
    for effect in assessment.effects:
        if effect.is_notable:
            console.print(str(effect), markup=False)
    for note in assessment.notes:
        console.print(f"note: {note}", markup=False)


def _condition_table(assessment: Linearity) -> Table:
    """Return a table with condition and mean coherence of every path, a row for each output."""
    rows = []
    for output in assessment.outputs:
        verdicts = [assessment.verdict(output, name) for name in assessment.inputs]
        rows.append((output, *(f"{each.condition.name}\n{each.coherence:.2f}" for each in verdicts)))
    return console_table(["output", *(name.replace(".", "\n") for name in assessment.inputs)], rows, box=SIMPLE)
