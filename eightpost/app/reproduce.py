"""`eightpost reproduce`: the dissertation's figures, tables and equations, with the printed values beside ours."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click
from rich.console import Console
from rich.markup import escape

from eightpost import completion
from eightpost.app.options import OutputFolder, Verb
from eightpost.outputs import PAGE

if TYPE_CHECKING:
    from eightpost.reproduce import Effort, Item, Outcome


@click.command(cls=Verb)
@click.argument("numbers", metavar="[NUMBER]...", nargs=-1)
@click.option("--all", "everything", is_flag=True, help="Reproduce all items of chapters 3 to 7.")
@click.option("--list", "listing", is_flag=True, help="List the items and their bases; compute nothing.")
@click.option("--quick", is_flag=True,
              help="Use short records and fewer setups; the levels differ more from print.")  # fmt: skip
@click.option("-o", "--output", type=OutputFolder({"reproduce.html": PAGE}), default=Path("out"),
              help="Folder for reproduce.html; default out.")  # fmt: skip
@click.pass_context
def reproduce(
    ctx: click.Context, numbers: tuple[str, ...], everything: bool, listing: bool, quick: bool, output: Path
) -> None:
    """Reproduce the dissertation's figures, tables and equations.

    A NUMBER is that of a figure, a table or an equation (7.2 is the figure and the table), of one of them
    (table-7.2, figure-7.2, equation-6.8), or of a chapter (4). The page reproduce.html has the printed values beside
    ours, the difference in words, and an index (docs/evidence/equations.md). Measured data that were never published
    are replaced by the virtual rigs, which each such item states.

    The exit code is 1 if an item differs from print by more than its stated tolerance, and 2 if a number is unknown.

    \b
    Examples:
      eightpost reproduce 4.2
      eightpost reproduce table-7.1 equation-6.8 -o out/
      eightpost reproduce --all
      eightpost reproduce --list
    """
    from eightpost.reproduce import FULL, QUICK, chosen, inventory

    console = Console()
    if not (numbers or everything or listing):
        raise click.UsageError("give the number of an item, such as 7.2, or --all; --list shows the items")
    if numbers and everything:
        raise click.UsageError(f"give either --all or items, not both; the items are {', '.join(numbers)}")
    items = chosen(numbers) if numbers and not everything else inventory()
    if listing:
        _show_items(console, items)
        return
    ctx.exit(_reproduce(console, items, QUICK if quick else FULL, output))


def _show_items(console: Console, items: tuple[Item, ...]) -> None:
    from eightpost.report.console import console_table

    rows = ([item.label, escape(item.title), item.section, item.basis.value] for item in items)
    console.print(console_table(["item", "content", "section", "based on"], rows))


def _reproduce(console: Console, items: tuple[Item, ...], effort: Effort, output: Path) -> int:
    """Compute items, print a line for each, write the page, and return the exit code."""
    from eightpost.app.progress import each
    from eightpost.reproduce import reproduce as outcomes_of
    from eightpost.reproduce.page import write_reproduction
    from eightpost.reproduce.verdict import reproduction_verdict

    completion.begin(output)
    outcomes: list[Outcome] = []
    for outcome in each(console, outcomes_of(items, effort), "reproducing", len(items)):
        outcomes.append(outcome)
        _show_outcome(console, outcome)
    page = write_reproduction(output / "reproduce.html", outcomes, effort)
    verdict = reproduction_verdict(outcomes)
    counts = [
        (state, sum(one.state is state for one in outcomes)) for state in dict.fromkeys(o.state for o in outcomes)
    ]
    console.print(f"{len(outcomes)} items: " + ", ".join(f"{count} {state.value}" for state, count in counts))
    console.print(f"wrote {escape(str(page))}", soft_wrap=True)
    return 0 if verdict.is_acceptable else 1


def _show_outcome(console: Console, outcome: Outcome) -> None:
    item = outcome.item
    time = f" ({outcome.seconds:.1f} s)" if item.is_computed else ""
    text = f"[bold]{item.label}[/] {escape(outcome.state.value)}: {escape(outcome.words)}{time}"
    console.print(text, soft_wrap=True, highlight=False)
