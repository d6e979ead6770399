"""RMS measures of setups for true cars and identified vehicles, and the agreement of two tables of measures."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from scipy.stats import kendalltau, spearmanr

from eightpost.rig.post.car import displacement_modes, ride_heights

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from eightpost.rig.post import Motion, RigCar

    Array = NDArray[np.float64]

#: Time at the start of a lap that is not evaluated [s].
SETTLING = 3.0
#: Measured quantities, as channels of a rig test; the sum of the tire forces of four wheels is added.
QUANTITIES = ("velocity", "tire_force", "hub_acceleration", "ride_height")
TOTAL = "total_tire_force"


class Agreement(NamedTuple):
    """Agreement of predicted with true measures, over all measures and setups."""

    all_percent: float
    max_percent: float
    spearman_min: float
    kendall_min: float


def measures_of(names: tuple[str, ...], values: Array, rate: float, *, settling: float = SETTLING) -> dict[str, float]:
    """Return the RMS about the mean of each measured channel (p, N), and of the sum of the tire forces."""
    settled = values[:, round(settling * rate) :]
    found = {n: float(row.std()) for n, row in zip(names, settled, strict=True) if n.endswith(QUANTITIES)}
    tires = [i for i, name in enumerate(names) if name.endswith("tire_force")]
    if len(tires) > 1:
        found[TOTAL] = float(settled[tires].sum(axis=0).std())
    return found


def truth_of(car: RigCar, motion: Motion) -> tuple[tuple[str, ...], Array]:
    """Return the names and values (p, N) of the measured channels of a true car."""
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


def _chassis(car: RigCar, q: Array) -> tuple[Array, Array]:
    """Return heave and pitch as the rig measures them: at the aeroloaders' positions if there are aeroloaders."""
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
