"""A curve with a steeper or flatter side: the change that a click would make on a shock without a fitted adjuster."""

from __future__ import annotations

import numpy as np

from eightpost.array_types import Array
from eightpost.errors import ParameterError
from eightpost.shock.curve import KNOTS, StaticCurve
from eightpost.shock.shape import SHARES, SIDES, joined

#: Speed at which a change of the low-speed slope has fallen to a quarter [m/s].
LOW_SPEED = 0.1


def with_slope(curve: StaticCurve, side: str, share: float, speeds: str) -> tuple[StaticCurve, StaticCurve]:
    """Return a curve through knots, and the same curve with a steeper side; both have the same knots.

    Low-speed slopes change by the share w = 1 / (1 + (v / 0.1 m/s)^2)^2 of the change, high-speed ones by 1 - w, and
    the slopes at all speeds by the whole change.

    Args:
        curve: Curve, of polynomials or through knots.
        side: `compression` or `rebound`.
        share: Relative change of the slope [1], such as 0.1.
        speeds: `low`, `high` or `all`.

    Raises:
        ParameterError: The side or the speeds do not exist, or no slope would be left.
    """
    if side not in SIDES or speeds not in ("low", "high", "all"):
        raise ParameterError(f"a change is of compression or rebound, at low, high or all speeds, not {side}, {speeds}")
    if not share > -1.0:
        raise ParameterError(f"a slope cannot change by {share:g}: nothing would be left; use a change above -1")
    velocity = joined(-curve.rebound_speed * SHARES, curve.compression_speed * SHARES)
    places, sign = np.array(velocity), 1.0 if side == "compression" else -1.0
    near = 1.0 / (1.0 + (places / LOW_SPEED) ** 2) ** 2
    factors = 1.0 + share * {"low": near, "high": 1.0 - near, "all": np.ones(KNOTS)}[speeds]
    own = sign * (places[1:] + places[:-1]) > 0.0
    cells = np.where(own, 0.5 * (factors[1:] + factors[:-1]), 1.0)
    knots = np.where(sign * places >= 0.0, factors, 1.0)
    return _through(curve, velocity, np.ones(KNOTS - 1), np.ones(KNOTS)), _through(curve, velocity, cells, knots)


def _through(curve: StaticCurve, velocity: tuple[float, ...], cells: Array, knots: Array) -> StaticCurve:
    """Return a rising curve through knots on a curve, its slopes times factors of the cells (K - 1,) and knots (K,)."""
    widths = np.diff(velocity)
    secants = np.maximum(np.diff([curve.force(v) for v in velocity]) / widths, 0.0)
    inner = (secants[:-1] * widths[1:] + secants[1:] * widths[:-1]) / (widths[1:] + widths[:-1])
    slope = knots * np.concatenate([[curve.rebound_slope], inner, [curve.compression_slope]])
    total = np.concatenate([[0.0], np.cumsum(secants * widths * cells)])
    return StaticCurve.through_knots(
        velocity,
        tuple((total - total[KNOTS // 2]).tolist()),
        tuple(np.minimum(slope, 3.0 * _least(secants * cells)).tolist()),
        compression_slope=float(slope[-1]),
        rebound_slope=float(slope[0]),
    )


def _least(secants: Array) -> Array:
    """Return the smaller slope (K,) of both cells at each knot: three times that keeps the spline rising."""
    before, after = np.concatenate([secants[:1], secants]), np.concatenate([secants, secants[-1:]])
    return np.asarray(np.minimum(before, after), dtype=np.float64)
