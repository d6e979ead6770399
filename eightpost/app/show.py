"""Summaries of runs and verdicts on the console."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from rich.console import Console
from rich.markup import escape

from eightpost import units
from eightpost.report.console import Table, console_table, unbroken
from eightpost.verdict import Grade, Reason, Verdict

if TYPE_CHECKING:
    import cosim

# ---- Output of a verdict, the same for every command ----------------------------------------------------------------

_COLORS: Mapping[Grade, str] = {
    Grade.USABLE: "green",
    Grade.LIMITED: "yellow",
    Grade.UNKNOWN: "cyan",
    Grade.NOT_USABLE: "red",
}


def show_verdict(console: Console, verdict: Verdict) -> None:
    """Print a verdict: its grade with its first reason, and each reason on a line of its own.

    The first reason of a usable result needs no action and is not repeated.
    """
    color = _COLORS[verdict.grade]
    console.print(f"[bold {color}]{verdict.headline}[/]: {escape(verdict.detail)}.", highlight=False, soft_wrap=True)
    for reason in verdict.reasons[1:] if verdict.grade is Grade.USABLE else verdict.reasons:
        console.print(f"  {_line(reason)}", highlight=False, soft_wrap=True)


def _line(reason: Reason) -> str:
    text = f"{reason.about}: {reason.statement}: {reason.figure} ({reason.origin})"
    remedy = "" if reason.grade is Grade.USABLE else f". To do: {reason.remedy}"
    return f"[{_COLORS[reason.grade]}]{reason.grade.value}[/] {escape(text + remedy)}"


# ---- Output of `eightpost run` and the demo about a run -------------------------------------------------------------


def show_result(console: Console, name: str, result: cosim.Result) -> None:
    """Print scheme, step and duration of a run, its statistics, its errors and its verdict."""
    scheme = f"{result.algorithm}: {result.scheme}" if result.scheme else result.algorithm
    console.print(
        f"{escape(name)}: {result.steps} steps of {_step(result)}, {scheme} ({', '.join(result.order)}), "
        f"{result.seconds:.2f} s",
        highlight=False,
    )
    console.print(_statistics(result))
    _show_local_error(console, result)
    for bond, energy in result.energy.items():
        console.print(f"bond {bond}: energy residual {energy.residual:+.2e} J of {energy.transferred:.3g} J "
                      f"({energy.relative:+.1e})", highlight=False)  # fmt: skip
    if result.held_direct:
        console.print(
            f"[yellow]note[/] {len(result.held_direct)} outputs, e.g. {result.held_direct[0]}, depend directly on an "
            "input that is held over each step: their error is proportional to the step "
            "(docs/explanation/coupling.md; list in result.json)",
            highlight=False,
        )
    for note in result.notes:
        console.print(f"[yellow]note[/] {escape(note)}", highlight=False)
    show_verdict(console, result.verdict)


def show_verification(console: Console, verification: cosim.Verification, result: cosim.Result) -> None:
    """Print the difference between a run and its repetition at a finer step, channel by channel."""
    rows = []
    for name, difference in sorted(verification.difference.items(), key=lambda item: -item[1]):
        stated = result.stated_error.get(name)
        rows.append((name, f"{difference:.2g} %", "" if stated is None else f"{stated:.2g} %"))
    caption = f"RMS in % of the standard deviation: steps of {_step(result)} and of {_step(verification.finer)}"
    console.print(console_table([*unbroken("channel"), "difference", "stated error"], rows, caption=caption))


def _step(result: cosim.Result) -> str:
    step, largest = (units.convert(seconds, "s", "ms") for seconds in (result.step, result.largest_step))
    return f"{step:.4g} ms" if result.has_equal_steps else f"{step:.3g} to {largest:.3g} ms"


def _show_local_error(console: Console, result: cosim.Result) -> None:
    """Print the largest local error of a bond if the run states no coupling error."""
    if result.coupled and not result.stated_error:
        bond, local = max(((b, c.percent) for b, c in result.coupled.items()), key=lambda item: item[1])
        console.print(
            f"coupling error of a single step: {local:.2g} % of the standard deviation (bond {bond})", highlight=False
        )


def _statistics(result: cosim.Result) -> Table:
    rows = []
    series = result.settled()
    for channel in series.names:
        unit = units.us_customary(series.unit(channel))
        values = units.convert(series[channel], series.unit(channel), unit)
        numbers = (values.mean(), values.std(), values.min(), values.max())
        rows.append((channel, unit, *(f"{number:.4g}" for number in numbers)))
    columns = [*unbroken("channel"), "unit", "mean", "RMS", "minimum", "maximum"]
    return console_table(columns, rows, caption="RMS about the mean")
