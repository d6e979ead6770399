"""Work of `eightpost reproduce`: a line for each item, one page, and an exit code."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import click
from rich.console import Console
from rich.markup import escape

from dissertation.effort import FULL, QUICK, Effort
from dissertation.findings import Outcome
from dissertation.item import Item, chosen, inventory
from dissertation.page import write_reproduction
from dissertation.reproduction import reproduce
from dissertation.verdict import reproduction_verdict
from eightpost import completion
from eightpost.app.show import each, show_table
from eightpost.report.console import console_table


def run(numbers: tuple[str, ...], output: Path, *, everything: bool, listing: bool, quick: bool) -> int:
    """Reproduce or list items.

    Args:
        numbers: Numbers of items, as people write them.
        output: Folder for reproduce.html.
        everything: Whether to reproduce all items.
        listing: Whether to print the items and compute nothing.
        quick: Whether to use short records and fewer setups.

    Returns:
        Exit code: 1 if an item differs from print by more than its tolerance, otherwise 0.

    Raises:
        click.UsageError: No item is named, or items are named beside `everything`.
        InputError: There is no such item.
    """
    if not (numbers or everything or listing):
        raise click.UsageError("give the number of an item, such as 7.2, or --all; --list shows the items")
    if numbers and everything:
        raise click.UsageError(f"give either --all or items, not both; the items are {', '.join(numbers)}")
    console, items = Console(), chosen(numbers) if numbers else inventory()
    if listing:
        rows = [[item.label, escape(item.title), item.section, item.basis.value] for item in items]
        show_table(console, console_table(["item", "content", "section", "based on"], rows), most=len(rows))
        return 0
    return _reproduce(console, items, QUICK if quick else FULL, output)


def _reproduce(console: Console, items: tuple[Item, ...], effort: Effort, output: Path) -> int:
    completion.begin(output)
    outcomes: list[Outcome] = []
    for outcome in each(console, reproduce(items, effort), "reproducing", len(items)):
        outcomes.append(outcome)
        _show(console, outcome)
    page = write_reproduction(output / "reproduce.html", outcomes, effort)
    counts = Counter(outcome.state.value for outcome in outcomes)
    number = "1 item" if len(outcomes) == 1 else f"{len(outcomes)} items"
    console.print(f"{number}: {', '.join(f'{count} {state}' for state, count in counts.items())}")
    console.print(f"wrote {escape(str(page))}", soft_wrap=True)
    return 0 if reproduction_verdict(outcomes).is_acceptable else 1


def _show(console: Console, outcome: Outcome) -> None:
    time = f" ({outcome.seconds:.1f} s)" if outcome.item.is_computed else ""
    text = f"[bold]{outcome.item.label}[/] {escape(outcome.state.value)}: {escape(outcome.words)}{time}"
    console.print(text, soft_wrap=True, highlight=False)
