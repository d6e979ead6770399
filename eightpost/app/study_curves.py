"""`eightpost study shapes` and `clicks`: curves to aim at, and the clicks that come closest to one."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import click
from rich.console import Console

from eightpost import completion
from eightpost.app.options import (
    WORKERS,
    Assignment,
    FilePath,
    Number,
    OutputFile,
    OutputFolder,
    Quantity,
    argument,
    group,
    option,
    setting,
    verb,
)
from eightpost.app.study import FILES, begin, opened
from eightpost.errors import InputError
from eightpost.outputs import AIM, PAGE, PICTURE

if TYPE_CHECKING:
    from eightpost.api.shapes import Aim
    from eightpost.ident.shock.clicks import Level


@dataclass(frozen=True, slots=True)
class ShapeOptions:
    """Options of `eightpost study shapes`."""

    # fmt: off
    study_file: Path = argument("STUDY", kind=FilePath())
    output: Path = option(
        "Output folder for the page, shapes.json, the shock files of the targets and intermediate results.",
        "-o", "--output", kind=OutputFolder({**FILES, "shapes.json": AIM, "shapes.html": PAGE}), default=Path("out"),
    )
    objective: str | None = option(
        "Measure to minimise; default: the objective of the study.", "--for", metavar="MEASURE"
    )
    corners: tuple[str, ...] = option(
        "Corner whose shock is searched, with those that are alike; may be repeated. Default: all. Other corners keep "
        "the builds of the best setup of the bank.",
        "--at", metavar="CORNER",
    )
    vary: tuple[str, ...] = option(
        "Number of the shape that varies, e.g. rebound.low; may be repeated. Default: the ten numbers of the curve.",
        metavar="NUMBER",
    )
    limits: tuple[tuple[str, str], ...] = option(
        "Limits of a number with their units, e.g. 'rebound.knee=1 in/s,6 in/s'; may be repeated. Default: the range "
        "over the builds of the bank.",
        "--limit", kind=Assignment("NUMBER=LOW,HIGH"), metavar="NUMBER=LOW,HIGH",
    )
    workers: int | str | None = WORKERS
    tolerance: float = setting(
        "Standard deviation of every number from shock to shock, as a share of its value.",
        kind=Quantity("1"), default="3 %",
    )
    draws: int = setting(
        "Number of draws of the tolerance; 0: shocks exactly as planned.", kind=click.IntRange(min=0), default=6
    )
    weight: float = setting(
        "Number of standard deviations, 0 to 10, that are added to the mean of the objective.",
        kind=Number(0.0, 10.0), default=1.0,
    )
    keep: float = setting("Share of the gain that the band keeps.", kind=Quantity("1", positive=True), default="80 %")
    starts: int = setting(
        "Number of starts: the best of the bank, the baseline, and random ones.", kind=click.IntRange(min=1), default=3
    )
    sure: bool = setting(
        "Account for the errors that the vehicle states, and for the rig runs in the folder.", "certainty", default=True
    )
    seed: int = setting("Seed of the random starts.", kind=click.IntRange(min=0), default=0)
    # fmt: on


@verb
def shapes(ctx: click.Context, asked: ShapeOptions = group(ShapeOptions)) -> None:
    """Find the shock curves to aim at: the best shapes for a study, also ones that nobody has built.

    STUDY is the TOML file of `eightpost study` with shock files in its bank. A shape has a few numbers: bleed, knee,
    low- and high-speed slopes of each side, lag and gas. The search varies them at each corner within the range of the
    bank, under the constraints of the study, and minimises mean plus scatter of the objective over the tolerance. The
    page states the target curves with a band that keeps most of the gain, the nearest builds of the bank, and the
    shims, bleed and clicks of the virtual damper that come closest. The errors that an identified vehicle states are
    drawn too, so that the gain is stated with a probability. The targets are run as FMUs of their own. The page of the
    study is written too; both pages link to each other. The exit code is 1 if the targets are not better than the best
    setup of the bank, or if Ctrl-C stopped the search: completed runs of the bank are kept.

    \b
    Examples:
      eightpost study shapes examples/identified/study.toml -o out/
      eightpost study shapes examples/study.toml -o out/ --at lr --vary rebound.low --vary rebound.high
      eightpost study shapes examples/study.toml -o out/ --limit 'compression.low=10 lbf.s/in,60 lbf.s/in'
    """
    from cosim.study.choice.shape_search import Robustness
    from eightpost.api.shape_page import aim_verdict
    from eightpost.api.shapes import Request, bank_plan, searched_groups
    from eightpost.app.show import show_files, show_text, show_verdict
    from eightpost.shock.shape import CURVE_NUMBERS

    console = Console()
    request = Request(
        vary=asked.vary or CURVE_NUMBERS,
        limits=_limits(asked.limits),
        corners=asked.corners,
        tolerance=asked.tolerance,
        robustness=Robustness(asked.draws, asked.weight),
        starts=asked.starts,
        keep=asked.keep,
        objective=asked.objective or "",
        seed=asked.seed,
        uncertain=asked.sure,
    )
    folder = opened(console, asked.study_file, asked.output, asked.workers)
    searched_groups(folder.study, asked.corners)
    if asked.objective is not None:
        folder.study.measure(asked.objective)
    begin(console, folder, bank_plan(folder.sweep))
    try:
        found = folder.shapes(request)
    except KeyboardInterrupt:
        show_text(console, "stopped: no targets were written; completed runs of the bank are kept, those of the search "
                  "are not; run the command again with the same folder")  # fmt: skip
        completion.abandon()
        ctx.exit(1)
    _show(console, found)
    show_verdict(console, aim_verdict(found))
    show_files(console, [asked.output / "shapes.json", asked.output / "shapes.html", folder.write_page()])
    ctx.exit(0 if aim_verdict(found).is_acceptable else 1)


def _limits(stated: tuple[tuple[str, str], ...]) -> dict[str, tuple[float, float]]:
    """Return limits in SI by number."""
    from eightpost import units
    from eightpost.shock.shape import NUMBERS, unit_of

    found = {}
    for name, text in stated:
        ends = [part.strip() for part in text.split(",")]
        if name not in NUMBERS or len(ends) != 2:
            raise InputError(
                f"--limit {name}={text}: write NUMBER=LOW,HIGH with units; the numbers are {', '.join(NUMBERS)}"
            )
        try:
            low, high = (float(units.convert(*units.quantity(end), unit_of(name))) for end in ends)
        except InputError as error:
            raise InputError(f"--limit {name}={text}: {error}") from error
        found[name] = (low, high)
    return found


def _show(console: Console, found: Aim) -> None:
    """Print objectives, band, targets and what is near them."""
    from eightpost.api.shape_page import (
        band_text,
        car_text,
        gain_table,
        neighbour_table,
        number_table,
        objective_table,
        robust_table,
    )
    from eightpost.app.show import details, show_table, show_text
    from eightpost.report.tables import result_table

    show_table(console, result_table(objective_table(found)))
    more = details(console)
    for table in (gain_table(found), robust_table(found)):
        show_table(more, result_table(table))
    for text in (car_text(found), band_text(found)):
        show_text(more, text)
    for target in found.targets:
        show_table(more, result_table(number_table(target, found)))
        show_table(more, result_table(neighbour_table(target, found)))


@verb
def clicks(
    shock_file: Path = argument("SHOCK", kind=FilePath()),
    curve: Path = option(
        "Target: a table with the columns velocity and force and their units, or a shock file.",
        kind=FilePath(), default=..., metavar="FILE",
    ),
    fix: tuple[tuple[str, str], ...] = option(
        "Setting of an adjuster that is not searched, e.g. rebound=12; may be repeated.",
        kind=Assignment("ADJUSTER=CLICKS"), metavar="ADJUSTER=CLICKS",
    ),
    plot: Path | None = option(
        "Picture of the target and the best setting; no default: none is written.", kind=OutputFile(PICTURE)
    ),
    temperature: float | None = setting(
        "Temperature at which the target is to be reached, e.g. '60 degC'; default: the reference.", kind=Quantity("K")
    ),
    speeds: tuple[float, float] | None = setting(
        "Lowest and highest speed that count, e.g. speeds='0 m/s, 0.2 m/s'; default: all measured speeds.",
        kind=Quantity("m/s"), nargs=2,
    ),
    level: Level = setting(
        "Treatment of a constant force over all speeds, such as gas force. kept: it counts as an error. free: it does "
        "not.",
        kind=("free", "kept"), default="kept",
    ),
    count: int = setting("Number of settings to list.", kind=click.IntRange(1, 100), default=5),
) -> None:  # fmt: skip
    """Find the clicks at which a shock comes closest to a target curve.

    SHOCK is a shock that `eightpost fit` fitted over its settings. All combinations of whole clicks are compared with
    the target. The list shows the remaining error in each range of speeds, and which settings are equal within the band
    of the model.

    \b
    Examples:
      eightpost study clicks shock.json --curve target.csv
      eightpost study clicks shock.json --curve other_shock.json --set speeds='0 m/s, 0.2 m/s' --plot target.png
      eightpost study clicks shock.json --curve target.csv --fix compression=8
    """
    from eightpost.app.show import show_files, show_notes, show_table, show_text
    from eightpost.ident.shock.clicks import best_clicks, read_target
    from eightpost.ident.shock.plots import answer_table, plot_answer
    from eightpost.shock import read_shock

    console = Console()
    shock, target = read_shock(shock_file), read_target(curve)
    fixed = {name: _number(name, text) for name, text in fix}
    if temperature is not None:
        fixed["temperature"] = temperature
    answer = best_clicks(shock, target, fixed=fixed, speeds=speeds, level=level, count=count)
    show_table(console, answer_table(answer), most=min(count, 5))
    show_notes(console, answer.notes, most=1)
    if answer.is_reachable:
        show_text(console, f"the target can be reached: {answer.best.text}", style="green")
    show_notes(console, answer.unreachable, "not reached", most=1)
    if plot is not None:
        plot_answer(shock, target, answer, plot)
        show_files(console, [plot])


def _number(name: str, text: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise InputError(f"--fix {name}={text}: {text!r} is not a number of clicks") from None
