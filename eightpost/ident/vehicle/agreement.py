"""Agreement of rig tests: whether the car changed from test to test, or within a test.

The balance of a wheel tells the parts of its suspension apart:

    T = m a + m_o a_o + r F + r_o F_o + k2 x^2 + f_o s(v_o)  +  k x + k_o x_o + f s(v) + c,    s(v) = tanh(v / v_f)

with the tire force T, hub accelerations a, shock forces F, displacements x and velocities v of the wheel and of the
opposite one (o). The first terms are those of all tests. The springs k and k_o (an anti-roll bar), the friction f and
the constant c are estimated for each half of each test; their covariance comes from the scatter of the balance over
blocks of a few seconds, which are independent. No model of the car is needed, so every recipe has this check.

Another shock at a wheel has another damping, part of which looks like friction or stiffness if rubber yields in series
with it. So a wheel is compared between the tests that have the same shock there.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from eightpost.array_types import Array
from eightpost.corners import CORNERS, channel
from eightpost.ident.vehicle.free_running import port_slope
from eightpost.signals import TimeSeries

#: Velocity v_f of the friction [m/s], duration of a block [s], and smallest number of blocks in half a test.
_SLIDES, _BLOCK, _FEWEST = 0.006, 3.0, 16

#: Standard deviations above which a change is not noise [1]. It is high, as few blocks give the standard deviations.
SIGNIFICANT = 5.0

#: Relative difference of the damping above which a shock is another one [1].
_OTHER_SHOCK = 0.1

#: Friction is compared relative to at least this part of the RMS of the shock force [1].
_LEAST_FRICTION = 0.05

#: Number of terms of all tests, and of those of half a test: k, k_o, f, c.
_SHARED, _OWN = 6, 4

#: Channels of every wheel that a balance needs.
_NEEDED = ("tire_force", "hub_acceleration", "force", "displacement", "velocity")


class Limit(NamedTuple):
    """Relative changes [1] that matter."""

    tests: float  #: Between tests.
    halves: float  #: Between the halves of a test.
    unusable: float  #: Change from which the vehicle is not usable.


#: Limits by quantity. The change of an anti-roll bar is relative to the rate of the wheel.
LIMITS: Mapping[str, Limit] = {
    "friction": Limit(0.25, 0.10, 0.25),
    "spring rate": Limit(0.04, 0.04, 0.15),
    "anti-roll bar": Limit(0.03, 0.03, 0.15),
    "weight": Limit(0.01, 0.01, 0.10),
}


class Change(NamedTuple):
    """A change of a quantity of the car."""

    quantity: str  #: Key of `LIMITS`.
    where: str  #: Wheel or axle with the largest change.
    tests: tuple[int, ...]  #: Indices of the tests that differ from most tests, or in which the quantity changed.
    size: float  #: Largest relative change [1].
    within: bool  #: Whether the quantity changed within tests.

    @property
    def is_unusable(self) -> bool:
        """Whether the change is so large that the vehicle is not usable."""
        return abs(self.size) >= LIMITS[self.quantity].unusable


class Agreement(NamedTuple):
    """Comparison of tests."""

    changes: tuple[Change, ...]  #: Changes that are not noise and that matter.
    #: Friction relative to the RMS of the shock force [1] by wheel, median of the tests; empty if it is not known.
    rubbing: Mapping[str, float]


class _Relative(NamedTuple):
    """Relative values (tests, 2) of a quantity in the halves of the tests, and their standard deviations.

    `alike` tells which tests (tests,) can be compared with each other.
    """

    quantity: str
    where: str
    values: Array
    deviations: Array
    alike: NDArray[np.bool_]


def compare_tests(records: Sequence[TimeSeries], means: Sequence[Mapping[str, float]]) -> Agreement:
    """Compare the tests of a car with each other, and the halves of each test.

    Args:
        records: Records of the tests, without means.
        means: Means of each record, by channel.
    """
    found, rubbing = list(_weights(records, means)), {}
    if all(channel(corner, name) in record for record in records for corner in CORNERS for name in _NEEDED):
        for place, corner in enumerate(CORNERS):
            wheel = _relative(records, corner, CORNERS[place ^ 1])
            rubbing[corner] = wheel.rubbing
            found.extend(wheel.values)
    changes = []
    for name in LIMITS:
        rows = [row for row in found if row.quantity == name]
        changes += [change for change in (_between(rows), _within(rows)) if change is not None] if rows else []
    return Agreement(tuple(changes), rubbing)


def _between(rows: Sequence[_Relative]) -> Change | None:
    """Return the change of a quantity, known at several places, from the test that most tests agree with."""
    means = np.stack([np.where(row.alike, row.values.mean(axis=1), np.nan) for row in rows])
    deviations = np.stack([0.5 * np.hypot(*row.deviations.T) for row in rows])
    size = np.nan_to_num(means[:, :, None] - means[:, None, :])
    noise = np.hypot(deviations[:, :, None], deviations[:, None, :])
    size = np.where(_matters(size, noise, LIMITS[rows[0].quantity].tests), size, 0.0)
    usual = int(np.argmin(size.any(axis=0).sum(axis=0)))
    return _change(rows, size[:, :, usual], within=False)


def _within(rows: Sequence[_Relative]) -> Change | None:
    """Return the change of a quantity, known at several places, from the first to the second half of tests."""
    size = np.stack([row.values[:, 1] - row.values[:, 0] for row in rows])
    noise = np.stack([np.hypot(*row.deviations.T) for row in rows])
    size = np.where(_matters(size, noise, LIMITS[rows[0].quantity].halves), size, 0.0)
    return _change(rows, size, within=True)


def _matters(size: Array, noise: Array, least: float) -> NDArray[np.bool_]:
    return np.asarray((np.abs(size) > least) & (np.abs(size) > SIGNIFICANT * noise), dtype=np.bool_)


def _change(rows: Sequence[_Relative], size: Array, *, within: bool) -> Change | None:
    """Return the largest change that matters, from changes at places in tests (places, tests); None if all are 0."""
    place, test = divmod(int(np.argmax(np.abs(size))), size.shape[1])
    if size[place, test] == 0.0:
        return None
    tests = tuple(np.flatnonzero(size.any(axis=0)).tolist())
    return Change(rows[0].quantity, rows[place].where, tests, float(size[place, test]), within)


# ---- Weight on the axles --------------------------------------------------------------------------------------------


def _weights(records: Sequence[TimeSeries], means: Sequence[Mapping[str, float]]) -> Iterator[_Relative]:
    """Yield the weight on each axle: the mean tire forces without the mean loads.

    Tire forces whose means are below their standard deviations are changes from rest and cannot show it.
    """
    for axle, corners in (("front", CORNERS[:2]), ("rear", CORNERS[2:])):
        tires = [channel(corner, "tire_force") for corner in corners]
        known = [(record[name].std() if name in record else np.inf, mean.get(name, 0.0))
                 for record, mean in zip(records, means, strict=True) for name in tires]  # fmt: skip
        if any(mean <= deviation for deviation, mean in known):
            continue
        loads = [channel(corner, "aero") for corner in corners]
        held = np.array([sum(mean[n] for n in tires) - sum(mean.get(n, 0.0) for n in loads) for mean in means])
        halves = np.tile((held / np.median(held))[:, None], 2)
        yield _Relative("weight", axle, halves, np.zeros_like(halves), np.ones(len(means), dtype=np.bool_))


# ---- Balance of a wheel ---------------------------------------------------------------------------------------------


class _Wheel(NamedTuple):
    values: tuple[_Relative, ...]
    rubbing: float


def _relative(records: Sequence[TimeSeries], corner: str, other: str) -> _Wheel:
    """Return the relative springs, anti-roll bar and friction of a wheel in the halves of the tests."""
    grams = [half for record in records for half in _halves(_terms(record, corner, other), record.sample_rate)]
    theta, covariance = _solved(grams)
    rate, opposite, friction, _ = np.median(theta, axis=0).tolist()
    force = float(np.mean([record[channel(corner, "force")].std() for record in records]))
    slopes = np.array([port_slope(record, corner) for record in records])
    alike = np.abs(slopes / np.median(slopes) - 1.0) < _OTHER_SHOCK
    scaled = (
        ("spring rate", corner, (1.0, 1.0, 0.0, 0.0), rate + opposite),
        ("anti-roll bar", "front" if corner in CORNERS[:2] else "rear", (0.0, -1.0, 0.0, 0.0), rate),
        ("friction", corner, (0.0, 0.0, 1.0, 0.0), math.copysign(max(abs(friction), _LEAST_FRICTION * force), rate)),
    )
    rows = []
    for quantity, where, weights, size in scaled:
        w = np.array(weights) / size
        deviations = np.sqrt(np.einsum("kij,i,j->k", covariance, w, w))
        rows.append(_Relative(quantity, where, (theta @ w).reshape(-1, 2), deviations.reshape(-1, 2), alike))
    return _Wheel(tuple(rows), abs(friction) / force)


def _terms(record: TimeSeries, corner: str, other: str) -> Array:
    """Return the terms of the balance (shared, own, tire force) as rows."""
    a, force, x, v = ([record[channel(place, name)] for place in (corner, other)] for name in _NEEDED[1:])
    shared = (*a, *force, x[0] ** 2, np.tanh(v[1] / _SLIDES))
    return np.stack([*shared, *x, np.tanh(v[0] / _SLIDES), np.ones(len(record)), record[channel(corner, "tire_force")]])


def _halves(terms: Array, rate: float) -> Iterator[Array]:
    """Yield the products of the terms in the blocks (B, n, n) of each half of a record."""
    for half in np.array_split(terms, 2, axis=1):
        blocks = max(_FEWEST, round(half.shape[1] / rate / _BLOCK))
        yield np.stack([block @ block.T for block in np.array_split(half, blocks, axis=1)])


def _solved(grams: Sequence[Array]) -> tuple[Array, Array]:
    """Return the own terms (H, 4) of H halves and their covariances (H, 4, 4), from products of the terms in blocks.

    The covariance is that of least squares with errors that are independent from block to block only (sandwich).
    """
    scale = np.sqrt(np.diag(sum(gram.sum(axis=0) for gram in grams)))
    count = _SHARED + _OWN * len(grams)
    normal, right = np.zeros((count, count)), np.zeros(count)
    parts = []
    for k, gram in enumerate(grams):
        at = np.r_[:_SHARED, _SHARED + _OWN * k : _SHARED + _OWN * (k + 1)]
        parts.append((at, gram / np.outer(scale, scale)))
        whole = parts[-1][1].sum(axis=0)
        normal[np.ix_(at, at)] += whole[:-1, :-1]
        right[at] += whole[:-1, -1]
    inverse = np.linalg.pinv(normal, hermitian=True)
    theta, scores = inverse @ right, []
    for at, blocks in parts:
        rows = np.zeros((len(blocks), count))
        rows[:, at] = blocks[:, :-1, -1] - blocks[:, :-1, :-1] @ theta[at]
        scores.append(rows * math.sqrt(len(blocks) / (len(blocks) - _OWN)))
    moved = np.concatenate(scores) @ inverse
    units = np.tile(scale[-1] / scale[_SHARED:-1], len(grams))
    own = (theta[_SHARED:] * units).reshape(-1, _OWN)
    moved = (moved[:, _SHARED:] * units).reshape(len(moved), -1, _OWN)
    return own, np.einsum("bki,bkj->kij", moved, moved)
