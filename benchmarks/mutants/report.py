"""The report of a campaign as Markdown: the table of areas, and every mutant that survived."""

from __future__ import annotations

from collections.abc import Sequence

from benchmarks.mutants.records import Record
from benchmarks.mutants.trial import Outcome

_HEAD = "| area | tried | killed | of these by time limit | survived | killed [%] | equivalent | invalid |"
_NOTICED = (Outcome.KILLED, Outcome.TIMEOUT)


def killed_share(records: Sequence[Record]) -> float:
    """Return the share of killed mutants [1] among those that a test can detect; 1 if the list is empty."""
    tried = [record.outcome for record in records if record.outcome in (*_NOTICED, Outcome.SURVIVED)]
    return sum(outcome in _NOTICED for outcome in tried) / len(tried) if tried else 1.0


def report(records: Sequence[Record], seed: int) -> str:
    """Return the report of a campaign."""
    areas = dict.fromkeys(record.area for record in records)
    rows = [_row(area, [record for record in records if record.area == area]) for area in areas]
    parts = [f"Mutants, seed {seed}:", "\n".join([_HEAD, "|---" * 8 + "|", *rows, _row("all", records)])]
    parts += [_listed(record) for record in records if record.outcome is Outcome.SURVIVED]
    return "\n\n".join(parts) + "\n"


def _row(name: str, records: Sequence[Record]) -> str:
    count = {outcome: sum(record.outcome is outcome for record in records) for outcome in Outcome}
    killed, survived = sum(count[outcome] for outcome in _NOTICED), count[Outcome.SURVIVED]
    cells = (name, killed + survived, killed, count[Outcome.TIMEOUT], survived, f"{100.0 * killed_share(records):.1f}",
             count[Outcome.EQUIVALENT], count[Outcome.INVALID])  # fmt: skip
    return f"| {' | '.join(map(str, cells))} |"


def _listed(record: Record) -> str:
    return f"Survived: {record.file}:{record.line} ({record.area})\n\n```diff\n{record.diff}\n```"
