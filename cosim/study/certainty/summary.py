"""Summary of a certainty in a few sentences, for the console and the page."""

from __future__ import annotations

from collections.abc import Iterator

from cosim.study.certainty.certainty import TIE, Certainty, Status, TradeOff
from cosim.study.result import StudyResult

#: Number of ties and of other measures that are named.
_TIES, _MEASURES = 5, 3


def summary_lines(result: StudyResult, certainty: Certainty) -> Iterator[str]:
    """Yield the tie set with its probabilities, trade-offs, next tests, and what is not known."""
    if certainty.leader is None:
        yield "no setup meets the constraints with a notable probability"
        return
    leader = result.study.space.setup(certainty.leader)
    chance = percent(certainty.probability(leader.index))
    if certainty.is_known:
        yield f"most probably the best by {certainty.criterion}: setup {leader.index} ({leader}), {chance}"
    else:
        yield f"lowest by {certainty.criterion}: setup {leader.index} ({leader}); how sure this is, is not known"
        yield f"from the known contributions alone, it is the best with a probability of {chance}"
    yield _ties(certainty)
    yield from _trade_offs(certainty)
    if certainty.tests:
        names = ", ".join(str(test.setup) for test in certainty.tests)
        left = percent(certainty.tests[-1].remaining)
        left = left if certainty.tests[-1].remaining < 0.001 else f"about {left}"
        exact = ", if rig runs repeat exactly" if certainty.assumes_exact_runs else ""
        yield f"test next: {names}; {left} of the uncertainty about the ties remains{exact} (eightpost confirm)"
    for one in certainty.contributions:
        if one.status is not Status.INCLUDED:
            yield f"{one.status.value}: {one.name}: {one.text}"
    yield from (f"approximation: {text}" for text in (*certainty.notes, *certainty.remarks))


def percent(probability: float) -> str:
    """Return a probability in percent.

    >>> percent(0.6234), percent(0.9996), percent(0.0001)
    ('62 %', 'above 99.9 %', 'below 0.1 %')
    """
    if 0.001 <= probability <= 0.999:
        return f"{100.0 * probability:.1f} %" if not 0.1 <= probability <= 0.9 else f"{100.0 * probability:.0f} %"
    return "above 99.9 %" if probability > 0.5 else "below 0.1 %"


def _ties(certainty: Certainty) -> str:
    count = len(certainty.ties)
    if count == 1:
        return f"no other setup is needed to contain the best one with a probability of {100 * TIE:g} %"
    named = ", ".join(f"{setup} {percent(certainty.probability(setup))}" for setup in certainty.ties[:_TIES])
    more = f" and {count - _TIES} more" if count > _TIES else ""
    return f"{count} setups are tied; one of them is the best with a probability of {100 * TIE:g} %: {named}{more}"


def _trade_offs(certainty: Certainty) -> Iterator[str]:
    """Yield the changes of other measures of the leading setup from the baseline, the largest first."""
    worse = sorted((one for one in certainty.trade_offs if one.low > 0.0), key=lambda one: -one.change)
    better = sorted((one for one in certainty.trade_offs if one.high < 0.0), key=lambda one: one.change)
    for words, found in (("worse", worse), ("better", better)):
        if found:
            named = ", ".join(_change(one) for one in found[:_MEASURES])
            more = f" and {len(found) - _MEASURES} more" if len(found) > _MEASURES else ""
            yield f"{words} than the baseline with a probability of 97.5 %: {named}{more}"


def _change(one: TradeOff) -> str:
    return f"{one.measure} {100 * one.change:+.1f} % ({100 * one.low:+.1f} to {100 * one.high:+.1f})"
