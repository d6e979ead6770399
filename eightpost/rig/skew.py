"""Whether the force of a dynamometer record is earlier than a shock can cause: channels that are not simultaneous.

At equal velocity, compressibility, friction and gas make the force of a rising velocity the smaller one: the loop of a
shock lags. Only moved mass does the opposite. In classes of velocity, each with a parabola for the curve,

    F = c0 + c1 v + c2 v^2 + m a

an own lag T of the shock gives m = -T dF/dv, a gas stiffness k at a frequency w gives m = -k / w^2, and a force that is
recorded too early by T gives m = +T dF/dv. An m above the mass of piston, rod and fixture in both strokes is therefore
a skew of the channels and not a property of the shock. A force that is recorded too late looks like the shock's own
lag.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from eightpost.array_types import Array
from eightpost.rig.plausibility_rules import SKEW
from eightpost.signals.filters import lowpass
from eightpost.signals.timeseries import TimeSeries
from eightpost.verdict import Reason

#: Largest mass [kg] of piston, rod and fixture between load cell and valves.
MOST_MASS = 2.5
#: Smallest lead [s] that is reported, and the same as a share of the sampling interval: a velocity that is a difference
#: of positions is half an interval late.
LEAST_LEAD, LEAST_SHARE = 3e-4, 0.6
#: Number of standard errors by which a value must exceed these limits.
ERRORS = 4.0
#: Speeds of the classes as shares of the peak, number of the blocks that give the standard errors, and minimum number
#: of samples of a class and of a block.
EDGES, BLOCKS, FEWEST, FEWEST_IN_BLOCK = np.linspace(0.1, 1.0, 7), 8, 60, 6
#: Seconds at either end that are left out, because the low-pass rings there.
END = 0.2


class Lead(NamedTuple):
    """A force that is early, in the class of velocity that shows it best.

    Attributes:
        mass: Force per acceleration at equal velocity [kg].
        seconds: Lead of the force [s]; with the shock's own lag the skew of the channels is larger.
    """

    mass: float
    seconds: float


def skew_reasons(series: TimeSeries, origin: str) -> Iterator[Reason]:
    """Yield a reason if the force leads the velocity in both strokes by more than moved mass can cause.

    Args:
        series: Record with `velocity` [m/s] and `force` [N].
        origin: Name of the record.
    """
    even = series if series.is_uniform else series.resample(series.sample_rate)
    leads = [lead_of(even, sign) for sign in (1.0, -1.0)]
    if any(lead is None for lead in leads):
        return
    least = min((lead for lead in leads if lead is not None), key=lambda lead: lead.seconds)
    early = f"{1e3 * least.seconds:.2g} ms"
    figure = (
        f"at equal velocity, the force of a rising velocity is the larger one in both strokes: it leads by {early} or "
        f"more, like a mass of {least.mass:.3g} kg"
    )
    remedy = (
        f"delay the force by at least {early} (more by the shock's own lag), or find which channel has a filter or is "
        "sampled later, and export again"
    )
    yield SKEW.reason("force and motion are not simultaneous", figure=figure, origin=origin, remedy=remedy)


def lead_of(series: TimeSeries, sign: float) -> Lead | None:
    """Return the clearest lead of the force in one stroke; None if no class of velocity shows one.

    Args:
        series: Uniform record with `velocity` [m/s] and `force` [N].
        sign: 1 for compression, -1 for rebound.
    """
    rate = series.sample_rate
    cutoff, end = min(50.0, 0.3 * rate), round(END * rate)
    velocity, force = (lowpass(series[name], rate, cutoff)[end:-end] for name in ("velocity", "force"))
    if velocity.size < BLOCKS * FEWEST_IN_BLOCK:
        return None
    acceleration = np.gradient(velocity, 1.0 / rate)
    speed = sign * velocity / float(np.quantile(np.abs(velocity), 0.995))
    block = np.arange(velocity.size) * BLOCKS // velocity.size
    leads = []
    for low, high in pairwise(EDGES.tolist()):
        chosen = (speed > low) & (speed <= high)
        if np.count_nonzero(chosen) >= FEWEST:
            rows = velocity[chosen], acceleration[chosen], force[chosen], block[chosen]
            leads.append(_lead(*rows, least=max(LEAST_LEAD, LEAST_SHARE / rate)))
    return max((lead for lead in leads if lead is not None), key=lambda lead: lead.mass, default=None)


def _lead(velocity: Array, acceleration: Array, force: Array, block: Array, *, least: float) -> Lead | None:
    """Return the lead in a class of velocity, less its uncertainty, if it is larger than what is allowed."""
    about = velocity - velocity.mean()
    columns = np.column_stack([np.ones_like(about), about, about**2, acceleration])
    parts = [block == number for number in range(BLOCKS)]
    parts = [part for part in parts if np.count_nonzero(part) >= FEWEST_IN_BLOCK]
    if len(parts) < BLOCKS // 2:
        return None
    products = np.stack([columns[part].T @ columns[part] for part in parts])
    sums = np.stack([columns[part].T @ force[part] for part in parts])
    whole = _solved(products.sum(axis=0), sums.sum(axis=0))
    without = np.stack([
        _solved(products.sum(axis=0) - product, sums.sum(axis=0) - one)
        for product, one in zip(products, sums, strict=True)
    ])  # fmt: skip
    count = len(parts)
    mass_error = np.sqrt((count - 1) / count * np.sum((without[:, 3] - without[:, 3].mean()) ** 2))
    mass, slope = float(whole[3] - ERRORS * mass_error), float(whole[1])
    if mass <= MOST_MASS or slope <= 0.0 or mass <= least * slope:
        return None
    return Lead(mass, mass / slope)


def _solved(product: Array, total: Array) -> Array:
    return np.asarray(np.linalg.lstsq(product, total, rcond=None)[0])
