"""The answer at the top of a study's page: which setup, how sure, at what trade-off, and what to test next."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from cosim.study.certainty import Certainty, Contribution, Status, TradeOff, certainty
from cosim.study.certainty.certainty import TIE
from cosim.study.report.sheet import Sheet
from eightpost.array_types import Array, Flags
from eightpost.report.numbers import percent
from eightpost.verdict import Grade

#: Number of tied setups that are listed, and of measures of the trade-off; the others are counted.
LISTED, TRADES = 5, 8

#: Order of the trade-off, after the measures of the objective: what gets worse comes first.
_GRADES = ("worse", "even", "better")


@dataclass(frozen=True, slots=True)
class Candidate:
    """One of the tied setups."""

    row: int  #: Row of the setup.
    probability: str  #: Probability of being the best, as text.
    value: float  #: Value of what setups are ranked by [SI].
    low: float  #: Lower end of its 95 % interval [SI]; NaN if it is not known.
    high: float  #: Upper end [SI].


@dataclass(frozen=True, slots=True)
class TradeOffLine:
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
    chance: str  #: Heading of the probabilities: it says if they contain only a part of the uncertainty.
    candidates: tuple[Candidate, ...]  #: The most probable setups.
    others: int  #: Number of tied setups that are not listed.
    sure: str  #: Sentence: how sure this is.
    contributions: tuple[Contribution, ...] = ()  #: Contributions to the uncertainty.
    #: Measures of the leading setup: those of the objective, then what gets worse.
    trade_offs: tuple[TradeOffLine, ...] = ()
    unlisted: str = ""  #: Sentence about the measures of the trade-off that are not listed.
    #: Rows of the setups to test next, with what remains of the uncertainty after each.
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
    lines = tuple(map(_line, _by_weight(sheet, known)))
    return Answer(
        grade=_grade(known),
        which=_which(sheet, known, rows),
        chance=chance(known),
        candidates=tuple(_candidate(sheet, known, row) for row in rows[:LISTED]),
        others=max(0, len(rows) - LISTED),
        sure=_sure(known),
        contributions=known.contributions,
        trade_offs=lines[:TRADES] or _predicted_trade_offs(sheet, rows[0]),
        unlisted=_unlisted(lines[TRADES:]),
        tests=tuple(_tests(sheet, known)),
        exact=known.assumes_exact_runs,
    )


def tied(sheet: Sheet) -> list[int]:
    """Return the rows of the tied setups, most probable first; none if no certainty was computed."""
    ties = sheet.certainty.ties if sheet.certainty else ()
    return [row for row in (sheet.row(number) for number in ties) if row is not None]


def chance(known: Certainty) -> str:
    """Return the heading of the probabilities of being best: it says if they contain only a part of the uncertainty."""
    return "probability of being best" if known.is_known else "probability from the known contributions alone"


def _predicted(sheet: Sheet) -> Answer:
    best = int(sheet.order[0])
    value = float(sheet.ranked_by.values[best])
    return Answer(
        Grade.UNKNOWN,
        f"Setup {sheet.numbers[best]} has the best predicted {sheet.ranked_by.name}.",
        "",
        (Candidate(best, "", value, np.nan, np.nan),),
        0,
        "How sure this is, is unknown: the study states no uncertainty. Other setups may be as good.",
        trade_offs=_predicted_trade_offs(sheet, best),
    )


def _grade(known: Certainty) -> Grade:
    if not known.is_known:
        return Grade.UNKNOWN
    sound = len(known.ties) == 1 and not known.contradictions and not known.left_out
    return Grade.USABLE if sound else Grade.LIMITED


def _which(sheet: Sheet, known: Certainty, rows: list[int]) -> str:
    share = _share(known.best[known.row(known.ties[0])])
    if not known.is_known:
        ties = f" From the known contributions alone, {len(rows)} setups are tied." if len(rows) > 1 else ""
        best = f"Setup {sheet.numbers[rows[0]]} has the best predicted {known.criterion}"
        return f"{best}; how sure this is, is not known.{ties}"
    if len(rows) == 1:
        return f"Setup {sheet.numbers[rows[0]]} is the best ({share} probable)."
    return (
        f"One of {len(rows)} setups is the best, with a probability of 95 %. They are tied: "
        f"setup {sheet.numbers[rows[0]]} is the most probable ({share})."
    )


def _candidate(sheet: Sheet, known: Certainty, row: int) -> Candidate:
    place = known.row(int(sheet.numbers[row]))
    levels = known.levels.get(known.criterion)
    low, high = (np.nan, np.nan)
    if levels is not None and levels.is_known:
        low, high = (float(ends[place]) for ends in levels.interval())
    return Candidate(row, _share(known.best[place]), float(sheet.ranked_by.values[row]), low, high)


def _share(probability: float) -> str:
    return certainty.percent(probability) if np.isfinite(probability) else "unknown"


def _sure(known: Certainty) -> str:
    missing = [one.name for one in known.contributions if one.status is Status.UNKNOWN or one in known.left_out]
    if not missing:
        return "All contributions to the uncertainty of the true levels are included."
    return f"Not included or unknown: {', '.join(missing)}. The real uncertainty is larger."


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

    return sorted(known.trade_offs, key=place)


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
    changes = ((one.name, float(one.values[row] / one.values[base]) - 1.0) for one in sheet.measures[:LISTED])
    return tuple(TradeOffLine(name, _signed(one), "unknown", "even") for name, one in changes if np.isfinite(one))


def _signed(share: float) -> str:
    text = percent(100.0 * share)
    return f"+{text}" if share > 0.0 else text


def _tests(sheet: Sheet, known: Certainty) -> Iterator[tuple[int, str]]:
    for test in known.tests:
        row = sheet.row(test.setup)
        if row is not None:
            yield row, percent(100.0 * test.remaining)


def tied_rows(best: Array) -> Flags:
    """Return the smallest set of rows that contains the best one with a probability of 95 %, as flags (S,).

    Args:
        best: Probability of each row of having the best value (S,); NaN counts as zero.
    """
    chance = np.nan_to_num(best)
    order = np.argsort(-chance, kind="stable")
    count = int(np.searchsorted(np.cumsum(chance[order]), TIE)) + 1
    flags = np.zeros(chance.size, dtype=np.bool_)
    flags[order[:count]] = chance[order[:count]] > 0.0
    return flags
