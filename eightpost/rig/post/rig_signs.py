"""Signs and corners of rig records, judged by what holds for every car, drive and setup.

A damper takes energy out, so its force goes with its velocity. A shock's velocity is the slope of its travel. A tire is
a spring between the wheelloader and the hub, whatever the car above it does:

    hub_acceleration = road'' - tire_force'' / stiffness

What a steady sine moves alike, up to a phase, cannot tell corners apart, and nothing is said of it then.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from scipy.signal import hilbert

from eightpost.errors import DataError, WrongSignError
from eightpost.signals.filters import derivative, lowpass

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    from eightpost.signals.origin import Origin
    from eightpost.signals.timeseries import TimeSeries

    Array = NDArray[np.float64]

#: Another corner must be likelier than a channel's own by this much before corners are called swapped [1].
SWAPPED_BY = 0.15

#: Correlation below which a sign is called wrong [1]: weaker ones say nothing.
REVERSED = -0.2

#: What explains a hub's motion better must explain this much more of its variance [1] ...
EXPLAINS_MORE = 0.15
#: ... and leave no more than this part of what is left otherwise [1]: lifting tires leave some in good records too,
#: and noise never explains as much.
LEAVES = 0.5

#: A tire whose force is at an end of its range, within this part of it [1] ...
AT_ITS_END = 0.01
#: ... for more than this part of the record (a sine is for 0.06) is in the air then, and no spring [1].
LIFTS = 0.15

#: A corner that moves less than this part of the one that moves most, or of what it moves beyond the band too, says
#: nothing [1].
RESTING = 0.2

#: Correlations count from this many standard deviations of what noise of the band and the record's length gives,
#: 1 / sqrt(samples), and their differences from as many of (1 - correlation^2) / sqrt(samples).
CERTAIN = 5.0

#: Band limit for the comparisons [Hz], at most 0.4 of the sample rate.
_BAND = 12.0

#: Records of 800 s are compared at no more than about this rate [Hz]: filters at the rig's would cost seconds each.
_RATE = 250.0


class SwappedCornersError(DataError):
    """A channel belongs to another corner."""


def check_corners_and_signs(series: TimeSeries, corners: tuple[str, ...], *, origin: Origin) -> None:
    """Compare what must go together, at its own corner and at the others'.

    Args:
        series: With `force` and `velocity` of every corner; `displacement`, `road`, `tire_force` and
            `hub_acceleration` are looked at where all corners have them.
        corners: Names of the corners; one empty name for a quarter car.
        origin: Where the record came from.

    Raises:
        SwappedCornersError: A channel belongs to another corner.
        WrongSignError: A channel is positive the other way.
    """
    record = _Record(series, corners, origin)
    _check_pairs(record, "force", "velocity", record.low("force"), record.low("velocity"))
    if record.has("displacement"):
        slopes = derivative(record.low("displacement"), record.rate)
        _check_pairs(record, "velocity", "displacement", record.low("velocity"), slopes)
    if record.has("hub_acceleration", "tire_force", "road"):
        _check_tires(record)


class _Record:
    """A rig record below the band limit, corner by corner."""

    def __init__(self, series: TimeSeries, corners: tuple[str, ...], origin: Origin) -> None:
        self._series, self.corners, self.origin = series, corners, origin
        self._every = max(1, int(series.sample_rate // _RATE))
        self.rate = series.sample_rate / self._every
        self._cutoff = min(_BAND, 0.4 * self.rate)
        self._lows: dict[str, Array] = {}
        self.chance = float(CERTAIN / np.sqrt(2.0 * self._cutoff * series.duration))

    def name(self, corner: int, quantity: str) -> str:
        """Return the channel of a quantity at a corner."""
        return f"{self.corners[corner]}.{quantity}" if self.corners[corner] else quantity

    def has(self, *quantities: str) -> bool:
        """Say whether all corners have all these quantities."""
        places = range(len(self.corners))
        return all(self.name(place, quantity) in self._series for quantity in quantities for place in places)

    def raw(self, corner: int, quantity: str) -> Array:
        """Return a quantity of one corner, means over blocks of samples (N,)."""
        values = self._series[self.name(corner, quantity)]
        size = values.size // self._every
        return np.asarray(values[: size * self._every].reshape(size, self._every).mean(axis=1))

    def low(self, quantity: str) -> Array:
        """Return a quantity of all corners (C, N), low-passed and without its mean."""
        if quantity not in self._lows:
            rows = np.stack([self.raw(place, quantity) for place in range(len(self.corners))])
            self._lows[quantity] = lowpass(rows - rows.mean(axis=1, keepdims=True), self.rate, self._cutoff)
        return self._lows[quantity]

    def curvature(self, quantity: str) -> Array:
        """Return the second derivative of a quantity of all corners (C, N)."""
        return derivative(derivative(self.low(quantity), self.rate), self.rate)

    def moving(self, quantity: str) -> list[int]:
        """Return the corners that move: with one actuator at a time others rest, and what rests tells nothing."""
        raw = [float(self.raw(place, quantity).std()) for place in range(len(self.corners))]
        low = self.low(quantity).std(axis=1)
        return [k for k, size in enumerate(low.tolist()) if size >= RESTING * max(float(low.max()), raw[k])]

    def say_swapped(self, channel: str, others: str, how: str) -> None:
        """Raise SwappedCornersError."""
        what = (
            f"it goes with {others} {how}: the corners are swapped, of this channel or of that one; look which of the "
            "two goes with its neighbours, and exchange the columns in the channel map"
        )
        raise self.origin.header_fault(SwappedCornersError, what, channel=channel)

    def say_reversed(self, channel: str, why: str) -> None:
        """Raise WrongSignError."""
        what = (
            f"{why}, so one is positive the other way (docs/ports.md); set gain = -1 in the channel map for the one "
            f"that is wrong, or pass --flip {channel}"
        )
        raise self.origin.header_fault(WrongSignError, what, channel=channel)


def _check_pairs(record: _Record, quantity: str, against: str, values: Array, references: Array) -> None:
    """Raise unless every corner's values (C, N) go with their own reference (C, N) and with none better."""
    likeness = _complex_correlations(values, references)
    for place in sorted({*record.moving(quantity)} & {*record.moving(against)}):
        own, best = likeness[place, place], int(np.argmax(np.abs(likeness[place])))
        other = likeness[place, best]
        if abs(other) > abs(own) + max(SWAPPED_BY, record.chance * (1.0 - abs(other) ** 2)):
            how = f"(correlation {abs(other):.2f}) rather than with {record.name(place, against)} ({abs(own):.2f})"
            record.say_swapped(record.name(place, quantity), record.name(best, against), how)
        if own.real < min(REVERSED, -record.chance):
            why = f"it correlates with {record.name(place, against)} at {own.real:.2f}"
            record.say_reversed(record.name(place, quantity), why)


def _check_tires(record: _Record) -> None:
    """Raise unless every hub whose tire stays down moves as its own wheelloader and its own tire's spring say."""
    hub, road, force = record.low("hub_acceleration"), record.curvature("road"), record.curvature("tire_force")
    tires = _Tires(_correlations(hub, road), _correlations(hub, force), _correlations(road, force))
    for place in record.moving("hub_acceleration"):
        if _lifts(record.raw(place, "tire_force")):
            continue
        own = tires.explained(place, place, place)
        best = max((*tires.turned(place), *tires.exchanged(place)), key=lambda rival: rival.explained)
        if best.explained - own > EXPLAINS_MORE and 1.0 - best.explained < LEAVES * (1.0 - own):
            _say_rival(record, place, own, best)


def _lifts(force: Array) -> bool:
    """Say whether a tire is off the ground for much of the time; the ground is at either end of a force (N,)."""
    near = AT_ITS_END * np.ptp(force)
    shares = np.mean(force < force.min() + near), np.mean(force > force.max() - near)
    return bool(max(shares) > LIFTS)


def _say_rival(record: _Record, place: int, own: float, rival: _Rival) -> None:
    name = record.name(place, rival.quantity)
    shares = f"{100.0 * own:.0f} % of the hub's acceleration as the channels are and {100.0 * rival.explained:.0f} %"
    if rival.corner != place:
        others = " and ".join(record.name(rival.corner, other) for other in _partners(rival.quantity))
        record.say_swapped(name, others, f"(road and tire force explain {shares} so)")
    others = " and ".join(record.name(place, other) for other in _partners(rival.quantity))
    record.say_reversed(name, f"it goes against {others} (road and tire force explain {shares} with it turned)")


_HUB, _ROAD, _FORCE = _QUANTITIES = ("hub_acceleration", "road", "tire_force")


def _partners(quantity: str) -> tuple[str, ...]:
    return tuple(other for other in _QUANTITIES if other != quantity)


class _Rival(NamedTuple):
    """Another reading of a hub's channels: one of them turned, or taken from another corner."""

    explained: float
    quantity: str
    corner: int


class _Tires(NamedTuple):
    """Correlations (C, C) of hub accelerations with roads'' and tire forces'', and of these with each other."""

    hub_road: Array
    hub_force: Array
    road_force: Array

    def explained(self, hub: int, road: int, force: int, signs: tuple[int, int] = (1, -1)) -> float:
        """Return the share of a hub's variance that road'' and tire_force'' explain with factors of these signs."""
        plus, minus = signs
        parts = plus * self.hub_road[hub, road], minus * self.hub_force[hub, force]
        return _cone(float(parts[0]), float(parts[1]), float(plus * minus * self.road_force[road, force]))

    def turned(self, place: int) -> Iterator[_Rival]:
        """Yield what is explained with one channel the other way round."""
        for quantity, signs in ((_HUB, (-1, 1)), (_ROAD, (-1, -1)), (_FORCE, (1, 1))):
            yield _Rival(self.explained(place, place, place, signs), quantity, place)

    def exchanged(self, place: int) -> Iterator[_Rival]:
        """Yield what is explained with one channel of another corner."""
        for other in range(len(self.hub_road)):
            if other != place:
                yield _Rival(self.explained(place, other, other), _HUB, other)
                yield _Rival(self.explained(place, other, place), _ROAD, other)
                yield _Rival(self.explained(place, place, other), _FORCE, other)


def _cone(first: float, second: float, between: float) -> float:
    """Return the share that the best non-negative sum of two regressors explains.

    Args:
        first: Correlation of the explained with the first regressor.
        second: With the second.
        between: Of the two regressors.
    """
    free = 1.0 - between**2
    if free > 1e-9:
        factors = (first - between * second) / free, (second - between * first) / free
        if min(factors) >= 0.0:
            return factors[0] * first + factors[1] * second
    return max(first, second, 0.0) ** 2


def _correlations(values: Array, references: Array) -> Array:
    """Return the correlations (C, D) of rows (C, N) with rows (D, N), 0 where one does not move."""
    return np.asarray(_unit(values) @ _unit(references).T)


def _complex_correlations(values: Array, references: Array) -> NDArray[np.complex128]:
    """Return correlations (C, D) whose real part is the usual one and whose magnitude is that at the best phase."""
    return np.asarray(_unit(values) @ np.stack([hilbert(row) for row in _unit(references)]).T)


def _unit(rows: Array) -> Array:
    sizes = np.linalg.norm(rows, axis=1, keepdims=True)
    return np.asarray(np.divide(rows, sizes, out=np.zeros_like(rows), where=sizes > 0.0))
