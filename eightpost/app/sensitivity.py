"""`eightpost study sensitivity`."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Console
from rich.markup import escape

from eightpost.app.options import FilePath, OutputFile, argument, option, verb
from eightpost.app.study import saved
from eightpost.outputs import TABLE
from eightpost.report.console import Table, console_table

if TYPE_CHECKING:
    from cosim.study.choice.sensitivity import Sensitivity


@verb
def sensitivity(
    folder: Path = argument("STUDY", kind=FilePath()),
    output: Path = option(
        "Output table of all terms (.parquet); default: sensitivity.parquet in the folder of the study.",
        "-o", "--output", kind=OutputFile(TABLE, default=lambda given: given["folder"] / "sensitivity.parquet"),
    ),
) -> None:  # fmt: skip
    """Show which corner matters for which measure of a study: main effects and first-order interactions.

    STUDY is a folder that `eightpost study` wrote. The table shows shares of each measure's variance over all setups.
    The shares are exact if every setup was run; if setups are missing, they are fitted by least squares.

    \b
    Example:
      eightpost study sensitivity out/
    """
    from eightpost.app.show import show_files, show_table, show_text

    console = Console()
    study = saved(console, folder)
    results = study.sensitivity(output)
    show_text(console, f"{study.study.name}: {len(study.result)} setups, {results[0].method}")
    show_table(console, share_table(results))
    show_files(console, [output])


def share_table(results: Sequence[Sensitivity]) -> Table:
    """Return a table of shares of the variance [%]: corners, interactions and the rest, a row for each measure."""
    names = [factor.name for factor in results[0].factors]
    rows = []
    for one in results:
        pairs = {pair: one.share(*pair) for pair in one.pairs}
        largest = max(pairs, key=lambda pair: pairs[pair], default=None)
        strongest = "" if largest is None else f"{' x '.join(largest)} {_percent(pairs[largest])}"
        shares = [_percent(one.share(name)) for name in names]
        others = (_percent(sum(pairs.values())), strongest, _percent(one.rest_share))
        rows.append((escape(one.measure), *shares, *others))
    return console_table(["% of the variance", *names, "all interactions", "largest", "rest"], rows)


def _percent(share: float) -> str:
    from eightpost.units import convert

    return f"{convert(share, '1', '%'):.1f}"
