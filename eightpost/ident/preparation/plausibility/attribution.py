"""Attribution of violated laws to the channel whose gain or delay explains them."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from eightpost.array_types import Array
from eightpost.ident.preparation.plausibility.comparison import SIGNIFICANT, Comparison, Kind
from eightpost.ident.preparation.plausibility.spectra import Spectra

#: Largest number of faults that are searched in one record.
MOST = 12
#: Share of the best explanation's gain in likelihood from which another channel explains the laws as well.
AS_GOOD = 0.95
#: Minimum share of the violations' squared scores that an explanation must remove.
EXPLAINS = 0.25
#: Largest number of times that a fault is estimated again after its correction.
REFINEMENTS = 4
#: Smallest gain, as a logarithm, and smallest delay [s] that are reported.
SMALLEST = {Kind.GAIN: 0.04, Kind.DELAY: 0.7e-3}

#: Channels of each dimension, for a unit that is wrong in all of them.
DIMENSIONS = {
    "all forces": ("tire_force", "force", "aero", "aero_force", "heave_force"),
    "all accelerations": ("hub_acceleration", "chassis_acceleration", "vertical_acceleration"),
}


class Fault(NamedTuple):
    """A gain or a delay that explains violated laws."""

    kind: Kind  #: Kind of the fault.
    name: str  #: Channel, `*.quantity` for a quantity at all corners, or the name of a group.
    channels: tuple[str, ...]  #: Channels that it concerns.
    value: float  #: Logarithm of the gain, or delay [s].
    deviation: float  #: Standard deviation of the value.
    law: str  #: Law that shows it best.
    others: tuple[str, ...] = ()  #: Channels or groups that explain the laws equally well.


class Attribution(NamedTuple):
    """Faults that explain a record, and the comparisons that remain violated."""

    faults: tuple[Fault, ...]
    unexplained: tuple[Comparison, ...]


def attribute(spectra: Spectra, compare: Callable[[Spectra], Iterator[Comparison]]) -> Attribution:
    """Return the faults of a record.

    The channel that removes most of the squared scores is corrected, then all laws are estimated again, until none is
    violated. So a large fault does not hide a small one, and the figures do not depend on the linearisation.

    Args:
        spectra: Spectra of the record.
        compare: Function that returns the comparisons of all laws.
    """
    found: dict[tuple[Kind, str], Fault] = {}
    left = tuple(compare(spectra))
    for _ in range(MOST):
        best = _best(left)
        if best is None:
            break
        spectra, left, best = _corrected(spectra, left, best, compare)
        key = best.kind, best.name
        found[key] = best._replace(value=best.value + found[key].value) if key in found else best
    faults = tuple(fault for fault in found.values() if abs(fault.value) > SMALLEST[fault.kind])
    return Attribution(faults, tuple(one for one in left if one.is_violated))


def _corrected(
    spectra: Spectra, left: tuple[Comparison, ...], fault: Fault, compare: Callable[[Spectra], Iterator[Comparison]]
) -> tuple[Spectra, tuple[Comparison, ...], Fault]:
    """Return the spectra with a fault corrected, their comparisons, and the fault with its refined value."""
    total, step = 0.0, fault.value
    for _ in range(REFINEMENTS):
        gain, delay = (float(np.exp(step)), 0.0) if fault.kind is Kind.GAIN else (1.0, step)
        spectra = spectra.corrected(fault.channels, gain=gain, delay=delay)
        total, left = total + step, tuple(compare(spectra))
        step = _least_squares([one for one in left if one.kind is fault.kind], fault.channels).value
        if abs(step) < 0.02 * abs(total):
            break
    return spectra, left, fault._replace(value=total)


class _Estimate(NamedTuple):
    """Least-squares estimate of a fault from all comparisons."""

    value: float  #: Logarithm of the gain, or delay [s].
    norm: float  #: Sum of the squared effects on the scores.
    effects: Array  #: Effect on each score (C,).
    scores: Array  #: Scores (C,).

    @property
    def reduction(self) -> float:
        """Reduction of the sum of squared scores."""
        return self.value**2 * self.norm


def _least_squares(comparisons: Sequence[Comparison], channels: Sequence[str]) -> _Estimate:
    effects = np.array([sum(one.effect.get(n, 0.0) for n in channels) / one.scale for one in comparisons])
    scores = np.array([one.score for one in comparisons])
    norm = float(effects @ effects)
    return _Estimate(float(effects @ scores) / norm if norm > 0.0 else 0.0, norm, effects, scores)


def _best(comparisons: Sequence[Comparison]) -> Fault | None:
    """Return the explanation with the largest reduction of squared scores; None if no law is violated."""
    candidates = []
    for kind in Kind:
        own = [one for one in comparisons if one.kind is kind]
        if any(one.is_violated for one in own):
            candidates += list(_explanations(own))
    if not candidates:
        return None
    # A single channel is preferred to a group that explains as much.
    top, best = max(candidates, key=lambda entry: entry[0] * (1.0 if len(entry[1].channels) == 1 else 0.98))
    rivals = [fault for score, fault in candidates if score >= AS_GOOD * top and fault.kind is best.kind]
    others = tuple(f.name for f in rivals if not set(f.channels) & set(best.channels))
    return best._replace(others=others)


def _explanations(comparisons: Sequence[Comparison]) -> Iterator[tuple[float, Fault]]:
    """Yield the reduction of squared scores with each explanation that removes enough of the violations."""
    violated = np.array([one.is_violated for one in comparisons])
    for name, channels in _hypotheses(comparisons).items():
        found = _least_squares(comparisons, channels)
        concerned = found.effects != 0.0
        if not np.any(violated & concerned):
            continue
        if found.reduction > max(SIGNIFICANT**2, EXPLAINS * float(np.sum(found.scores[concerned] ** 2))):
            sharpest = comparisons[int(np.argmax(np.abs(found.effects)))]
            fault = Fault(sharpest.kind, name, channels, found.value, found.norm**-0.5, sharpest.law)
            yield found.reduction, fault


def _hypotheses(comparisons: Sequence[Comparison]) -> Mapping[str, tuple[str, ...]]:
    """Return what may be wrong: each channel, each quantity at all corners, and all channels of a dimension."""
    names = tuple(dict.fromkeys(name for one in comparisons for name in one.effect))
    known: dict[str, tuple[str, ...]] = {name: (name,) for name in names}
    quantities: dict[str, list[str]] = {}
    for name in names:
        quantities.setdefault(name.rpartition(".")[2], []).append(name)
    known |= {f"*.{quantity}": tuple(own) for quantity, own in quantities.items() if len(own) > 1}
    for dimension, members in DIMENSIONS.items():
        known[dimension] = tuple(name for name in names if name.rpartition(".")[2] in members)
    return known
