"""Shock dynamometer tests: a checked record and the conditions it was taken under."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from eightpost.errors import MissingChannelError
from eightpost.files import sha256_of
from eightpost.rig.dyno_aliases import DYNO_UNITS, dyno_map
from eightpost.signals import faults
from eightpost.signals.filters import velocity_from_displacement
from eightpost.signals.mapped_series import mapped_series
from eightpost.signals.read import read_record

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from eightpost.signals.channel_map import ChannelMap
    from eightpost.signals.origin import Origin
    from eightpost.signals.raw_record import RawRecord
    from eightpost.signals.timeseries import TimeSeries

#: The dissertation's low-pass cut-off for dynamometer data (3.3) [Hz].
CUTOFF = 50.0

#: Shortest record [s] and fewest samples that say something about a shock.
SHORTEST, FEWEST = 0.5, 200


@dataclass(frozen=True, slots=True)
class DynoConditions:
    """The conditions of a dynamometer test, as far as they are known.

    Attributes:
        build: The shock's build, as the team names it.
        clicks: The adjusters and how they are counted, in the team's words (`1 from closed, rebound`).
        gas_pressure: [Pa].
    """

    build: str | None = None
    clicks: str | None = None
    gas_pressure: float | None = None


@dataclass(frozen=True, slots=True, eq=False)
class DynoTest:
    """A dynamometer test that passed every check.

    Attributes:
        series: `velocity` [m/s] and `force` [N], where known `displacement` [m] and `temperature` [K]; all
            but the last positive in compression.
        conditions: Build, clicks, gas pressure.
        source: The file, None for a record made in memory.
        sha256: The file's digest, empty without a file.
        derived: What was not measured but computed, in words.
    """

    series: TimeSeries
    conditions: DynoConditions = field(default_factory=DynoConditions)
    source: Path | None = None
    sha256: str = ""
    derived: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for name in ("velocity", "force"):
            if name not in self.series:
                known = ", ".join(self.series.names)
                raise MissingChannelError(f"a dynamometer test needs it; there are: {known}", channel=name)


def read_dyno_test(
    path: str | Path,
    *,
    channel_map: ChannelMap | None = None,
    units: Mapping[str, str] | None = None,
    flip: Iterable[str] = (),
    conditions: DynoConditions | None = None,
    cutoff: float | None = None,
) -> DynoTest:
    """Read and check a shock dynamometer file.

    Columns are recognised by their usual names (t, x, disp, v, vel, F, load, temp, ...); a channel map goes
    first. A missing velocity is derived from the displacement by a low-pass and central differences (6.1.2).
    An offset of the force (static gas force, rod weight) is left in it.

    Args:
        path: A .csv, .txt, .parquet or .mat file.
        channel_map: Columns by channel, for what is not recognised.
        units: Units by channel name, for columns whose header says none.
        flip: Channels whose sign is turned.
        conditions: What is known about the shock.
        cutoff: Low-pass cut-off for a derived velocity [Hz]; default 50 Hz, at most 0.4 of the sample rate.

    Raises:
        FileFormatError: The file cannot be read.
        MissingChannelError: There is no force, or neither velocity nor displacement.
        MissingUnitError: A channel has no unit.
        UnknownUnitError: A unit is not known or of the wrong dimension.
        NotANumberError: A sample is NaN, empty or text.
        BackwardTimeError: Time decreases.
        DuplicateTimeError: Time repeats.
        TimeGapError: Samples are missing.
        TooShortError: Under 0.5 s or 200 samples.
        ConstantChannelError: Velocity, displacement or force do not move.
        ClippedChannelError: The force sits at the end of its range.
        WrongSignError: The force, or the displacement, is positive the other way.
    """
    path = Path(path)
    record = read_record(path)
    mapping = dyno_map(record, channel_map).flipped(flip)
    _check_channels(record, mapping)
    series = mapped_series(record, mapping, units=units, expected=DYNO_UNITS)
    _check_record(series, record.origin)
    derived: tuple[str, ...] = ()
    if "velocity" not in series:
        series, derived = _with_velocity(series, cutoff)
    elif "displacement" in series:
        _check_displacement_sign(series, record.origin)
    _check_force(series, record.origin, derived)
    return DynoTest(series, conditions or DynoConditions(), path, sha256_of(path), derived)


def _check_channels(record: RawRecord, mapping: ChannelMap) -> None:
    """Raise MissingChannelError unless time, force and a motion are there."""
    known = ", ".join(record.names)
    advice = f"the file has: {known}; name the column in a channel map"
    if mapping.time is None:
        raise record.origin.header_fault(MissingChannelError, f"there is none; {advice}", channel="time")
    if "force" not in mapping.channels:
        raise record.origin.header_fault(MissingChannelError, f"there is none; {advice}", channel="force")
    if not {"velocity", "displacement"} & set(mapping.channels):
        what = f"there is neither velocity nor displacement; {advice}"
        raise record.origin.header_fault(MissingChannelError, what, channel="velocity")


def _check_record(series: TimeSeries, origin: Origin) -> None:
    """Check time and movement of what was measured."""
    faults.check_gaps(series.time, origin=origin)
    faults.check_length(series.time, shortest=SHORTEST, fewest=FEWEST, origin=origin)
    for name in ("velocity", "displacement", "force"):
        if name in series:
            faults.check_moves(series[name], channel=name, origin=origin)


def _check_force(series: TimeSeries, origin: Origin, derived: tuple[str, ...]) -> None:
    """Check the force for clipping, and its sign against the velocity."""
    velocity, force = series["velocity"], series["force"]
    faults.check_not_clipped(force, channel="force", origin=origin, against=velocity)
    against = "the velocity derived from displacement" if derived else "velocity"
    faults.check_sign(force, velocity, channel="force", against=against, origin=origin)


def _check_displacement_sign(series: TimeSeries, origin: Origin) -> None:
    """Check the displacement's sign against the velocity that was measured beside it."""
    rate = series.sample_rate
    slope = velocity_from_displacement(series["displacement"], rate, _default_cutoff(rate))
    faults.check_sign(slope, series["velocity"], channel="displacement", against="velocity", origin=origin)


def _default_cutoff(rate: float) -> float:
    return min(CUTOFF, 0.4 * rate)


def _with_velocity(series: TimeSeries, cutoff: float | None) -> tuple[TimeSeries, tuple[str, ...]]:
    """Add the velocity that the displacement implies, and say how it was made."""
    steps = []
    if not series.is_uniform:
        series = series.resample(series.sample_rate)
        steps.append(f"resampled to an even {series.sample_rate:g} Hz")
    rate = series.sample_rate
    cutoff = cutoff or _default_cutoff(rate)
    velocity = velocity_from_displacement(series["displacement"], rate, cutoff)
    steps.append(f"velocity from displacement, low-pass {cutoff:g} Hz and central differences")
    return series.with_channel("velocity", "m/s", velocity), tuple(steps)
