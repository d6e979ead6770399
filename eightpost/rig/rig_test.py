"""Rig tests: a car's records on the shaker rig, their units, and faults of signs, delays and lost channels."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass, field, fields
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from pydantic import with_config

from eightpost.array_types import Array
from eightpost.corners import CORNERS, channel
from eightpost.display import Summary
from eightpost.errors import (
    ClippedChannelError,
    DataError,
    FileFormatError,
    MissingChannelError,
    TooShortError,
    UnknownUnitError,
    WrongSignError,
)
from eightpost.files import parse_json, sha256_of
from eightpost.rig.motion import cause_of, slope_ratio
from eightpost.rig.plausibility import LOWEST_SAMPLING
from eightpost.schema import OPEN, checked
from eightpost.signals import faults
from eightpost.signals.csv_file import write_csv
from eightpost.signals.faults import IN_MEMORY, Origin
from eightpost.signals.filters import derivative, lowpass, velocity_from_displacement
from eightpost.signals.formats import read_record
from eightpost.signals.parquet_file import parquet_header, write_parquet
from eightpost.signals.raw_record import ChannelMap, MappedChannel, find_time, map_beside, mapped_series
from eightpost.signals.timeseries import Recording, TimeSeries

if TYPE_CHECKING:
    from eightpost.signals.raw_record import RawRecord


# ---- Checks of signs and corners in rig records, with relations that hold for every car, drive and setup ------------

#: Quantities whose sign and corner show in comparison with each other: of the damper, the shock and the tire.
RELATED = (("force", "velocity"), ("velocity", "displacement"), ("hub_acceleration", "tire_force", "road"))
#: Minimum difference of correlations [1] by which another corner must fit better for corners to be swapped.
SWAPPED_BY = 0.15
REVERSED = -0.2  #: Correlation below which a sign is wrong [1]; weaker negative correlations are not significant.
#: A better explanation of a hub's motion must explain this additional share of its variance [1] ...
EXPLAINS_MORE = 0.15
#: ... and leave at most this share of the unexplained variance [1]: tires that lift off leave some in good records too,
#: and noise never explains as much.
LEAVES = 0.5
AT_ITS_END = 0.01  #: A tire whose force is within this share of its range [1] from the minimum or maximum ...
LIFTS = 0.15  #: ... for more than this share of the record [1] (0.06 for a sine) is in the air, and is not a spring.
#: A corner is not checked if its motion in the band is below this share [1] of the largest motion of the corners, or of
#: its own motion at all frequencies.
RESTING = 0.2
#: Number of standard deviations from which correlations and their differences are significant. The standard deviation
#: for noise is 1 / sqrt(samples), and that of a difference is (1 - correlation^2) / sqrt(samples).
CERTAIN = 5.0
MOST = 3  #: Number of quantities that are compared with each other; the earlier ones of a long record are not kept.
_BAND = 12.0  #: Band limit for the comparisons [Hz], at most 0.4 of the sample rate.
#: Approximate sample rate of the comparisons [Hz]; filters at the rig's rate would take seconds each for 800 s.
_RATE = 250.0


class SwappedCornersError(DataError):
    """A channel belongs to another corner."""


def _check_corners_and_signs(series: TimeSeries, corners: tuple[str, ...], *, origin: Origin) -> None:
    """Raise SwappedCornersError or WrongSignError if channels of the corners contradict each other (`RELATED`)."""
    record, (damper, shock, tire) = _Record(series, corners, origin), RELATED
    if record.has(*damper):
        _check_pairs(record, *damper, record.low("force"), record.low("velocity"))
    if record.has(*shock):
        slopes = derivative(record.low("displacement"), record.rate)
        _check_pairs(record, *shock, record.low("velocity"), slopes)
    if record.has(*tire):
        _check_tires(record)


def unchecked(measured: TimeSeries, series: TimeSeries, corners: tuple[str, ...]) -> tuple[str, ...]:
    """Return the measured channels that are in none of the comparisons of signs and corners, as others are missing.

    The velocities in `series` that are derived from displacements check these only by the forces.
    """
    record = _Record(series, corners, IN_MEMORY)
    if not record.has(*RELATED[0]):
        record = _Record(measured, corners, IN_MEMORY)
    checked = {name for related in RELATED if record.has(*related) for name in related}
    others = sorted({name for related in RELATED for name in related} - checked)
    names = (channel(corner, quantity) for corner in corners for quantity in others)
    return tuple(name for name in names if name in measured)


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
        return channel(self.corners[corner], quantity)

    def has(self, *quantities: str) -> bool:
        """Return whether all corners have all these quantities."""
        places = range(len(self.corners))
        return all(self.name(place, quantity) in self._series for quantity in quantities for place in places)

    def raw(self, corner: int, quantity: str) -> Array:
        """Return a quantity of one corner (N,), averaged over blocks of samples."""
        values = self._series[self.name(corner, quantity)]
        size = values.size // self._every
        return np.asarray(values[: size * self._every].reshape(size, self._every).mean(axis=1))

    def low(self, quantity: str) -> Array:
        """Return a quantity of all corners (C, N) after a low-pass and without its mean."""
        if quantity not in self._lows:
            if len(self._lows) == MOST:
                del self._lows[next(iter(self._lows))]
            rows = np.stack([self.raw(place, quantity) for place in range(len(self.corners))])
            self._lows[quantity] = lowpass(rows - rows.mean(axis=1, keepdims=True), self.rate, self._cutoff)
        return self._lows[quantity]

    def curvature(self, quantity: str) -> Array:
        """Return the second derivative of a quantity of all corners (C, N)."""
        return derivative(derivative(self.low(quantity), self.rate), self.rate)

    def moving(self, quantity: str) -> list[int]:
        """Return the corners that move; corners at rest, as in tests with a single actuator, cannot be checked."""
        raw = [float(self.raw(place, quantity).std()) for place in range(len(self.corners))]
        low = self.low(quantity).std(axis=1)
        return [k for k, size in enumerate(low.tolist()) if size >= RESTING * max(float(low.max()), raw[k])]

    def refuse_swapped(self, channel: str, others: str, how: str) -> None:
        """Raise SwappedCornersError."""
        what = (
            f"it matches {others} {how}: the corners are swapped, of this channel or of the other; check which of the "
            "two matches the other channels of its corner, and exchange the columns in the channel map"
        )
        raise self.origin.header_fault(SwappedCornersError, what, channel=channel)

    def refuse_reversed(self, channel: str, why: str) -> None:
        """Raise WrongSignError."""
        what = (
            f"{why}, so one of these channels has the wrong sign (docs/reference/ports.md); set gain = -1 "
            f"in the channel map for the wrong one, or pass --channel {channel}=-"
        )
        raise self.origin.header_fault(WrongSignError, what, channel=channel)


def _check_pairs(record: _Record, quantity: str, against: str, values: Array, references: Array) -> None:
    """Raise an exception unless the values (C, N) of every corner match their own reference (C, N) best."""
    from scipy.signal import hilbert  # noqa: PLC0415 -- takes half a second to load, which no fit needs

    # The real part is the correlation, the magnitude that at the best phase.
    likeness = np.stack([_unit(values) @ hilbert(row) for row in _unit(references)], axis=1)
    for place in sorted({*record.moving(quantity)} & {*record.moving(against)}):
        own, best = likeness[place, place], int(np.argmax(np.abs(likeness[place])))
        other = likeness[place, best]
        if abs(other) > abs(own) + max(SWAPPED_BY, record.chance * (1.0 - abs(other) ** 2)):
            how = f"(correlation {abs(other):.2f}) rather than with {record.name(place, against)} ({abs(own):.2f})"
            record.refuse_swapped(record.name(place, quantity), record.name(best, against), how)
        if own.real < min(REVERSED, -record.chance):
            why = f"its correlation with {record.name(place, against)} is {own.real:.2f}"
            record.refuse_reversed(record.name(place, quantity), why)


def _check_tires(record: _Record) -> None:
    """Raise an exception unless every hub moves according to its own wheelloader and tire; skip tires that lift off."""
    hubs, roads, forces = (
        _unit(rows) for rows in (record.low(_HUB), record.curvature(_ROAD), record.curvature(_FORCE))
    )
    hub_road, hub_force, road_force = hubs @ roads.T, hubs @ forces.T, roads @ forces.T

    def explained(hub: int, road: int, force: int, signs: tuple[int, int] = (1, -1)) -> float:
        """Return the share of a hub's variance that road'' and tire_force'' explain with factors of these signs."""
        plus, minus = signs
        parts = plus * hub_road[hub, road], minus * hub_force[hub, force], plus * minus * road_force[road, force]
        return _explained_share(*map(float, parts))

    for k in record.moving(_HUB):
        if _lifts(record.raw(k, _FORCE)):
            continue
        own = explained(k, k, k)
        rivals = [_Rival(explained(k, k, k, signs), quantity, k)
                  for quantity, signs in ((_HUB, (-1, 1)), (_ROAD, (-1, -1)), (_FORCE, (1, 1)))]  # fmt: skip
        for j in (j for j in range(len(hubs)) if j != k):
            rivals += [_Rival(explained(k, j, j), _HUB, j), _Rival(explained(k, j, k), _ROAD, j),
                       _Rival(explained(k, k, j), _FORCE, j)]  # fmt: skip
        best = max(rivals, key=lambda rival: rival.explained)
        if best.explained - own > EXPLAINS_MORE and 1.0 - best.explained < LEAVES * (1.0 - own):
            _refuse_rival(record, k, own, best)


def _lifts(force: Array) -> bool:
    """Return whether a tire is off the ground for much of the time, for a force (N,) of either sign."""
    near = AT_ITS_END * np.ptp(force)
    shares = np.mean(force < force.min() + near), np.mean(force > force.max() - near)
    return bool(max(shares) > LIFTS)


def _refuse_rival(record: _Record, place: int, own: float, rival: _Rival) -> None:
    """Raise the exception for a rival explanation that is better than that of the channels as given."""
    name = record.name(place, rival.quantity)
    others = " and ".join(record.name(rival.corner, other) for other in _QUANTITIES if other != rival.quantity)
    shares = (
        f"(road and tire force explain {100.0 * own:.0f} % of the hub's acceleration with the channels as given and "
        f"{100.0 * rival.explained:.0f} % with"
    )
    if rival.corner != place:
        record.refuse_swapped(name, others, f"{shares} this exchange)")
    record.refuse_reversed(name, f"it contradicts {others} {shares} the opposite sign)")


_HUB, _ROAD, _FORCE = _QUANTITIES = ("hub_acceleration", "road", "tire_force")


class _Rival(NamedTuple):
    """Alternative explanation of a hub's motion: one channel with the opposite sign, or from another corner."""

    explained: float  #: Explained share of the variance of the hub's acceleration [1].
    quantity: str  #: Quantity of the changed channel.
    corner: int  #: Index of the corner from which the channel is taken.


def _explained_share(first: float, second: float, between: float) -> float:
    """Return the share of variance that the best sum of two regressors with non-negative factors explains.

    `first` and `second` are their correlations with the dependent variable, `between` that of each other.
    """
    free = 1.0 - between**2
    if free > 1e-9:
        factors = (first - between * second) / free, (second - between * first) / free
        if min(factors) >= 0.0:
            return factors[0] * first + factors[1] * second
    return max(first, second, 0.0) ** 2


def _unit(rows: Array) -> Array:
    """Return rows (C, N) with a norm of 1, so that their products are correlations; 0 if a row is constant."""
    sizes = np.linalg.norm(rows, axis=1, keepdims=True)
    return np.asarray(np.divide(rows, sizes, out=np.zeros_like(rows), where=sizes > 0.0))


# ---- Checks of rig records for dead, clipped, slowly sampled, reversed and swapped channels, each -------------------

SHORTEST, FEWEST = 4.0, 1000  #: Minimum duration [s] and minimum number of samples of a record.
HELD = 0.4  #: Share of samples that repeat the previous one, above which a channel was sampled at a lower rate ...
MOVING = 0.9  #: ... if it changes over at least this share of the record.

_RESPONSES = ("tire_force", "displacement", "velocity", "force", "hub_acceleration", "chassis_acceleration")


class MismatchedRateError(DataError):
    """A channel was sampled at a lower rate than the others."""


def check_rig_record(series: TimeSeries, corners: tuple[str, ...], *, origin: Origin = IN_MEMORY) -> None:
    """Check a rig record and raise an exception for the first fault."""
    faults.check_gaps(series.time, origin=origin)
    faults.check_length(series.time, shortest=SHORTEST, fewest=FEWEST, origin=origin)

    def of(*quantities: str) -> list[str]:
        names = (channel(corner, quantity) for corner in corners for quantity in quantities)
        return [name for name in names if name in series]

    driven = [name for name in series.names if f"{name}_command" in series and np.ptp(series[f"{name}_command"]) > 0.0]
    for name in (*of(*_RESPONSES), *driven):
        faults.check_moves(series[name], channel=name, origin=origin)
    for name in of("road", *_RESPONSES):
        _check_not_held(series, name, origin)
    for name in of("tire_force", "force", "aero"):
        _check_not_clipped(series, name, origin)
    _check_corners_and_signs(series, corners, origin=origin)


def _check_not_held(series: TimeSeries, name: str, origin: Origin) -> None:
    """Raise MismatchedRateError if a channel repeats most of its samples, at regular times.

    A slow signal of a coarse sensor also repeats samples, but for irregular times.
    """
    values = series[name]
    changes = np.flatnonzero(values[1:] != values[:-1])
    share = 1.0 - changes.size / (values.size - 1)
    if share <= HELD or changes.size < 2 or changes[-1] - changes[0] < MOVING * values.size:
        return
    hold = float(np.median(np.diff(changes)))
    if hold >= 2.0 and float(np.mean(np.diff(changes) == hold)) > 0.8:
        what = (
            f"it changes only every {hold:.0f} samples, at {series.sample_rate / hold:.4g} Hz in a record of "
            f"{series.sample_rate:.4g} Hz: two loggers with different sample rates; export both at one rate"
        )
        raise origin.header_fault(MismatchedRateError, what, channel=name)


def _check_not_clipped(series: TimeSeries, name: str, origin: Origin) -> None:
    """Raise ClippedChannelError if a load cell is clipped; an unloaded tire with zero force is not."""
    values, velocity = series[name], f"{name.rpartition('.')[0]}.velocity".lstrip(".")
    moving = np.full(values.size, True)
    if velocity in series:  # while the car is at rest, as in static loading, a constant load is normal
        speed = np.abs(series[velocity])
        moving = speed > 1e-3 * speed.max()
    if np.ptp(values) <= 1e-12 * np.abs(values).max():
        return
    for signed, end in ((values, "highest"), (-values, "lowest")):
        found = faults.clipped_samples(signed, moving)
        if found.size and abs(values[found[0]]) > 1e-6 * np.ptp(values):
            what = (
                f"{found.size} of {values.size} samples are equal to the {end} value {values[found[0]]:.6g} N: the "
                "load cell or its amplifier is clipped; record again with a larger range, or with a smaller drive"
            )
            raise origin.fault(ClippedChannelError, what, channel=name, sample=int(found[0]))


# ==== Units that contradict each other: a wrong label of displacement, velocity or time ==============================

SAME = 0.8  #: Minimum correlation of the slope of displacement with velocity, below which their sizes are not compared.


def _check_rig_units(series: TimeSeries, corners: tuple[str, ...], *, origin: Origin) -> None:
    """Check the sample rate, and the slope of each shock's displacement against its measured velocity."""
    if series.sample_rate < LOWEST_SAMPLING:
        what = (
            f"the file has {series.sample_rate:.4g} samples per second, and a rig records {LOWEST_SAMPLING:g} or more: "
            "time is probably in ms but labelled s; correct its unit, or set it in a channel map"
        )
        raise origin.header_fault(UnknownUnitError, what, channel="time")
    for corner in corners:
        names = [channel(corner, name) for name in ("displacement", "velocity")]
        if any(name not in series for name in names):
            continue
        pair = TimeSeries(series.time, series.select(names).values, ("displacement", "velocity"), ("m", "m/s"))
        cause = cause_of(ratio := slope_ratio(pair))
        if cause and np.corrcoef(np.gradient(pair["displacement"]), pair["velocity"])[0, 1] > SAME:
            what = (
                f"its slope is {ratio:.4g} times {names[1]}, the ratio of two units: {cause}; correct the unit in the "
                "header, or set it in a channel map"
            )
            raise origin.header_fault(UnknownUnitError, what, channel=names[0])


# ==== Rig tests ======================================================================================================

_AT_CORNERS = {
    "road": "m", "road_command": "m", "aero": "N", "aero_command": "N", "aero_position": "m", "tire_force": "N",
    "displacement": "m", "velocity": "m/s", "force": "N", "hub_acceleration": "m/s2", "chassis_acceleration": "m/s2",
}  # fmt: skip
_ONCE = {
    **{f"{name}{kind}": "N" for name in ("aero_force", "heave_force", "aero.heave_force") for kind in ("", "_command")},
    **dict.fromkeys(("ride_height", "front.ride_height", "rear.ride_height", "aero.heave"), "m"),
    **dict.fromkeys(("driver.acceleration", "cg.vertical_acceleration", "cg.longitudinal_acceleration",
                     "cg.lateral_acceleration"), "m/s2"),
    **{f"{mode}_moment{kind}": "N.m" for mode in ("roll", "pitch", "aero.pitch", "aero.roll", "aero.warp")
       for kind in ("", "_command")},
    **dict.fromkeys(("aero.pitch", "aero.roll", "aero.warp"), "rad"),
}  # fmt: skip

#: SI unit of every channel that a rig test may have.
CHANNEL_UNITS = {
    **{f"{corner}.{name}": unit for corner in CORNERS for name, unit in _AT_CORNERS.items()},
    **_AT_CORNERS,
    **_ONCE,
}


def rig_map(record: RawRecord, channel_map: ChannelMap | None) -> ChannelMap:
    """Return the channel map of a rig record: the given map, completed by all columns with the name of a channel.

    Without a given map, it is the map `rig_map.toml` in the record's folder, if there is one.
    """
    given = channel_map or map_beside(record) or ChannelMap()
    time = given.time or find_time(record)
    taken = {pick.source for pick in given.channels.values()} | {time.source}
    own = {n: MappedChannel(n) for n in record.names if n in CHANNEL_UNITS and n not in taken}
    return ChannelMap({**own, **given.channels}, time, given.path)


#: Channels of the actuators: positions of the wheelloaders, and loads of the aeroloaders.
_DRIVEN = {
    *(f"{corner}{name}{kind}" for corner in ("", *(f"{corner}." for corner in CORNERS)) for name in ("road", "aero")
      for kind in ("", "_command")),
    *(name for name, unit in _ONCE.items() if unit in ("N", "N.m")),
}  # fmt: skip


def is_drive(record: RawRecord, mapping: ChannelMap) -> bool:
    """Return whether a record has channels of the actuators only: it drives a car, and has no response of one."""
    columns = {pick.source for pick in (*mapping.channels.values(), mapping.time) if pick}
    return columns >= {*record.names} and mapping.channels.keys() <= _DRIVEN


# ---- Rig tests ------------------------------------------------------------------------------------------------------

#: Quantities of every corner that an identification needs, each with its possible names.
IDENTIFIED = (("road",), ("tire_force",), ("force",), ("displacement", "velocity"))
CUTOFF = 50.0  #: Low-pass cut-off for a derived shock velocity [Hz], at most 0.4 of the sample rate.


@with_config(OPEN)
@dataclass(frozen=True, slots=True)
class RigConditions:
    """Conditions of a rig test."""

    truth: str = ""  #: Name of the simulated car; empty for a real rig.
    drivefile: str = ""  #: Description of the drive file.
    shocks: tuple[str, ...] = ()  #: Description of the shock at each corner.
    seed: int | None = None  #: Seed of noise and drift, None without them.
    synthetic: str = ""  #: Note that marks synthetic data.

    def over(self, known: RigConditions) -> RigConditions:
        """Return these conditions, with missing ones taken from `known`."""
        own = {f.name: getattr(self, f.name) for f in fields(self)}
        empty = (None, "", ())
        return RigConditions(**{n: v if v not in empty else getattr(known, n) for n, v in own.items()})


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class RigTest(Recording):
    """A rig test with the channel names of docs/explanation/rig.md."""

    series: TimeSeries  #: Channels in SI.
    conditions: RigConditions = field(default_factory=RigConditions)  #: Known conditions of the test.
    source: Path | None = None  #: Path of the file, None for a record created in memory.
    sha256: str = ""  #: SHA-256 digest of the file, empty without a file.
    derived: tuple[str, ...] = ()  #: Descriptions of channels that were computed, not measured.
    #: Channels whose sign and corner were not checked, because the channels that show it are missing.
    unchecked: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()  #: What was left out while reading the file, e.g. a last sample that was cut off.

    @property
    def corners(self) -> tuple[str, ...]:
        """Names of the corners: one empty name for a quarter car, otherwise lf, rf, lr, rr."""
        return _corners_of(self.series)

    def _summary(self) -> Summary:
        return Summary.of(
            "Rig test",
            ("file", self.source.name if self.source else ""),
            ("drive file", self.conditions.drivefile),
            ("shocks", ", ".join(self.conditions.shocks)),
            ("corners", ", ".join(self.corners)),
            *self.series.summary_rows(),
            ("derived", "; ".join(self.derived)),
            ("sign and corner unchecked", ", ".join(self.unchecked)),
            ("notes", "; ".join(self.notes)),
        )

    def _title(self) -> str:
        return self.source.name if self.source else ""

    def write(self, path: str | Path) -> None:
        """Write a .parquet file (single precision, SI), or a .csv (SI, units in the header).

        Raises:
            FileFormatError: The suffix is not supported.
        """
        path, note = Path(path), json.dumps(asdict(self.conditions))
        if path.suffix == ".parquet":
            write_parquet(self.series, path, note=note, storage="float32")
        elif path.suffix == ".csv":
            write_csv(self.series, path, preamble=(f"# {note}",))
        else:
            raise FileFormatError("a rig test must be written as .parquet or .csv", path=path)


def _corners_of(series: TimeSeries) -> tuple[str, ...]:
    """Return the corners of a rig record."""
    heads = {name.partition(".")[0] for name in series.names}
    return ("",) if "road" in heads or (heads & set(_AT_CORNERS) and not heads & set(CORNERS)) else CORNERS


def read_rig_test(
    path: str | Path,
    *,
    channel_map: ChannelMap | None = None,
    units: Mapping[str, str] | None = None,
    flip: Iterable[str] = (),
    needs: Sequence[Sequence[str]] = IDENTIFIED,
    keep: bool = True,
) -> RigTest:
    """Read and check a rig record written by eightpost, or by another program with a channel map.

    Channels are checked if they are present. A missing velocity of a shock is derived from its displacement as in
    6.1.2.

    Args:
        path: Path of a file in one of the formats of docs/reference/dyno_files.md.
        channel_map: Columns by channel; without a map, the columns must have the names of the channels.
        units: Units by channel, for columns without a unit in the header.
        flip: Names of the channels whose sign is changed.
        needs: Quantities that every corner must have, each as its possible names. By default, those of an
            identification: the position of the wheelloader (`road`), the tire force, the force of the shock, and the
            displacement or velocity of the shock.
        keep: Whether the test has its samples in memory; otherwise it reads a channel each time it is used.

    Raises:
        FileFormatError: The file cannot be read.
        MissingChannelError: A required channel is missing, or the file has no channel of a rig.
        MissingUnitError: A column has no unit.
        UnknownUnitError: A unit is unknown, has the wrong dimension, or contradicts the unit of another channel.
        NotANumberError: A sample is NaN, empty or text.
        TimeGapError: Samples are missing.
        TooShortError: The record has less than 4 s.
        ConstantChannelError: A channel is dead.
        ClippedChannelError: A load cell is clipped.
        MismatchedRateError: A channel was sampled at a lower rate than the others.
        WrongSignError: A channel has the wrong sign.
        SwappedCornersError: A channel belongs to another corner.
    """
    path = Path(path)
    record = read_record(path)
    record = record.bridged((channel_map or map_beside(record) or ChannelMap()).bridge)
    mapping = rig_map(record, channel_map).flipped(flip)
    for name, pick in mapping.channels.items():
        record.check_unique(pick.source, channel=name)
    series = mapped_series(record, mapping, units=units, expected=CHANNEL_UNITS, keep=keep)
    corners = _corners_of(series)
    _check_channels(series, corners, needs, record, path)
    if len(series) < 2:
        raise record.origin.header_fault(TooShortError, "it has only one sample")
    _check_rig_units(series, corners, origin=record.origin)
    complete, derived = _with_velocities(series, corners)
    check_rig_record(complete, corners, origin=record.origin)
    not_checked = unchecked(series, complete, corners)
    notes = (*record.notes, *record.steps)
    return RigTest(complete, _conditions(path), path, sha256_of(path), derived, not_checked, notes)


def read_rig_tests(
    paths: Sequence[str | Path],
    *,
    channel_map: ChannelMap | None = None,
    units: Mapping[str, str] | None = None,
    flip: Iterable[str] = (),
) -> Iterator[RigTest]:
    """Read rig records one by one, each while the caller processes the previous one; at most two are in memory."""
    read = partial(read_rig_test, channel_map=channel_map, units=units, flip=tuple(flip))
    with ThreadPoolExecutor(1) as reader:
        pending = reader.submit(read, paths[0])
        for path in paths[1:]:
            test, pending = pending.result(), reader.submit(read, path)
            yield test
        yield pending.result()


def _check_channels(
    series: TimeSeries, corners: tuple[str, ...], needs: Sequence[Sequence[str]], record: RawRecord, path: Path
) -> None:
    known = "; ".join((", ".join(record.names), *record.notes))
    if not series.names:
        what = f"it has no channel of a rig; the file has: {known}; name its columns in a channel map; "
        what += f"`eightpost inspect {path} -o FOLDER` proposes one"
        raise MissingChannelError(what, path=path)
    for corner in corners:
        for options in needs:
            names = [channel(corner, name) for name in options]
            if not any(name in series for name in names):
                what = f"a rig test needs this channel; the file has: {known}; name its column in a channel map"
                raise MissingChannelError(what, path=path, channel=" or ".join(names))


def _with_velocities(series: TimeSeries, corners: tuple[str, ...]) -> tuple[TimeSeries, tuple[str, ...]]:
    derived = []
    cutoff = min(CUTOFF, 0.4 * series.sample_rate)
    for corner in corners:
        velocity, pot = (channel(corner, name) for name in ("velocity", "displacement"))
        if velocity not in series and pot in series:
            values = velocity_from_displacement(series[pot], series.sample_rate, cutoff)
            series = series.with_channel(velocity, "m/s", values)
            derived.append(f"{velocity} from {pot}, low-pass {cutoff:g} Hz and central differences")
    return series, tuple(derived)


def _conditions(path: Path) -> RigConditions:
    """Return the conditions in a Parquet file written by eightpost."""
    if path.suffix != ".parquet":
        return RigConditions()
    try:
        return checked(RigConditions, parse_json(parquet_header(path).get("note", ""), path))
    except FileFormatError:  # the note does not contain conditions
        return RigConditions()
