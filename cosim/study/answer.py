"""Small plots of curves as SVG, which need no script: visible at once, on any screen and in print."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import floor, log10
from typing import NamedTuple

import numpy as np
from markupsafe import Markup

from cosim.study.choice.certainty import (
    OBJECTIVE,
    Certainty,
    Contribution,
    Status,
    TradeOff,
    chance_text,
    relative_change,
)
from cosim.study.sheet import Scale, Sheet, ShockCurve
from eightpost.array_types import Array
from eightpost.report.tables import Display, figure, percent
from eightpost.verdict import Grade, listed

# ==== Small plots of curves as SVG, which need no script: visible at once, on any screen and in print ================


#: Size of a plot and space for the numbers beside it [px].
WIDTH, HEIGHT = 300, 190
_LEFT, _RIGHT, _TOP, _BOTTOM = 42, 6, 8, 32

#: Curve: x (K,) and y (K,) in the SI units of the axes, and the style class of its line.
Curve = tuple[Array, Array, str]


def small_plot(curves: Sequence[Curve], x: tuple[str, Display], y: tuple[str, Display], label: str) -> Markup:
    """Return a plot of curves.

    Args:
        curves: Curves; later ones are drawn on top.
        x: Name and display unit of the horizontal axis.
        y: Name and display unit of the vertical axis.
        label: Description for readers who cannot see the plot.
    """
    across, up = [curve[0] for curve in curves], [curve[1] for curve in curves]
    spans = [[display(end) for end in _span(values)] for values, (_, display) in ((across, x), (up, y))]

    def place(values: Array, axis: int) -> Array:
        low, high = spans[axis]
        share: Array = (np.asarray(values) - low) / (high - low)
        wide, tall = WIDTH - _LEFT - _RIGHT, HEIGHT - _TOP - _BOTTOM
        start, size = (_LEFT, wide) if axis == 0 else (HEIGHT - _BOTTOM, -tall)
        return np.asarray(start + size * share)

    grid = [
        _grid_line(tick, place(np.array([tick]), axis)[0], axis) for axis in (0, 1) for tick in _ticks(*spans[axis])
    ]
    lines = [
        f'<polyline class="{style}" points="{_points(place(x[1](xs), 0), place(y[1](ys), 1))}"/>'
        for xs, ys, style in curves
    ]
    titles = (
        f'<text x="{WIDTH - _RIGHT}" y="{HEIGHT - 3}" class="end">{{}} [{{}}]</text>'
        f'<text x="{_LEFT + 4}" y="{_TOP + 8}">{{}} [{{}}]</text>'
    )
    head = f'<svg class="small" viewBox="0 0 {WIDTH} {HEIGHT}" role="img" aria-label="{{}}">'
    return Markup(head + "".join(grid) + titles + "".join(lines) + "</svg>").format(
        label, x[0], x[1].unit, y[0], y[1].unit
    )


def _span(values: Sequence[Array]) -> tuple[float, float]:
    low, high = float(min(map(np.min, values))), float(max(map(np.max, values)))
    return (low, high) if high > low else (low - 1.0, high + 1.0)


def _ticks(low: float, high: float) -> list[float]:
    """Return two to five round numbers in a span."""
    size = 10.0 ** floor(log10(high - low))
    step = next(part * size for part in (0.2, 0.5, 1.0, 2.0, 5.0) if (high - low) / (part * size) <= 5.0)
    return [k * step for k in range(int(np.ceil(low / step)), int(np.floor(high / step)) + 1)]


def _grid_line(tick: float, place: float, axis: int) -> str:
    """Return a grid line with its number; the line of zero is an axis."""
    style = "axis" if tick == 0.0 else "grid"
    if axis == 0:
        line = f'<line class="{style}" x1="{place:.1f}" x2="{place:.1f}" y1="{_TOP}" y2="{HEIGHT - _BOTTOM}"/>'
        return f'{line}<text class="middle" x="{place:.1f}" y="{HEIGHT - _BOTTOM + 13}">{figure(tick)}</text>'
    line = f'<line class="{style}" x1="{_LEFT}" x2="{WIDTH - _RIGHT}" y1="{place:.1f}" y2="{place:.1f}"/>'
    return f'{line}<text class="end" x="{_LEFT - 4}" y="{place + 4:.1f}">{figure(tick)}</text>'


def _points(across: Array, up: Array) -> str:
    return " ".join(f"{a:.1f},{b:.1f}" for a, b in zip(across, up, strict=True))


# ==== The answer =====================================================================================================


#: Number of tied setups that are listed, and of measures of the trade-off; the others are counted.
LISTED, TRADES = 5, 6

#: Order of the trade-off, after the measures of the objective: what gets worse comes first.
_GRADES = ("worse", "even", "better")


class Candidate(NamedTuple):
    """One of the tied setups."""

    row: int  #: Row of the setup.
    probability: str  #: Probability of being the best, as text; empty if none is stated.


class CornerChoice(NamedTuple):
    """Shock for a corner."""

    corner: str  #: Name of the corner.
    build: str  #: Build to bolt on.
    setting: str  #: Its clicks and other parameters as text; may be empty.
    today: str  #: Build and setting of the baseline; empty if there is no baseline or it has the same.
    plots: Markup  #: Curve of the build over that of the baseline, in both unit systems; empty if it is not known.


class TradeOffLine(NamedTuple):
    """Change of a measure of the leading setup from the baseline, with its 95 % interval, as text."""

    measure: str
    change: str
    interval: str
    grade: str


@dataclass(frozen=True, slots=True)
class Answer:
    """What the page says first."""

    grade: Grade  #: Grade that gives the answer its colour; never usable without a known uncertainty.
    which: str  #: Sentence: the setup, or the tied setups.
    row: int  #: Row of the leading setup.
    candidates: tuple[Candidate, ...]  #: The most probable of several setups; none if there is only one.
    others: int  #: Number of tied setups that are not listed.
    sure: str  #: Sentences: how sure this is.
    gain: str = ""  #: Sentence: change of what setups are ranked by from the baseline.
    contributions: tuple[Contribution, ...] = ()  #: Contributions to the uncertainty.
    #: Measures of the leading setup: those of the objective, then what gets worse.
    trade_offs: tuple[TradeOffLine, ...] = ()
    unlisted: str = ""  #: Sentence about the measures of the trade-off that are not listed.
    #: Rows of the setups to test next, with what remains of the doubt after each; empty if that is not known.
    tests: tuple[tuple[int, str], ...] = ()
    #: Whether what remains is for rig runs that repeat exactly, because nobody stated how well they do.
    exact: bool = False


def answer_of(sheet: Sheet) -> Answer | None:
    """Return the answer; None if no setup can be chosen."""
    if not np.any(sheet.allowed & sheet.done):
        return None
    known = sheet.certainty
    if known is None or known.leader is None:
        return _predicted(sheet)
    rows = tied(sheet)
    whole = next((one for one in known.trade_offs if one.measure == known.criterion), None)
    lines = tuple(map(_line, _by_weight(sheet, known)))
    tests = tuple(
        (row, percent(100.0 * test.remaining)) for test in known.tests if (row := sheet.row(test.setup)) is not None
    )
    guess = _predicted(sheet, rows[0])
    return replace(
        guess,
        grade=_grade(known),
        which=_which(sheet, known, rows),
        candidates=tuple(Candidate(row, _share(sheet, known, row)) for row in rows[:LISTED] if len(rows) > 1),
        others=max(0, len(rows) - LISTED),
        sure=_sure(sheet, known),
        contributions=known.contributions,
        exact=known.assumes_exact_runs,
        gain=_gain(sheet, whole) if whole else guess.gain,
        trade_offs=lines[:TRADES] or guess.trade_offs,
        unlisted=_unlisted(lines[TRADES:]),
        tests=tests or guess.tests,
    )


def tied(sheet: Sheet) -> list[int]:
    """Return the rows of the tied setups, most probable first; none if no certainty was computed."""
    ties = sheet.certainty.ties if sheet.certainty else ()
    return [row for row in (sheet.row(number) for number in ties) if row is not None]


def chance(known: Certainty) -> str:
    """Return the heading of the probabilities of being best: it says if they contain only a part of the uncertainty."""
    whole = known.is_known and not known.left_out
    return "probability of being best" if whole else "probability of being best, from what is included"


def sought(sheet: Sheet) -> str:
    """Return the objective in words."""
    if len(sheet.terms) < 2:
        name, weight = (sheet.terms[0].measure, sheet.terms[0].weight) if sheet.terms else (sheet.ranked_by.name, 1.0)
        return f"{name}, as {'low' if weight >= 0.0 else 'high'} as possible"
    terms = [f"{one.measure} (each {one.display.unit} counts {one.weight:g})" for one in sheet.terms]
    return f"the lowest sum of {', '.join(terms[:-1])} and {terms[-1]}"


def corner_choices(sheet: Sheet, row: int, curves: Mapping[str, ShockCurve]) -> list[CornerChoice]:
    """Return the shock of a setup for each corner, with its curve over that of the baseline."""
    found = []
    for corner, name in enumerate(sheet.corners):
        here = int(sheet.placed[row, corner])
        there = here if sheet.baseline is None else int(sheet.placed[sheet.baseline, corner])
        build, setting = sheet.builds[here], sheet.settings[here]
        today = "" if there == here else f"{sheet.builds[there]} {sheet.settings[there]}".strip()
        lines = [(curves.get(sheet.builds[there]), "today"), (curves.get(build), "chosen")][there == here :]
        plots = _curves(
            [(one, style) for one, style in lines if one], f"{name.upper()}: force of {build} over velocity"
        )
        found.append(CornerChoice(name, build, setting, today, plots))
    return found


def _curves(lines: list[tuple[ShockCurve, str]], label: str) -> Markup:
    if not lines:
        return Markup()
    curves = [(one.velocity, one.force, style) for one, style in lines]
    velocity, force = Scale.of("m/s"), Scale.of("N")
    return Markup().join(
        Markup('<span class="{}">{}</span>').format(system, small_plot(curves, ("velocity", x), ("force", y), label))
        for system, x, y in (("us", velocity.us, force.us), ("si", velocity.metric, force.metric))
    )


def _predicted(sheet: Sheet, row: int | None = None) -> Answer:
    """Return what predictions alone say about a setup; default: the first of the ranking."""
    best = int(sheet.order[0]) if row is None else row
    base, column = sheet.baseline, sheet.ranked_by
    gain, rows = "", [best]
    if base is not None and base != best and sheet.done[base]:
        change = float(relative_change(column.values[best], column.values[base]))
        gain = f"{_named(column.name)} {_signed(change)} against today's setup; how exact this is, is unknown."
        rows.append(base)
    return Answer(
        Grade.UNKNOWN,
        f"Setup {sheet.numbers[best]} has the best predicted {column.name}.",
        best,
        (),
        0,
        "Unknown: the study states no uncertainty. Other setups may be as good.",
        gain=gain,
        trade_offs=_predicted_trade_offs(sheet, best),
        tests=tuple((row, "") for row in rows),
    )


def _grade(known: Certainty) -> Grade:
    if not known.is_known:
        return Grade.UNKNOWN
    sound = len(known.ties) == 1 and not known.contradictions and not known.left_out
    return Grade.USABLE if sound else Grade.LIMITED


def _which(sheet: Sheet, known: Certainty, rows: list[int]) -> str:
    leader = sheet.numbers[rows[0]]
    if not known.is_known:
        return f"Setup {leader} has the best predicted {known.criterion}; how sure this is, is not known."
    if len(rows) > 1:
        return f"One of {len(rows)} setups is the best; setup {leader} is the most probable."
    return f"Setup {leader} is {'probably ' if known.left_out or known.contradictions else ''}the best."


def _share(sheet: Sheet, known: Certainty, row: int) -> str:
    probability = known.best[known.row(int(sheet.numbers[row]))]
    return chance_text(probability) if np.isfinite(probability) else "unknown"


def _sure(sheet: Sheet, known: Certainty) -> str:
    """Return how sure the choice is: what is missing comes before any probability."""
    share = _share(sheet, known, tied(sheet)[0])
    missing = [one for one in known.contributions if one.status is Status.UNKNOWN or one in known.left_out]
    names = listed(one.name for one in missing)
    words = [f"Not included: {names}. With it, other setups may be as good."] if missing else []
    if len(known.ties) > 1:
        words.append(f"It is not known which of the {len(known.ties)} is the best: none has a probability of 95 %.")
    elif missing:
        words.append(f"Of what is included, nothing speaks for another setup ({share}).")
    else:
        words.append(f"No other setup is as good, with a probability of {share}; every known error is included.")
    if known.contradictions:
        words.append("A rig run contradicts the prediction: see the findings.")
    return " ".join(words)


def _gain(sheet: Sheet, change: TradeOff) -> str:
    against = "today's setup" if sheet.baseline is not None else "the median setup"
    interval = f" (95 %: {_signed(change.low)} to {_signed(change.high)})" if np.isfinite(change.low) else ""
    return f"{_named(change.measure)} {_signed(change.change)} against {against}{interval}."


def _named(criterion: str) -> str:
    return "Objective" if criterion == OBJECTIVE else criterion[:1].upper() + criterion[1:]


def _line(one: TradeOff) -> TradeOffLine:
    interval = f"{_signed(one.low)} to {_signed(one.high)}" if np.isfinite(one.low + one.high) else "unknown"
    return TradeOffLine(one.measure, _signed(one.change), interval, _grade_of(one))


def _grade_of(one: TradeOff) -> str:
    return "worse" if one.low > 0.0 else "better" if one.high < 0.0 else "even"


def _by_weight(sheet: Sheet, known: Certainty) -> list[TradeOff]:
    """Return the measures of the objective, then the others: the worse ones, those in doubt, the better ones."""
    weighted = [term.measure for term in sheet.terms]

    def place(one: TradeOff) -> tuple[int, float, float]:
        if one.measure in weighted:
            return 0, weighted.index(one.measure), 0.0
        return 1, _GRADES.index(_grade_of(one)), -abs(one.change)

    return sorted((one for one in known.trade_offs if one.measure != OBJECTIVE), key=place)


def _unlisted(lines: tuple[TradeOffLine, ...]) -> str:
    counts = {grade: sum(line.grade == grade for line in lines) for grade in _GRADES}
    words = {"worse": "worse", "even": "not surely different", "better": "better"}
    found = [f"{count} more {'is' if count == 1 else 'are'} {words[grade]}" for grade, count in counts.items() if count]
    return f"{', '.join(found)}." if found else ""


def _predicted_trade_offs(sheet: Sheet, row: int) -> tuple[TradeOffLine, ...]:
    """Return the predicted changes of the first measures from the baseline, without intervals."""
    base = sheet.baseline
    if base is None or base == row or not sheet.done[base]:
        return ()
    changes = ((one.name, float(relative_change(one.values[row], one.values[base]))) for one in sheet.measures[:LISTED])
    return tuple(TradeOffLine(name, _signed(one), "unknown", "even") for name, one in changes if np.isfinite(one))


def _signed(share: float) -> str:
    text = percent(100.0 * share)
    return f"+{text}" if share > 0.0 else text
