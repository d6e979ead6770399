"""One offline HTML page with all reproduced items: an index, then printed values beside ours with figures."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

from markupsafe import Markup

from dissertation.effort import Effort
from dissertation.findings import Comparison, Outcome, State
from dissertation.item import CHAPTERS, Basis
from dissertation.verdict import reproduction_verdict
from eightpost.report.page import Block, Section, document, write_page
from eightpost.report.tables import ResultTable

_LEAD = (
    "Printed values are those of C. M. Boggs, The Use of Simulation to Expedite Experimental Investigations of the "
    "Effect of High-Performance Shock Absorbers, Virginia Tech, 2009; figures print no numbers, so that the numbers "
    "of the text about them are compared."
)

#: Colour of each state in the index.
_COLORS = {
    State.REPRODUCED: "var(--good)",
    State.STAND_IN: "var(--accent)",
    State.PARTLY: "var(--open)",
    State.SHOWN: "var(--open)",
    State.DIFFERS: "var(--bad)",
    State.FAILED: "var(--bad)",
    State.NOTHING: "var(--soft)",
}
_TOLERANCE = {True: "within", False: "BEYOND", None: "not judged"}


def write_reproduction(path: str | Path, outcomes: Sequence[Outcome], effort: Effort) -> Path:
    """Write the page; an existing file is replaced only when the new one is complete.

    Args:
        path: File to write, such as out/reproduce.html.
        outcomes: Items with their computations.
        effort: Effort with which they were computed.

    Returns:
        Path of the written file.
    """
    return write_page(path, reproduction_page(outcomes, effort))


def reproduction_page(outcomes: Sequence[Outcome], effort: Effort) -> str:
    """Return the HTML of the page."""
    sections = [Section("index", "Index", [_counts(outcomes), _index(outcomes)])]
    for chapter, title in CHAPTERS.items():
        own = [one for one in outcomes if one.item.chapter == chapter]
        if own:
            blocks = [block for one in own for block in _blocks(one)]
            sections.append(Section(f"chapter-{chapter}", f"{chapter} {title}", blocks))
    lead = f"{_LEAD} Effort: {effort.name}."
    return document("The dissertation, reproduced", reproduction_verdict(outcomes), sections, lead=lead, fold=6)


def _counts(outcomes: Sequence[Outcome]) -> ResultTable:
    """Return the number of items in each state by chapter."""
    states = [state for state in State if any(one.state is state for one in outcomes)]
    rows = []
    for chapter, title in CHAPTERS.items():
        own = [one.state for one in outcomes if one.item.chapter == chapter]
        if own:
            rows.append((f"{chapter} {title}", *(str(own.count(state)) for state in states), str(len(own))))
    return ResultTable.of("", ("chapter", *(state.value for state in states), "items"), rows)


def _index(outcomes: Sequence[Outcome]) -> ResultTable:
    rows = (
        (
            Markup('<a href="#{}">{}</a>').format(one.item.name, one.item.label.replace(" ", "\N{NO-BREAK SPACE}")),
            one.item.title,
            _state(one.state),
            one.words,
        )
        for one in outcomes
    )
    return ResultTable.of("", ("item", "content", "state", "difference"), rows)


def _state(state: State) -> Markup:
    return Markup('<strong style="color: {}">{}</strong>').format(_COLORS[state], state.value)


def _blocks(one: Outcome) -> Iterator[Block]:
    item = one.item
    yield Markup('<h3 id="{}">{}: {}</h3>').format(item.name, item.label, item.title)
    yield Markup('<p>{}, {}. <span class="soft">{}; <a href="#index">index</a></span></p>').format(
        _state(one.state), one.words, item.place
    )
    if item.basis is Basis.STAND_IN:
        yield Markup('<p class="soft">{}</p>').format(item.reason)
    if one.findings is None:
        return
    if one.comparisons:
        yield _compared(one.comparisons)
    if one.claims:
        holds = {True: "holds", False: "does not hold"}
        rows = ((each.claim.statement, holds[each.holds], each.finding) for each in one.claims)
        yield ResultTable.of("", ("statement of the text", "ours", "finding"), rows)
    yield from one.findings.blocks
    if one.findings.note:
        yield one.findings.note


def _compared(found: Sequence[Comparison]) -> ResultTable:
    rows = (
        (
            each.printed.what,
            _with_unit(_printed(each), each.printed.unit),
            _with_unit(each.shown, each.printed.unit),
            each.words,
            f"{each.printed.within}: {_TOLERANCE[each.is_within]}" if each.printed.within else "not judged",
        )
        for each in found
    )
    return ResultTable.of("", ("value", "printed", "ours", "difference", "tolerance"), rows)


def _with_unit(number: str, unit: str) -> str:
    """Return a number and its unit on one line."""
    return f"{number} {unit}".rstrip().replace(" ", "\N{NO-BREAK SPACE}")


def _printed(one: Comparison) -> str:
    text = one.printed.text
    if text[0] == "<":
        return f"at most {text[1:]}"
    if text[0] == ">":
        return f"at least {text[1:]}"
    return text.replace("..", " to ")
