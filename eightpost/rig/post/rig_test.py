"""Rig tests: a checked record at the rig's channels and the conditions it was taken under."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

from eightpost.errors import FileFormatError, MissingChannelError, TooShortError
from eightpost.files import MALFORMED, sha256_of
from eightpost.rig.post.rig_channels import CHANNEL_UNITS, rig_map
from eightpost.rig.post.rig_faults import check_rig_record
from eightpost.signals.csv_file import write_csv
from eightpost.signals.filters import velocity_from_displacement
from eightpost.signals.mapped_series import mapped_series
from eightpost.signals.parquet_file import parquet_header, write_parquet
from eightpost.signals.read import read_record

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from eightpost.signals.channel_map import ChannelMap
    from eightpost.signals.timeseries import TimeSeries

#: Low-pass before a shock velocity is derived [Hz], at most 0.4 of the sample rate.
CUTOFF = 50.0


@dataclass(frozen=True, slots=True)
class RigConditions:
    """What a rig test was.

    Attributes:
        truth: Of the virtual rig; empty for a real one.
        drivefile: Its name.
        shocks: The shock of each corner, in words.
        seed: Of noise and drift, None where there is none.
        synthetic: A note that says so.
    """

    truth: str = ""
    drivefile: str = ""
    shocks: tuple[str, ...] = ()
    seed: int | None = None
    synthetic: str = ""

    def over(self, known: RigConditions) -> RigConditions:
        """Return these conditions, completed from `known` where they say nothing."""
        own = {f.name: getattr(self, f.name) for f in fields(self)}
        empty = (None, "", ())
        return RigConditions(**{n: v if v not in empty else getattr(known, n) for n, v in own.items()})


@dataclass(frozen=True, slots=True, eq=False)
class RigTest:
    """A rig test; its channels are named as in docs/rig.md.

    Attributes:
        series: The channels, SI.
        conditions: What is known of the test.
        source: The file, None for a record made in memory.
        sha256: The file's digest, empty without a file.
        derived: What was not measured but computed, in words.
    """

    series: TimeSeries
    conditions: RigConditions = field(default_factory=RigConditions)
    source: Path | None = None
    sha256: str = ""
    derived: tuple[str, ...] = ()

    @property
    def corners(self) -> tuple[str, ...]:
        """The corners: one empty name for a quarter car, else lf, rf, lr, rr."""
        return corners_of(self.series)

    def write(self, path: str | Path) -> None:
        """Write a .parquet file (single precision, SI), or a .csv (SI, units in the header).

        Raises:
            FileFormatError: Another suffix.
        """
        path, note = Path(path), json.dumps(asdict(self.conditions))
        if path.suffix == ".parquet":
            write_parquet(self.series, path, note=note, storage="float32")
        elif path.suffix == ".csv":
            write_csv(self.series, path, preamble=(f"# {note}",))
        else:
            raise FileFormatError("a rig test is written as .parquet or .csv", path=path)


def corners_of(series: TimeSeries) -> tuple[str, ...]:
    """Return the corners of a rig record."""
    return ("",) if "road" in series else ("lf", "rf", "lr", "rr")


def read_rig_test(
    path: str | Path,
    *,
    channel_map: ChannelMap | None = None,
    units: Mapping[str, str] | None = None,
    flip: Iterable[str] = (),
) -> RigTest:
    """Read and check a rig record: ours, or a team's own with a channel map.

    Needed are, at every corner, the wheelloader's position (`road`), the tire force, the shock's force and its
    displacement or velocity; a missing velocity is derived as in 6.1.2. Other channels are checked where they are.

    Args:
        path: A .parquet, .csv, .mat or .mf4 file.
        channel_map: Columns by channel; without one the columns have the channels' names.
        units: Units by channel, for columns whose header says none.
        flip: Channels whose sign is turned.

    Raises:
        FileFormatError: The file cannot be read.
        MissingChannelError: A channel that is needed is not there.
        MissingUnitError: A column has no unit.
        UnknownUnitError: A unit is not known or of the wrong dimension.
        NotANumberError: A sample is NaN, empty or text.
        TimeGapError: Samples are missing.
        TooShortError: Under 4 s.
        ConstantChannelError: A channel is dead.
        ClippedChannelError: A load cell sits at the end of its range.
        MismatchedRateError: A channel was sampled slower than the others and held.
        WrongSignError: A channel is positive the other way.
        SwappedCornersError: A channel belongs to another corner.
    """
    path = Path(path)
    record = read_record(path)
    mapping = rig_map(record, channel_map).flipped(flip)
    series = mapped_series(record, mapping, units=units, expected=CHANNEL_UNITS)
    corners = corners_of(series)
    _check_channels(series, corners, path)
    if len(series) < 2:
        raise record.origin.header_fault(TooShortError, "there is a single sample in it")
    series, derived = _with_velocities(series, corners)
    check_rig_record(series, corners, origin=record.origin)
    return RigTest(series, _conditions(path), path, sha256_of(path), derived)


def _check_channels(series: TimeSeries, corners: tuple[str, ...], path: Path) -> None:
    for corner in corners:
        prefix = f"{corner}." if corner else ""
        for wanted in (("road",), ("tire_force",), ("force",), ("displacement", "velocity")):
            if not any(prefix + name in series for name in wanted):
                what = f"a rig test needs it; the file has: {', '.join(series.names)}; name its column in a channel map"
                raise MissingChannelError(what, path=path, channel=" or ".join(prefix + name for name in wanted))


def _with_velocities(series: TimeSeries, corners: tuple[str, ...]) -> tuple[TimeSeries, tuple[str, ...]]:
    derived = []
    cutoff = min(CUTOFF, 0.4 * series.sample_rate)
    for corner in corners:
        velocity, pot = (f"{corner}.{name}" if corner else name for name in ("velocity", "displacement"))
        if velocity not in series:
            values = velocity_from_displacement(series[pot], series.sample_rate, cutoff)
            series = series.with_channel(velocity, "m/s", values)
            derived.append(f"{velocity} from {pot}, low-pass {cutoff:g} Hz and central differences")
    return series, tuple(derived)


def _conditions(path: Path) -> RigConditions:
    """Return what our own Parquet file says of its test."""
    if path.suffix != ".parquet":
        return RigConditions()
    try:
        known: dict[str, Any] = json.loads(parquet_header(path).get("note", "") or "{}")
        names = {f.name for f in fields(RigConditions)}
        own = {name: value for name, value in known.items() if name in names}
        return RigConditions(**{**own, "shocks": tuple(own.get("shocks", ()))})
    except (RecursionError, *MALFORMED):  # a note of another kind
        return RigConditions()
