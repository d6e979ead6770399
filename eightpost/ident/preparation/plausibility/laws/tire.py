"""Law of a tire: force over the difference of road and hub."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from eightpost.corners import channel
from eightpost.ident.preparation.plausibility.comparison import Comparison, delay, ratio
from eightpost.ident.preparation.plausibility.laws.pairs import axles, difference
from eightpost.ident.preparation.plausibility.regression import Regression, regress
from eightpost.ident.preparation.plausibility.spectra import Spectra

LAW = "the law of the tire"

#: Usual stiffness [N/m] and its tolerance as a logarithm: 120 to 1000 N/mm.
STIFFNESS, STIFFNESS_RANGE = 350e3, float(np.log(3.0))
#: Usual ratio of damping and stiffness, and its tolerance [s]: of hysteresis and damping together.
DAMPING_TIME, DAMPING_TIME_RANGE = 1.25e-3, 2.5e-3
#: Tolerance of the ratio of the stiffnesses from road and from hub [1], and of left and right tires [1].
SAME, SYMMETRIC = 0.08, 0.15
#: Tolerance of the difference between the delays of road and hub, and of left and right tires [s].
SAME_TIME, SYMMETRIC_TIME = 1.5e-3, 2e-3


def tire_fit(spectra: Spectra, corner: str) -> Regression | None:
    """Return the coefficients of T'' = k r'' + c r''' + m r'''' - k w'' - c w'''.

    T is the tire force, r the road, w'' the hub's acceleration, k the stiffness, c the damping, and m the mass of the
    wheelloader's pan above its load cell. The coefficients are (k, c, m, -k, -c).
    """
    force, road, hub = (channel(corner, name) for name in ("tire_force", "road", "hub_acceleration"))
    if not spectra.has((force, road, hub)):
        return None
    inputs = [*(spectra.derivative(road, order) for order in (2, 3, 4)), spectra.derivative(hub)]
    return regress(spectra.derivative(force, 2), [*inputs, spectra.derivative(hub, 1)])


def tire_comparisons(spectra: Spectra, corners: Sequence[str]) -> Iterator[Comparison]:
    """Yield the comparisons of each tire, and of the tires of each axle."""
    fits = {corner: fit for corner in corners if (fit := tire_fit(spectra, corner)) is not None}
    stiffness, times = {}, {}
    for corner, fit in fits.items():
        force, road, hub = (channel(corner, name) for name in ("tire_force", "road", "hub_acceleration"))
        yield ratio(LAW, fit, lambda c: -c[:, 0] / c[:, 3], effect={road: -1.0, hub: 1.0}, tolerance=SAME)
        stiffness[corner] = ratio(LAW, fit, lambda c: -c[:, 3], effect={force: 1.0, hub: -1.0},
                                  tolerance=STIFFNESS_RANGE, expected=STIFFNESS)  # fmt: skip
        yield delay(LAW, fit, lambda c: c[:, 1] / c[:, 0] - c[:, 4] / c[:, 3], effect={road: 1.0, hub: -1.0},
                    tolerance=SAME_TIME, over=(0, 3))  # fmt: skip
        times[corner] = delay(LAW, fit, lambda c: c[:, 4] / c[:, 3], effect={force: -1.0, hub: 1.0},
                              tolerance=DAMPING_TIME_RANGE, over=(3,), expected=DAMPING_TIME)  # fmt: skip
    yield from (*stiffness.values(), *times.values())
    for left, right in axles(fits):
        yield difference(stiffness[left], stiffness[right], SYMMETRIC)
        yield difference(times[left], times[right], SYMMETRIC_TIME)
