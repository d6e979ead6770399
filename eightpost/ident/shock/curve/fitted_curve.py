"""Conversion of fitted coefficients to a static curve: its range, its straight ends, and a check for falling parts."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.stats import theilslopes

from eightpost.ident.shock.curve.basis import GRID, CurveBasis, split_coefficients
from eightpost.shock import StaticCurve
from eightpost.units import convert

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]

#: Last part of a side's range, from which the robust end slope is computed.
_LAST_PART = 0.2

#: The polynomial's own end slope is used while it is within this factor of the robust one.
_REASONABLE = 2.0

#: A curve is reported as falling where it falls by more than this share of its range of force.
NOTABLE_FALL = 1e-3


def fitted_curve(basis: CurveBasis, coefficients: Array, velocity: Array) -> tuple[StaticCurve, list[str]]:
    """Return the curve of coefficients (23,) [N] with straight ends, and warnings.

    Args:
        basis: Basis functions with the transition.
        coefficients: Coefficients in the order of the design.
        velocity: All velocities (N,) of the fit [m/s]; their range becomes the fitted range.
    """
    highest, lowest = float(velocity.max()), float(velocity.min())
    compression_slope, why_compression = _end_slope(basis, coefficients, highest)
    rebound_slope, why_rebound = _end_slope(basis, coefficients, lowest)
    inner, compression, rebound = split_coefficients(coefficients)
    curve = StaticCurve(
        inner=inner,
        compression=compression,
        rebound=rebound,
        transition_speed=basis.transition_speed,
        transition_width=basis.transition_width,
        compression_speed=highest,
        rebound_speed=-lowest,
        compression_slope=compression_slope,
        rebound_slope=rebound_slope,
    )
    return curve, [*why_compression, *why_rebound, *_turns(basis, coefficients, lowest, highest)]


def _end_slope(basis: CurveBasis, coefficients: Array, end: float) -> tuple[float, list[str]]:
    """Return the slope beyond a signed end of the range [N.s/m], and a warning if it is not the polynomial's own.

    The last slope of a polynomial depends on few samples. If it differs too much from the robust (Theil-Sen) slope of
    the curve's last fifth, the robust slope is used; if that is negative too, the chord from the transition.
    """
    velocity = np.linspace(1.0 - _LAST_PART, 1.0, 41) * end
    force = basis.design(velocity) @ coefficients
    own = float((force[-1] - force[-2]) / (velocity[-1] - velocity[-2]))
    robust = float(theilslopes(force, velocity).slope)
    if robust > 0.0 and robust / _REASONABLE <= own <= robust * _REASONABLE:
        return own, []
    start = float(np.copysign(min(basis.transition_speed, 0.5 * abs(end)), end))
    chord = float((force[-1] - basis.design(np.array([start]))[0] @ coefficients) / (end - start))
    slope = robust if robust > 0.0 else max(chord, 0.0)
    return slope, [
        f"the curve's slope at {_inch(end)}, the end of the range, is {own:.4g} N.s/m and that of its last fifth "
        f"{robust:.4g}: beyond the range the curve continues with {slope:.4g}; few samples lie there"
    ]


def _turns(basis: CurveBasis, coefficients: Array, lowest: float, highest: float) -> list[str]:
    """Return a warning with the velocities between which the force falls with rising velocity."""
    velocity = np.linspace(lowest, highest, GRID)
    force = basis.design(velocity) @ coefficients
    drop = np.maximum.accumulate(force) - force
    if drop.max() <= NOTABLE_FALL * np.ptp(force):
        return []
    falls = np.flatnonzero(np.diff(force) < 0.0)
    runs = np.split(falls, np.flatnonzero(np.diff(falls) > 1) + 1)
    notable = [run for run in runs if force[run[0]] - force[run[-1] + 1] > 0.1 * NOTABLE_FALL * np.ptp(force)]
    places = ", ".join(f"{_number(velocity[run[0]])} to {_inch(velocity[run[-1] + 1])}" for run in notable)
    return [f"the fitted curve is not monotone: the force falls from {places}, by up to {drop.max():.3g} N"]


def _number(velocity: float) -> str:
    return f"{convert(float(velocity), 'm/s', 'in/s'):.3g}"


def _inch(velocity: float) -> str:
    return f"{_number(velocity)} in/s"
