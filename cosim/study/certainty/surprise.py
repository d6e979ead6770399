"""Measured levels that the prediction, its uncertainty and the other rig runs do not explain."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from cosim.study.certainty.mixture import probability_below
from cosim.study.certainty.posterior import Observations, Posterior
from cosim.study.certainty.sources import ErrorSources
from eightpost.array_types import Integers

#: Probability of a deviation below which a measured level contradicts the prediction.
SURPRISING = 0.005

#: Fewest levels of a measure of which one can contradict the others.
_FEWEST = 3


class Surprise(NamedTuple):
    """A measured level that is improbable."""

    position: int  #: Position of the level.
    probability: float  #: Probability of a deviation at least as large.
    used: bool  #: Whether it agrees with the other rig runs, so that it is taken into account.


def surprises_of(sources: ErrorSources, seen: Observations) -> list[Surprise]:
    """Return the measured levels that are improbable.

    A level is compared with the prediction alone, and with the prediction from the other levels of the same measure.
    With three levels or more, a level that the others contradict is left out, one after the other: the one without
    which the others agree best with the prediction. Of two levels that contradict each other, the probability
    of a deviation alone does not say which one is wrong. Levels that agree with each other, but not with the
    prediction, are named and used.
    """
    found = list[Surprise]()
    for m in sorted(set(seen.measures.tolist())):
        kept = np.flatnonzero(seen.measures == m)
        while kept.size >= _FEWEST:
            chances = [_chance(sources, seen, int(k), kept[kept != k]) for k in kept]
            doubtful = [place for place, chance in enumerate(chances) if chance < SURPRISING]
            if not doubtful:
                break
            without = [Posterior(sources, seen.only(np.delete(kept, place))).agreement(m) for place in doubtful]
            worst = doubtful[int(np.argmax(without))]
            found.append(Surprise(int(kept[worst]), chances[worst], used=False))
            kept = np.delete(kept, worst)
        alone = [(int(k), _chance(sources, seen, int(k), kept[:0])) for k in kept]
        found += [Surprise(k, chance, used=True) for k, chance in alone if chance < SURPRISING]
    return found


def _chance(sources: ErrorSources, seen: Observations, position: int, others: Integers) -> float:
    """Return the probability of a level at least as far from its prediction from some of the others."""
    posterior = Posterior(sources, seen.only(others))
    m = int(seen.measures[position])
    middle, student, normal = posterior.of_setup(int(seen.rows[position]), m)
    normal += float(seen.deviations[position]) ** 2
    apart = np.array([-abs(float(seen.changes[position]) - middle)])
    degrees = posterior.degrees(np.array([m]))
    return float(2.0 * probability_below(apart, np.array([student]), np.array([normal]), degrees)[0])
