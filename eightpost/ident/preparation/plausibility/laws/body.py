"""Rigid body: points of the chassis move as its four corners do."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

from eightpost.corners import channel
from eightpost.ident.preparation.plausibility.comparison import Comparison, delay, ratio
from eightpost.ident.preparation.plausibility.regression import regress
from eightpost.ident.preparation.plausibility.spectra import Spectra

LAW = "the motion of the chassis"

#: Upper end of the band [Hz].
HIGH = 8.0
#: Tolerance of the sum of the shares of the corners [1], and of delays [s].
SUM, TIME = 0.12, 2e-3


def body_comparisons(spectra: Spectra, corners: Sequence[str]) -> Iterator[Comparison]:
    """Yield the comparisons of points on the chassis with its corners.

        y = sum_i a_i z_i'' - sum_i b_i r_i'' - t y'

    y is the acceleration of the point, or of its height above the roads r_i. If the whole chassis moves up by 1, so
    does the point: sum a_i = 1, and for a height above the road sum b_i = 1. t is the delay of y.
    """
    bodies = [channel(corner, "chassis_acceleration") for corner in corners]
    roads = [channel(corner, "road") for corner in corners]
    if not spectra.has(bodies):
        return
    for name, order in _points(spectra, corners).items():
        is_height = name.rpartition(".")[2] == "ride_height"
        if is_height and not spectra.has(roads):
            continue
        inputs = [spectra.derivative(body) for body in bodies]
        inputs += [spectra.derivative(road, 2) for road in roads] if is_height else []
        inputs.append(spectra.derivative(name, order + 1))
        fit = regress(spectra.derivative(name, order), inputs, spectra.frequencies <= HIGH)
        if fit is None:
            continue
        share = {body: 1.0 / len(bodies) for body in bodies}
        less = {body: -part for body, part in share.items()}
        yield ratio(LAW, fit, lambda c: c[:, : len(bodies)].sum(axis=1), effect={name: 1.0, **less}, tolerance=SUM)
        yield delay(LAW, fit, lambda c: -c[:, -1], effect={name: 1.0, **less}, tolerance=TIME)


def _points(spectra: Spectra, corners: Sequence[str]) -> Mapping[str, int]:
    """Return the points of the chassis that the record has, with the number of derivatives to their acceleration."""
    heights = {**{channel(corner, "aero_position"): 2 for corner in corners}, "aero.heave": 2}
    heights |= dict.fromkeys(("ride_height", "front.ride_height", "rear.ride_height"), 2)
    accelerations = {"cg.vertical_acceleration": 0, "driver.acceleration": 0}
    return {name: order for name, order in (heights | accelerations).items() if name in spectra}
