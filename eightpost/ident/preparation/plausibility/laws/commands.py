"""Commands of the actuators against their measured motions and forces."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from eightpost.corners import channel
from eightpost.ident.preparation.plausibility.comparison import Comparison, Kind, delay, ratio
from eightpost.ident.preparation.plausibility.regression import regress
from eightpost.ident.preparation.plausibility.spectra import Spectra

LAW = "the response of the actuator"

#: Upper end of the band [Hz].
HIGH = 8.0
#: Tolerance of the gain [1], and of the delay compared with the other actuators of its kind [s].
GAIN, TIME = 0.15, 2e-3


def command_comparisons(spectra: Spectra, corners: Sequence[str]) -> Iterator[Comparison]:
    """Yield the comparisons of actuators with their commands: y = g (u + a u' + b u''); a is minus the delay.

    Every actuator has a lag of its own, but actuators of one kind have the same.
    """
    for quantity in ("road", "aero"):
        delays = []
        for name in (channel(corner, quantity) for corner in corners):
            found = _actuator(spectra, name)
            if found is not None:
                yield found[0]
                delays.append(found[1])
        yield from _unlike(delays)


def _actuator(spectra: Spectra, name: str) -> tuple[Comparison, Comparison] | None:
    command = f"{name}_command"
    if not spectra.has((name, command)):
        return None
    inputs = [spectra.derivative(command, order) for order in range(3)]
    fit = regress(spectra.derivative(name), inputs, spectra.frequencies <= HIGH)
    if fit is None:
        return None
    gain = ratio(LAW, fit, lambda c: c[:, 0], effect={name: 1.0, command: -1.0}, tolerance=GAIN)
    late = delay(LAW, fit, lambda c: -c[:, 1] / c[:, 0], effect={name: 1.0, command: -1.0}, tolerance=TIME,
                 over=(0,))  # fmt: skip
    return gain, late


def _unlike(delays: Sequence[Comparison]) -> Iterator[Comparison]:
    """Yield the comparison of each actuator's delay with the median of the others; at least three are needed."""
    if len(delays) < 3:
        return
    for own in delays:
        others = [other for other in delays if other is not own]
        middle = float(np.median([other.value for other in others]))
        yield Comparison(LAW, Kind.DELAY, own.value - middle, TIME, own.deviation, own.effect)
