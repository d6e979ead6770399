"""Potentiometers and shock load cells that are swapped together, so that they still match each other."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations

from eightpost.corners import channel
from eightpost.ident.preparation.plausibility.finding import Finding
from eightpost.ident.preparation.plausibility.regression import regress
from eightpost.ident.preparation.plausibility.rules import SWAPPED
from eightpost.ident.preparation.plausibility.spectra import Spectra

#: Mean share of the variance [1] by which exchanged corners must be explained better.
BETTER = 0.15

_TOGETHER = ("displacement", "velocity", "force")


def swaps(spectra: Spectra, corners: Sequence[str]) -> tuple[Finding, ...]:
    """Return the pairs of corners whose potentiometers match the accelerometers of each other's corner."""
    found = []
    for first, second in combinations(corners, 2):
        own, exchanged = (
            _shares(spectra, (first, second), (first, second)),
            _shares(spectra, (first, second), (second, first)),
        )
        if own is not None and exchanged is not None and exchanged > own + BETTER:
            found.append(_finding(first, second, own, exchanged, spectra))
    return tuple(found)


def exchanged(spectra: Spectra, findings: Sequence[Finding]) -> Spectra:
    """Return the spectra with the swapped channels exchanged."""
    rows = dict(spectra.rows)
    for finding in findings:
        half = len(finding.channels) // 2
        for one, other in zip(finding.channels[:half], finding.channels[half:], strict=True):
            rows[one], rows[other] = rows[other], rows[one]
    return replace(spectra, rows=rows)


def _shares(spectra: Spectra, pots: Sequence[str], accelerometers: Sequence[str]) -> float | None:
    """Return the mean explained share of potentiometers with the accelerometers of given corners."""
    total = 0.0
    for pot, place in zip(pots, accelerometers, strict=True):
        names = [channel(place, name) for name in ("hub_acceleration", "chassis_acceleration")]
        own = channel(pot, "displacement")
        if not spectra.has((own, *names)):
            return None
        fit = regress(spectra.derivative(own, 2), [spectra.derivative(name) for name in names])
        if fit is None:
            return None
        # Signs are those of hub minus chassis; other signs are chance.
        total += fit.explained if fit.values[0] > 0.0 > fit.values[1] else 0.0
    return total / len(pots)


def _finding(first: str, second: str, own: float, exchanged: float, spectra: Spectra) -> Finding:
    quantities = [name for name in _TOGETHER if spectra.has((channel(first, name), channel(second, name)))]
    channels = tuple(channel(corner, name) for corner in (first, second) for name in quantities)
    text = (
        f"{first} and {second} are swapped in {', '.join(quantities)}: hub and chassis accelerations explain "
        f"{100.0 * exchanged:.0f} % of the travels with this exchange and {100.0 * own:.0f} % without"
    )
    return Finding(SWAPPED, channels, text, SWAPPED.remedy)
