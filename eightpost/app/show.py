"""Output of commands: progress, what was done, the result, and one verdict, at most 12 lines; details with -v."""

from __future__ import annotations

import os
import textwrap
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

import click
from rich.console import Console
from rich.markup import escape
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TaskProgressColumn,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)

from eightpost.progress import Listener
from eightpost.report.console import Table, brief, console_table, unbroken
from eightpost.verdict import Grade, Reason, Verdict

if TYPE_CHECKING:
    import cosim

# ---- Summary and verdict, the same for every command ----------------------------------------------------------------

#: Largest width of a line, and numbers of lines of a text and of a note, which ends with what to do, of rows and of
#: notes; all of them are shown with -v.
_WIDTH, _LINES, _ADVICE, _ROWS, _NOTES = 80, 2, 4, 4, 2

_MORE = " ..."  #: End of a text that is not shown to its end.

_COLORS: Mapping[Grade, str] = {
    Grade.USABLE: "green",
    Grade.LIMITED: "yellow",
    Grade.UNKNOWN: "cyan",
    Grade.NOT_USABLE: "red",
}


def is_detailed() -> bool:
    """Return whether the command line has -v."""
    context = click.get_current_context(silent=True)
    return bool(context and context.find_root().params.get("verbose"))


def details(console: Console) -> Console:
    """Return the console for what only -v shows: the console itself, or one that prints nothing."""
    return console if is_detailed() else Console(quiet=True)


def show_summary(console: Console, title: str, rows: Iterable[tuple[str, str]] = ()) -> None:
    """Print a title and labelled texts, each of at most two lines; rows without a text are left out."""
    if title:
        show_text(console, title)
    shown = [row for row in rows if row[1]]
    width = max((len(label) for label, _ in shown), default=0) + 4
    for label, text in shown:
        show_text(console, text, begin=f"  {label}".ljust(width), hanging=" " * width)


def show_table(console: Console, table: Table, *, most: int = _ROWS) -> None:
    """Print the first rows of a table, and how many more there are; with -v, the whole table."""
    if is_detailed():
        console.print(table)
        return
    console.print(brief(table, most))
    if table.row_count > most:
        show_text(console, f"{most} of {table.row_count} rows; -v shows all", begin="  ")


def show_notes(console: Console, notes: Iterable[str], word: str = "note", *, most: int = _NOTES) -> None:
    """Print the first notes, and how many more there are; with -v, all of them."""
    every = list(notes)
    for text in every if is_detailed() else every[:most]:
        show_text(console, f"{word} {text}", hanging="  ", style="red" if word == "warning" else "", lines=_ADVICE)
    if len(every) > most and not is_detailed():
        show_text(console, f"and {len(every) - most} more; -v shows all", begin="  ")


def show_files(console: Console, files: Iterable[Path], remark: str = "") -> None:
    """Print the names of the files that a command wrote."""
    if names := ", ".join(map(str, files)):
        console.print(f"wrote {escape(names)}{remark}", soft_wrap=True, highlight=False)


def show_verdict(console: Console, verdict: Verdict) -> None:
    """Print a verdict in one line, and what must be done if it is not usable as it is; with -v, every reason."""
    color = _COLORS[verdict.grade]
    if is_detailed():
        console.print(
            f"[bold {color}]{verdict.headline}[/]: {escape(verdict.detail)}.", highlight=False, soft_wrap=True
        )
        for reason in verdict.reasons:
            console.print(f"  {_line(reason)}", highlight=False, soft_wrap=True)
        return
    first = verdict.decisive[0].statement if verdict.reasons else "nothing was examined"
    urgent = [reason for reason in verdict.reasons if reason.grade is not Grade.USABLE]
    show_text(console, f"{verdict.headline}: {first}.", style=f"bold {color}", lines=1)
    more = f"reason 1 of {len(urgent)} (-v): " if len(urgent) > 1 else ""
    for reason in urgent[:1]:
        show_text(console, f"{more}{reason.figure}", begin="  ", lines=1)
        if not reason.remedy.startswith("nothing"):
            show_text(console, f"to do: {reason.remedy}", begin="  ", hanging="    ")


def show_text(
    console: Console, text: str, *, begin: str = "", hanging: str = "", style: str = "", lines: int = _LINES
) -> None:
    """Print the first lines of a text, or all of it with -v; nothing of an empty one."""
    if not text:
        return
    width, shown = min(console.width, _WIDTH), list[str]()
    for line in textwrap.wrap(text, width, initial_indent=begin, subsequent_indent=hanging, break_long_words=False,
                              break_on_hyphens=False):  # fmt: skip
        if shown and len(line) > width:  # a path: it stays with the word before it
            shown[-1] += f" {line.strip()}"
        else:
            shown.append(line)
    if len(shown) > lines and not is_detailed():
        last = shown[lines - 1]
        while width - len(_MORE) < len(last) <= width and " " in last.strip():
            last = last.rpartition(" ")[0]
        shown[lines - 1 :] = [last + _MORE]
    console.print("\n".join(shown), style=style or None, markup=False, highlight=False, soft_wrap=True, emoji=False)


def _line(reason: Reason) -> str:
    text = f"{reason.about}: {reason.statement}: {reason.figure} ({reason.origin})"
    remedy = "" if reason.grade is Grade.USABLE else f". To do: {reason.remedy}"
    return f"[{_COLORS[reason.grade]}]{reason.grade.value}[/] {escape(text + remedy)}"


# ---- Output of `eightpost run` and the demo about a run -------------------------------------------------------------


def show_result(console: Console, name: str, result: cosim.Result) -> None:
    """Print steps, errors and verdict of a run; with -v, also its statistics, energies and notes."""
    scheme = f"{result.algorithm}: {result.scheme}" if result.scheme else result.algorithm
    error, energies = result.coupling_error, [abs(energy.relative) for energy in result.energy.values()]
    show_summary(
        console,
        f"{name}: {', '.join(result.order)}",
        [
            ("steps", f"{result.steps} of {_step(result)}, {scheme}, {result.seconds:.2f} s"),
            ("coupling error", _local_error(result) if error is None else f"{error:.2g} %"),
            ("energy residual", f"{max(energies):.1e} of the energy transferred, at most" if energies else ""),
            ("notes", f"{len(result.notes)}; -v shows them" if result.notes and not is_detailed() else ""),
        ],
    )
    more = details(console)
    more.print(_statistics(result))
    for bond, energy in result.energy.items():
        more.print(f"bond {bond}: energy residual {energy.residual:+.2e} J of {energy.transferred:.3g} J "
                   f"({energy.relative:+.1e})", highlight=False)  # fmt: skip
    if result.held_direct:
        more.print(
            f"[yellow]note[/] {len(result.held_direct)} outputs, e.g. {result.held_direct[0]}, depend directly on an "
            "input that is held over each step: their error is proportional to the step "
            "(docs/explanation/coupling.md; list in result.json)",
            highlight=False,
        )
    for note in result.notes:
        more.print(f"[yellow]note[/] {escape(note)}", highlight=False)
    show_verdict(console, result.verdict)


def show_verification(console: Console, verification: cosim.Verification, result: cosim.Result) -> None:
    """Print the difference between a run and its repetition at a finer step, channel by channel."""
    rows = []
    for name, difference in sorted(verification.difference.items(), key=lambda item: -item[1]):
        stated = result.stated_error.get(name)
        rows.append((name, f"{difference:.2g} %", "" if stated is None else f"{stated:.2g} %"))
    caption = f"RMS in % of the standard deviation: steps of {_step(result)} and of {_step(verification.finer)}"
    more = details(console)
    more.print(console_table([*unbroken("channel"), "difference", "stated error"], rows, caption=caption))
    if rows and not is_detailed():
        channel, largest, error = rows[0]
        text = f"at half the step: {channel} differs most, by {largest}; stated error {error or 'unknown'}"
        show_text(console, text)


def _step(result: cosim.Result) -> str:
    from eightpost import units

    step, largest = (units.convert(seconds, "s", "ms") for seconds in (result.step, result.largest_step))
    return f"{step:.4g} ms" if result.has_equal_steps else f"{step:.3g} to {largest:.3g} ms"


def _local_error(result: cosim.Result) -> str:
    """Return the largest error of a single step, of a run that states no coupling error."""
    if not result.coupled:
        return ""
    bond, local = max(((b, c.percent) for b, c in result.coupled.items()), key=lambda item: item[1])
    return f"not stated; of a single step {local:.2g} % of the standard deviation (bond {bond})"


def _statistics(result: cosim.Result) -> Table:
    from eightpost import units

    rows = []
    series = result.settled()
    for channel in series.names:
        unit = units.display_unit(series.unit(channel))
        values = units.convert(series[channel], series.unit(channel), unit)
        numbers = (values.mean(), values.std(), values.min(), values.max())
        rows.append((channel, unit, *(f"{number:.4g}" for number in numbers)))
    columns = [*unbroken("channel"), "unit", "mean", "RMS", "minimum", "maximum"]
    return console_table(columns, rows, caption="RMS about the mean")


# ==== Progress bars of all verbs =====================================================================================

Item = TypeVar("Item")

#: Callback that receives the amount done, and the total if it is known only now.
Advance = Callable[..., None]


@contextmanager
def bar(console: Console, text: str, total: float | None = None) -> Iterator[Advance]:
    """Show a progress bar until the block ends.

    Args:
        console: Console of the bar; if it is not a terminal, lines are printed from time to time instead.
        text: Name of the work.
        total: Total amount: a number of items (int), a share (1.0), or None if the work states it itself.

    Yields:
        Callback for the amount done and, optionally, the total.
    """
    if not console.is_terminal:
        yield _Lines(console, text, total)
        return
    amount = TaskProgressColumn() if isinstance(total, float) else MofNCompleteColumn()
    columns = (TextColumn("{task.description}"), BarColumn(), amount, TimeElapsedColumn(), TimeRemainingColumn())
    with Progress(*columns, console=console, transient=True) as progress:
        task = progress.add_task(text, total=total)

        def advance(done: float, out_of: float | None = None) -> None:
            progress.update(task, completed=done, total=out_of)

        yield advance


#: Interval of the lines about the progress in a log file [s]; a program that shows them asks for a shorter one.
INTERVAL = float(os.environ.get("EIGHTPOST_PROGRESS", "30"))


class _Lines:
    """Progress as lines with the time that is left, for output that is not a terminal, such as the log of a job."""

    def __init__(self, console: Console, text: str, total: float | None) -> None:
        self._console, self._text, self._total = console, text, total
        self._began = self._printed = time.monotonic()
        self._first: float | None = None

    def __call__(self, done: float, out_of: float | None = None) -> None:
        """Print a line if the last one is older than INTERVAL."""
        now = time.monotonic()
        total = self._total if out_of is None else out_of
        if self._first is None:  # what an earlier run completed says nothing about the speed
            self._first, self._began = done, now
        if now - self._printed < INTERVAL or not total:
            return
        self._printed = now
        rate = (done - self._first) / (now - self._began) if now > self._began else 0.0
        left = f", about {_clock((total - done) / rate)} left" if rate > 0.0 else ""
        amount = "" if isinstance(total, float) else f"{done:g} of {total:g}, "
        self._console.print(f"{self._text}: {amount}{done / total:.0%}{left}", highlight=False, soft_wrap=True)


def _clock(seconds: float) -> str:
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02d}:{rest:02d}"


def each(console: Console, items: Iterable[Item], text: str, total: int) -> Iterator[Item]:
    """Yield the items with a progress bar.

    Args:
        console: Console of the bar.
        items: Items, which may be computed one by one.
        text: Name of the work.
        total: Number of items.
    """
    with bar(console, text, total) as advance:
        for done, item in enumerate(items, start=1):
            yield item
            advance(done)


class ConsoleListener(Listener):
    """Listener that prints notes and sentences, with a progress bar for each work."""

    def __init__(self, console: Console) -> None:
        self._console = console

    def note(self, text: str) -> None:
        """Print a note."""
        show_text(self._console, f"note {text}", hanging="  ")

    def say(self, text: str) -> None:
        """Print a sentence."""
        show_text(details(self._console), text)

    def report(self, text: str) -> None:
        """Print a note on standard error."""
        show_text(Console(stderr=True), f"note {text}", hanging="  ")

    @contextmanager
    def work(self, text: str, total: float | None = None) -> Iterator[Advance]:
        """Show a progress bar, or the name of work without a total."""
        if total is not None:
            with bar(self._console, text, total) as advance:
                yield advance
            return
        with self._console.status(text) as status:
            yield lambda done, _all=0.0: status.update(f"{done:g} {text}")
