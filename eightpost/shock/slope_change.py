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
        ParameterError: The side or the speeds are none of these, or no slope would be left.
    """
    if side not in SIDES or speeds not in ("low", "high", "all"):
        raise ParameterError(f"a change is of compression or rebound, at low, high or all speeds, not {side}, {speeds}")
    if not share > -1.0:
        raise ParameterError(f"a slope cannot change by {share:g}: nothing would be left; use a change above -1")
    velocity = joined(-curve.rebound_speed * SHARES, curve.compression_speed * SHARES)
    same = _through(curve, velocity, np.ones(KNOTS))
    near = 1.0 / (1.0 + (np.array(velocity) / LOW_SPEED) ** 2) ** 2
    weight = {"low": near, "high": 1.0 - near, "all": np.ones(KNOTS)}[speeds]
    own = np.array(velocity) > 0.0 if side == "compression" else np.array(velocity) < 0.0
    return same, _through(curve, velocity, np.where(own, 1.0 + share * weight, 1.0))


def _through(curve: StaticCurve, velocity: tuple[float, ...], factors: Array) -> StaticCurve:
    """Return the curve through knots with the mean slopes of a curve between them, times a factor at each knot (K,)."""
    places = np.array(velocity)
    force = np.array([curve.force(v) for v in velocity])
    slopes = np.maximum(np.diff(force) / np.diff(places), 0.0)
    widths = np.diff(places)
    inner = (slopes[:-1] * widths[1:] + slopes[1:] * widths[:-1]) / (widths[1:] + widths[:-1])
    slope = np.concatenate([[curve.rebound_slope], inner, [curve.compression_slope]])
    rises = slopes * widths * 0.5 * (factors[1:] + factors[:-1])
    total = np.concatenate([[0.0], np.cumsum(rises)])
    changed = np.minimum(slope * factors, 3.0 * _least(rises / widths))
    return StaticCurve.through_knots(
        velocity, tuple((total - total[KNOTS // 2]).tolist()), tuple(changed.tolist()),
        compression_slope=float(curve.compression_slope * factors[-1]),
        rebound_slope=float(curve.rebound_slope * factors[0]),
    )  # fmt: skip


def _least(secants: Array) -> Array:
    """Return the smaller slope (K,) of both cells at each knot: three times that keeps the spline rising."""
    before, after = np.concatenate([secants[:1], secants]), np.concatenate([secants, secants[-1:]])
    return np.asarray(np.minimum(before, after), dtype=np.float64)
