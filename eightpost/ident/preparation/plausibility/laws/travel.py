"""Kinematics of a shock: its travel follows from the motions of hub and chassis."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from eightpost.corners import channel
from eightpost.ident.preparation.plausibility.comparison import Comparison, delay, ratio
from eightpost.ident.preparation.plausibility.laws.pairs import across, axles, difference
from eightpost.ident.preparation.plausibility.regression import Regression, regress
from eightpost.ident.preparation.plausibility.spectra import Spectra

LAW = "the kinematics of the shock"
SLOPE = "the slope of the displacement"

#: Usual motion ratio (travel of the shock over that of the wheel) and its tolerance as a logarithm: 0.28 to 1.6.
MOTION_RATIO, MOTION_RATIO_RANGE = 0.67, float(np.log(2.4))
#: Tolerance of the ratio of the motion ratios from hub and from chassis, and of left and right [1].
SAME, SYMMETRIC = 0.08, 0.1
#: Tolerance of delays [s].
SAME_TIME = 1.5e-3
#: Tolerance of velocity over the slope of displacement [1], and of their delay [s].
SLOPE_RATIO, SLOPE_TIME = 0.06, 1.5e-3


def travel_fit(spectra: Spectra, corner: str) -> Regression | None:
    """Return the coefficients of x'' = n (w'' + t w''') - n (z'' + t z''') + the same across the axle.

    x is the travel of the shock, w'' and z'' the accelerations of hub and chassis, n the motion ratio, and t a delay.
    The coefficients are (n, n t, -n, -n t), then those of the other side, to which a solid axle connects the shock.
    """
    pot = channel(corner, "displacement")
    if not spectra.has((pot, *_accelerometers(corner))):
        return None
    names = list(_accelerometers(corner))
    other = across(corner)
    if other is not None and spectra.has(_accelerometers(other)):
        names += _accelerometers(other)
    return regress(spectra.derivative(pot, 2), [spectra.derivative(n, order) for n in names for order in (0, 1)])


def _accelerometers(corner: str) -> tuple[str, str]:
    return channel(corner, "hub_acceleration"), channel(corner, "chassis_acceleration")


def travel_comparisons(spectra: Spectra, corners: Sequence[str]) -> Iterator[Comparison]:
    """Yield the comparisons of potentiometers with accelerometers, and of the potentiometers of an axle."""
    ratios: dict[str, Comparison] = {}
    for corner in corners:
        fit = travel_fit(spectra, corner)
        if fit is None:
            continue
        pot, (hub, chassis) = channel(corner, "displacement"), _accelerometers(corner)
        yield ratio(LAW, fit, lambda c: -c[:, 0] / c[:, 2], effect={hub: -1.0, chassis: 1.0}, tolerance=SAME)
        ratios[corner] = ratio(LAW, fit, lambda c: c[:, 0], effect={pot: 1.0, hub: -1.0},
                               tolerance=MOTION_RATIO_RANGE, expected=MOTION_RATIO)  # fmt: skip
        for column, accelerometer in ((0, hub), (2, chassis)):
            yield delay(LAW, fit, lambda c, k=column: c[:, k + 1] / c[:, k],  # type: ignore[misc]
                        effect={pot: -1.0, accelerometer: 1.0}, tolerance=SAME_TIME, over=(column,))  # fmt: skip
    yield from ratios.values()
    for left, right in axles(ratios):
        yield difference(ratios[left], ratios[right], SYMMETRIC)


def slope_comparisons(spectra: Spectra, corners: Sequence[str]) -> Iterator[Comparison]:
    """Yield the comparisons of each velocity with the slope of the displacement: v = g (x' + t x'')."""
    for corner in corners:
        velocity, pot = channel(corner, "velocity"), channel(corner, "displacement")
        if not spectra.has((velocity, pot)):
            continue
        inputs = [spectra.derivative(pot, order) for order in (1, 2)]
        fit = regress(spectra.derivative(velocity), inputs)
        if fit is not None:
            yield ratio(SLOPE, fit, lambda c: c[:, 0], effect={velocity: 1.0, pot: -1.0}, tolerance=SLOPE_RATIO)
            yield delay(SLOPE, fit, lambda c: c[:, 1] / c[:, 0], effect={velocity: -1.0, pot: 1.0},
                        tolerance=SLOPE_TIME, over=(0,))  # fmt: skip
