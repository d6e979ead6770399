"""Channels with the wrong sign: no positive gain makes them agree with mechanics."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import numpy as np

from eightpost.ident.preparation.plausibility.attribution import AS_GOOD
from eightpost.ident.preparation.plausibility.comparison import SMALLEST, Comparison, Kind
from eightpost.ident.preparation.plausibility.finding import Finding
from eightpost.ident.preparation.plausibility.rules import WRONG_SIGN
from eightpost.ident.preparation.plausibility.spectra import Spectra

#: Largest number of wrong signs that are searched in one record.
MOST = 4
#: Share of the squared scores of the violations of a channel's laws that may remain if its sign is reversed.
REMAINS = 0.5

Compare = Callable[[Spectra], Iterator[Comparison]]


def wrong_signs(spectra: Spectra, compare: Compare) -> tuple[Finding, ...]:
    """Return the channels whose sign must be reversed.

    Where a law's ratio is negative, each of its channels is reversed. The one that removes most of all violations is
    taken, until none removes half of those of its own laws.

    Args:
        spectra: Spectra of the record.
        compare: Function that returns the comparisons of all laws.
    """
    found = list[Finding]()
    left = tuple(compare(spectra))
    while len(found) < MOST and (suspects := _suspects(left)):
        reversals = {name: tuple(compare(reversed_spectra(spectra, [name]))) for name in suspects}
        best = min(reversals, key=lambda name: _violations(reversals[name]))
        if _violations(_of(best, reversals[best])) > REMAINS * _violations(_of(best, left)):
            break
        most = _violations(left) - AS_GOOD * (_violations(left) - _violations(reversals[best]))
        rivals = [name for name in suspects if name != best and _violations(reversals[name]) <= most]
        found.append(_finding(best, rivals, left))
        spectra, left = reversed_spectra(spectra, [best]), reversals[best]
    return tuple(found)


def reversed_spectra(spectra: Spectra, names: Sequence[str]) -> Spectra:
    """Return the spectra with the signs of some channels reversed."""
    return spectra.corrected(names, gain=-1.0)


def _is_negative(one: Comparison) -> bool:
    return one.kind is Kind.GAIN and one.is_violated and one.value <= np.log(SMALLEST)


def _suspects(comparisons: Sequence[Comparison]) -> list[str]:
    """Return the channels of the laws with a negative ratio."""
    return list(dict.fromkeys(name for one in comparisons if _is_negative(one) for name in one.effect))


def _of(name: str, comparisons: Sequence[Comparison]) -> list[Comparison]:
    """Return the comparisons that depend on a channel, so that another channel's fault does not count."""
    return [one for one in comparisons if name in one.effect]


def _violations(comparisons: Sequence[Comparison]) -> float:
    """Return the sum of the squared scores of all violated comparisons."""
    return float(sum(one.score**2 for one in comparisons if one.is_violated))


def _finding(name: str, rivals: Sequence[str], comparisons: Sequence[Comparison]) -> Finding:
    laws = dict.fromkeys(one.law for one in comparisons if _is_negative(one) and name in one.effect)
    unless = f" (unless that of {' or '.join(rivals)} is wrong, which explains it as well)" if rivals else ""
    text = f"{name} has the wrong sign{unless}: with the opposite one it agrees with {' and '.join(laws)}"
    remedy = f"set gain = -1 in the channel map, or pass --flip {name}"
    return Finding(WRONG_SIGN, (name,), text, remedy)
