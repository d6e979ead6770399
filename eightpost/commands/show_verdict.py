"""Output of a verdict, the same for every command."""

from __future__ import annotations

from collections.abc import Mapping

from rich.console import Console
from rich.markup import escape

from eightpost.verdict import Grade, Reason, Verdict

_COLORS: Mapping[Grade, str] = {
    Grade.USABLE: "green",
    Grade.LIMITED: "yellow",
    Grade.UNKNOWN: "cyan",
    Grade.NOT_USABLE: "red",
}


def show_verdict(console: Console, verdict: Verdict) -> None:
    """Print a verdict: its grade, and each of its reasons on a line of its own."""
    color = _COLORS[verdict.grade]
    console.print(f"[bold {color}]{verdict.headline}[/]: {escape(verdict.detail)}.", highlight=False, soft_wrap=True)
    for reason in verdict.reasons:
        console.print(f"  {_line(reason)}", highlight=False, soft_wrap=True)


def _line(reason: Reason) -> str:
    text = f"{reason.about}: {reason.statement}: {reason.figure} ({reason.origin})"
    remedy = "" if reason.grade is Grade.USABLE else f". To do: {reason.remedy}"
    return f"[{_COLORS[reason.grade]}]{reason.grade.value}[/] {escape(text + remedy)}"
