"""RMS measures of setups, of truths and of identified vehicles, and how well two tables of them agree."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from scipy.stats import kendalltau, spearmanr

from eightpost.rig.post.modes import displacement_modes, ride_heights

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from eightpost.rig.post import Car, Motion

    Array = NDArray[np.float64]

#: Left out at the start of a lap [s].
SETTLING = 3.0
#: What is measured, as channels of a rig test; and the sum of the tire forces on four wheels.
QUANTITIES = ("velocity", "tire_force", "hub_acceleration", "ride_height")
TOTAL = "total_tire_force"


class Agreement(NamedTuple):
    """How well predicted measures agree with true ones, over all measures and setups."""

    all_percent: float
    max_percent: float
    spearman_min: float
    kendall_min: float


def measures_of(names: tuple[str, ...], values: Array, rate: float) -> dict[str, float]:
    """Return the RMS about the mean of each measured channel (p, N), and of the sum of the tire forces."""
    settled = values[:, round(SETTLING * rate) :]
    found = {n: float(row.std()) for n, row in zip(names, settled, strict=True) if n.endswith(QUANTITIES)}
    tires = [i for i, name in enumerate(names) if name.endswith("tire_force")]
    if len(tires) > 1:
        found[TOTAL] = float(settled[tires].sum(axis=0).std())
    return found


def truth_of(car: Car, motion: Motion) -> tuple[tuple[str, ...], Array]:
    """Return the measured channels of a truth (p, N) by name."""
    q, corners = motion.position, len(car.corners)
    rows = [car.shock @ motion.velocity, motion.tire_force, car.wheel @ motion.acceleration]
    names = [name for quantity in QUANTITIES[:3] for name in car.named(quantity)]
    roads = motion.drive[:corners]
    if car.geometry is None:
        return (*names, "ride_height"), np.vstack([*rows, (car.chassis @ q)[:1] - roads])
    heave, pitch = _chassis(car, q)
    return (*names, "front.ride_height", "rear.ride_height"), np.vstack(
        [*rows, *ride_heights(heave, pitch, roads, car.geometry)]
    )


def _chassis(car: Car, q: Array) -> tuple[Array, Array]:
    """Return heave and pitch as the rig has them: by the aeroloaders' positions where there are such."""
    if car.geometry is not None and car.loads == car.named("aero"):
        modes = displacement_modes(car.geometry) @ (-car.load @ q)
        return modes[0], modes[1]
    return car.points["heave"] @ q, car.points["pitch"] @ q


def agreement(truth: Iterable[Mapping[str, float]], predicted: Iterable[Mapping[str, float]]) -> Agreement:
    """Compare measures, setup by setup."""
    true, found = list(truth), list(predicted)
    names = tuple(true[0])
    T, P = (np.array([[row[name] for name in names] for row in rows]) for rows in (true, found))
    errors = 100.0 * (P / T - 1.0)
    ranks = [(spearmanr(t, p).statistic, kendalltau(t, p).statistic) for t, p in zip(T.T, P.T, strict=True)]
    spearman, kendall = (float(min(column)) for column in zip(*ranks, strict=True))
    return Agreement(float(np.sqrt(np.mean(errors**2))), float(np.abs(errors).max()), spearman, kendall)
