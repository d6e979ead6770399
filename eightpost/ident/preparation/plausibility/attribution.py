"""Attribution of violated laws to the channel whose gain or delay explains them."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from eightpost.ident.preparation.plausibility.comparison import SIGNIFICANT, Comparison, Kind
from eightpost.ident.preparation.plausibility.spectra import Spectra

#: Largest number of faults that are searched in one record.
MOST = 12
#: Share of the best explanation's gain in likelihood from which another channel explains the laws as well.
AS_GOOD = 0.95
#: Minimum share of the violations' squared scores that an explanation must remove.
EXPLAINS = 0.25
#: Smallest gain, as a logarithm, and smallest delay [s] that are reported.
SMALLEST = {Kind.GAIN: 0.04, Kind.DELAY: 0.7e-3}

#: Channels of each dimension, for a unit that is wrong in all of them.
DIMENSIONS = {
    "all forces": ("tire_force", "force", "aero", "aero_force", "heave_force"),
    "all accelerations": ("hub_acceleration", "chassis_acceleration", "vertical_acceleration"),
}


class Fault(NamedTuple):
    """A gain or a delay that explains violated laws.

    Attributes:
        kind: Kind of the fault.
        name: Channel, `*.quantity` for a quantity at all corners, or the name of a group.
        channels: Channels that it concerns.
        value: Logarithm of the gain, or delay [s].
        deviation: Standard deviation of the value.
        law: Law that shows it best.
        others: Channels or groups that explain the laws equally well.
    """

    kind: Kind
    name: str
    channels: tuple[str, ...]
    value: float
    deviation: float
    law: str
    others: tuple[str, ...] = ()


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
        gain, delay = (np.exp(best.value), 0.0) if best.kind is Kind.GAIN else (1.0, best.value)
        spectra = spectra.corrected(best.channels, gain=float(gain), delay=delay)
        key = best.kind, best.name
        earlier = found.get(key)
        if earlier is not None:
            best = earlier._replace(value=earlier.value + best.value)
        found[key] = best
        left = tuple(compare(spectra))
    faults = tuple(fault for fault in found.values() if abs(fault.value) > SMALLEST[fault.kind])
    return Attribution(faults, tuple(one for one in left if one.is_violated))


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
    scales = np.array([one.scale for one in comparisons])
    scores = np.array([one.score for one in comparisons])
    violated = np.array([one.is_violated for one in comparisons])
    for name, channels in _hypotheses(comparisons).items():
        effect = np.array([sum(one.effect.get(channel, 0.0) for channel in channels) for one in comparisons]) / scales
        norm = float(effect @ effect)
        if norm == 0.0 or not np.any(violated & (np.abs(effect) > 0.0)):
            continue
        value = float(effect @ scores) / norm
        reduction = value**2 * norm
        if reduction < SIGNIFICANT**2 or reduction < EXPLAINS * float(np.sum((scores * (effect != 0.0)) ** 2)):
            continue
        sharpest = comparisons[int(np.argmax(np.abs(effect)))]
        yield reduction, Fault(sharpest.kind, name, channels, value, float(norm**-0.5), sharpest.law)


def _hypotheses(comparisons: Sequence[Comparison]) -> Mapping[str, tuple[str, ...]]:
    """Return what may be wrong: each channel, each quantity at all corners, and all channels of a dimension."""
    names = tuple(dict.fromkeys(name for one in comparisons for name in one.effect))
    known = {name: (name,) for name in names}
    quantities: dict[str, list[str]] = {}
    for name in names:
        quantities.setdefault(name.rpartition(".")[2], []).append(name)
    known |= {f"*.{quantity}": tuple(own) for quantity, own in quantities.items() if len(own) > 1}
    for dimension, members in DIMENSIONS.items():
        known[dimension] = tuple(name for name in names if name.rpartition(".")[2] in members)
    return known
