"""Rig tests: a car's records on the shaker rig, and their units."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass, field, fields
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from pydantic import with_config

from eightpost.corners import CORNERS, channel
from eightpost.display import Summary
from eightpost.errors import FileFormatError, MissingChannelError, TooShortError, UnknownUnitError
from eightpost.files import parse_json, sha256_of
from eightpost.rig.motion import cause_of, slope_ratio
from eightpost.rig.plausibility import LOWEST_SAMPLING
from eightpost.rig.rig_faults import check_rig_record, unchecked
from eightpost.schema import OPEN, checked
from eightpost.signals.csv_file import write_csv
from eightpost.signals.faults import Origin
from eightpost.signals.filters import velocity_from_displacement
from eightpost.signals.formats import read_record
from eightpost.signals.parquet_file import parquet_header, write_parquet
from eightpost.signals.raw_record import ChannelMap, MappedChannel, find_time, map_beside, mapped_series
from eightpost.signals.timeseries import Recording, TimeSeries

if TYPE_CHECKING:
    from eightpost.signals.raw_record import RawRecord


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
    series = mapped_series(record, mapping, units=units, expected=CHANNEL_UNITS)
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
        what += f"`eightpost inspect {path.name} -o FOLDER` proposes one"
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
