"""Preparation of recorded rig tests for an identification (6.1.2, 6.4.1), and TOML files with its settings."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import numpy as np
from pydantic import WrapValidator
from scipy.signal import cheby1, sosfiltfilt
from typing_extensions import TypedDict  # pydantic needs it before Python 3.12

from eightpost.array_types import Array
from eightpost.corners import CORNERS, channel
from eightpost.errors import InputError, ParameterError, TooShortError
from eightpost.files import read_text
from eightpost.ident.preparation.channel_faults import (
    SMALLEST_CORRELATION,
    Lag,
    advance_channels,
    check_lost_channels,
    drifts,
    drive_lag,
    record_lags,
)
from eightpost.ident.preparation.plausibility import record_findings
from eightpost.ident.threads import for_each
from eightpost.rig.faults import Fault
from eightpost.rig.geometry import MODES, Geometry, displacement_modes, force_modes, ride_heights
from eightpost.rig.rig_test import CHANNEL_UNITS, RigTest
from eightpost.schema import object_of
from eightpost.signals.filters import velocity_from_displacement
from eightpost.signals.timeseries import TimeSeries
from eightpost.toml_document import in_unit, parse_model
from eightpost.verdict import Reason, listed

# ==== Decimation to a model's rate (6.4.1) ===========================================================================

#: Relative tolerance of a record's rate as a multiple of the model's, because loggers round time.
_RATE_TOLERANCE = 1e-3


@dataclass(frozen=True, slots=True)
class Decimation:
    """Decimation with an 8th-order Chebyshev type I low-pass, forward and backward, at 80 % of the Nyquist frequency.

    Aliases in the band are 63 dB down. All channels pass the same filter, so that responses between them do not change.
    """

    rate: float = 125.0  #: New rate [Hz]; the dissertation's models have 125 Hz.
    band: float = 0.8  #: Cut-off frequency as a fraction of the new Nyquist frequency [1].
    order: int = 8  #: Order of the filter, which is run forward and backward.
    #: Ripple in the pass band per pass [dB]. 6.4.1 does not give it; the default reduces amplitudes by at most 0.1 %.
    ripple: float = 0.005

    def __post_init__(self) -> None:
        if not (np.isfinite(self.rate) and self.rate > 0.0 and 0.0 < self.band < 1.0):
            raise ParameterError(f"{self}: rate must be above 0 Hz and band between 0 and 1")
        if self.order < 1 or not self.ripple > 0.0:
            raise ParameterError(f"{self}: order must be 1 or more and ripple above 0 dB")

    @property
    def cutoff(self) -> float:
        """Upper end of the pass band [Hz]."""
        return 0.5 * self.band * self.rate

    def factor(self, rate: float) -> int:
        """Return the ratio of `rate` [Hz] to the new rate.

        Raises:
            ParameterError: The rate is not a multiple of the new rate.
        """
        factor = max(1, round(rate / self.rate))
        if abs(rate / (factor * self.rate) - 1.0) > _RATE_TOLERANCE:
            near = sorted({max(1, int(rate / self.rate)) + step for step in (0, 1)})
            offered = " or ".join(f"{rate / n:.6g}" for n in near)
            raise ParameterError(
                f"a record of {rate:.6g} Hz cannot be decimated to {self.rate:.6g} Hz because its rate is not a "
                f"multiple of that; use a model rate of {offered} Hz, or export the record at a multiple"
            )
        return factor

    def apply(self, values: Array, rate: float) -> Array:
        """Return every n-th sample of the low-passed values (..., N) at a rate [Hz], preferably without mean.

        Values at the new rate are returned as they are.
        """
        factor = self.factor(rate)
        if factor == 1:
            return values
        sections = cheby1(self.order, self.ripple, self.cutoff, fs=rate, output="sos")
        pad = min(values.shape[-1] - 1, 6 * self.order * factor)
        return np.asarray(sosfiltfilt(sections, values, axis=-1, padlen=pad)[..., ::factor], dtype=np.float64)


# ==== Math channels 45 to 62 of Table 6.1, computed from measured channels (6.1.2) ===================================

HIGHEST_CUTOFF = 0.4  #: Highest cut-off of a low-pass before a derivative, as a fraction of the sample rate [1].


def _math_channels(
    series: TimeSeries, corners: Sequence[str], *, pot_cutoff: float | None, geometry: Geometry | None
) -> tuple[dict[str, Array], tuple[str, ...]]:
    """Return the math channels (N,) of a rig record at its own rate by name, and a sentence on each step.

    Without a cut-off frequency of the potentiometers' low-pass [Hz] there are no shock velocities; without a geometry,
    there are no modes of the aeroloaders and no ride heights. The rest of the record is not returned, because at full
    rate a copy takes hundreds of megabytes.
    """
    channels: dict[str, Array] = {}
    steps: list[str] = []
    pots = {channel(corner, "velocity"): channel(corner, "displacement") for corner in corners}
    pots = {velocity: pot for velocity, pot in pots.items() if pot in series}
    if pot_cutoff is not None and pots:
        # Low-pass and central differences (6.1.2), which return sin(x) / x of the true velocity with x = 2 pi f / rate:
        # 0.4 % low at 30 Hz for a rate of 1250 Hz. They are therefore computed before a record is decimated.
        rate = series.sample_rate
        cutoff = min(pot_cutoff, HIGHEST_CUTOFF * rate)
        channels = {name: velocity_from_displacement(series[pot], rate, cutoff) for name, pot in pots.items()}
        low = 100.0 * (1.0 - float(np.sinc(2.0 * 20.0 / rate)))
        names = ", ".join(channels)
        steps.append(
            f"{names} from displacement: low-pass {cutoff:g} Hz, central differences ({low:.2g} % low at 20 Hz)"
        )
    heights, loads, roads = (_corners(series, quantity) for quantity in ("aero_position", "aero", "road"))
    if geometry is not None and heights is not None:
        modes = displacement_modes(geometry) @ heights
        channels |= {f"aero.{mode}": row for mode, row in zip(MODES, modes, strict=True)}
        steps.append("aeroloaders' heave, pitch, roll and warp from their positions (Eq 6.1)")
        if roads is not None:
            nose, spoiler = ride_heights(modes[0], modes[1], roads, geometry)
            channels |= {"front.ride_height": nose, "rear.ride_height": spoiler}
            steps.append("ride heights from heave, pitch and the wheelloaders' plane (6.1.2)")
    if geometry is not None and loads is not None:
        channels |= dict(zip(_MODE_FORCES, -force_modes(geometry) @ loads, strict=True))
        steps.append("aeroloaders' modal forces from their load cells, positive upward (Eq 6.2)")
    return channels, tuple(steps)


_MODE_FORCES = ("aero.heave_force", "aero.pitch_moment", "aero.roll_moment", "aero.warp_moment")  #: Channels 49 to 52.


def _corners(series: TimeSeries, quantity: str) -> Array | None:
    """Return a quantity at lf, rf, lr, rr (4, N); None if a corner lacks it."""
    names = [f"{corner}.{quantity}" for corner in CORNERS]
    return np.stack([series[name] for name in names]) if all(name in series for name in names) else None


# ==== Prepared records, with descriptions of their preparation =======================================================


@dataclass(frozen=True, slots=True, eq=False)
class Prepared:
    """Records of one car at one rate, without means."""

    #: One record per test, in the order given, with the channels that all records have.
    records: tuple[TimeSeries, ...]
    means: tuple[Mapping[str, float], ...]  #: Means of each record by channel, SI, over the samples that were kept.
    names: tuple[str, ...]  #: Name of each record: its file, or its number.
    corners: tuple[str, ...]  #: Names of the corners: lf, rf, lr, rr, or one empty name for a quarter car.
    lags: tuple[tuple[Lag, ...], ...]  #: Lags within each record, and of each record behind the first one.
    steps: tuple[str, ...]  #: Descriptions of the steps that were applied to all records, a sentence each.
    notes: tuple[str, ...]  #: Findings that the user should check, a sentence each.
    sources: Mapping[str, str]  #: SHA-256 digest of each file by name.
    findings: tuple[tuple[Fault, ...], ...] = ()  #: Channels of each record that contradict the mechanics of the car.

    @property
    def reasons(self) -> tuple[Reason, ...]:
        """Findings as reasons of a verdict; one that several records have is a single reason."""
        places = _places(self.names, self.findings)
        return tuple(finding.reason(listed(names)) for finding, names in places)

    @property
    def rate(self) -> float:
        """Sample rate [Hz]."""
        return self.records[0].sample_rate

    @property
    def channels(self) -> tuple[str, ...]:
        """Names of the channels that all records have."""
        return self.records[0].names

    def summary(self) -> tuple[str, ...]:
        """Return lines on the records, the steps and the notes, for printing."""
        lines = [
            f"{name}: {record.duration:.6g} s at {record.sample_rate:.6g} Hz, {len(record.names)} channels"
            for name, record in zip(self.names, self.records, strict=True)
        ]
        return (*lines, *self.steps, *(f"note: {note}" for note in self.notes))


def _places(names: Sequence[str], findings: Sequence[Sequence[Fault]]) -> Iterator[tuple[Fault, Sequence[str]]]:
    """Yield each finding with the names of the records that have it, in the words of the first one."""
    found: dict[tuple[str, tuple[str, ...]], tuple[Fault, list[str]]] = {}
    for name, own in zip(names, findings, strict=True):
        for finding in own:
            found.setdefault((finding.rule.name, finding.channels), (finding, []))[1].append(name)
    yield from found.values()


# ---- Preparation of recorded rig tests for an identification (6.1.2, 6.4.1) -----------------------------------------

_FEWEST = 100  #: Minimum number of samples that a record must have after preparation.


@dataclass(frozen=True, slots=True)
class Preparation:
    """Settings of the preparation of records. The default assumes nothing that the records do not contain.

    Raises:
        ParameterError: A value is outside its range.
    """

    decimation: Decimation = field(default_factory=Decimation)  #: Decimation to the model's rate.
    #: Cut-off frequency of the potentiometers' low-pass for the computation of shock velocities [Hz]; None keeps the
    #: records' own velocities.
    pot_cutoff: float | None = 50.0
    #: Geometry of the rig, from which the aeroloaders' modes and the ride heights are computed; None keeps the records'
    #: own channels.
    geometry: Geometry | None = None
    #: Delays of late channels by name [s]; these channels are advanced in every record.
    delays: Mapping[str, float] = field(default_factory=dict)
    #: Channel by which every record is synchronised with the first one, such as `lf.road`; None does not synchronise.
    #: Recipes that need the same drive sample by sample require it.
    same_start: str | None = None
    settling: float = 0.0  #: Time omitted at the start of every record [s].
    mass: float | None = None  #: Mass of the car [kg], by which the forces are checked; None if it is unknown.

    def __post_init__(self) -> None:
        if self.pot_cutoff is not None and not self.pot_cutoff > 0.0:
            raise ParameterError(f"the potentiometers' cut-off must be above 0 Hz, not {self.pot_cutoff:g}")
        if self.settling < 0.0:
            raise ParameterError(f"the settling must not be negative; it is {self.settling:g} s")
        if self.mass is not None and not self.mass > 0.0:
            raise ParameterError(f"the mass of the car must be above 0 kg, not {self.mass:g}")


def prepare(tests: Iterable[RigTest], preparation: Preparation | None = None) -> Prepared:
    """Prepare rig tests; the default settings are those of `Preparation`.

    Each test is decimated to the model's rate before the next one is requested. If the tests come from a generator,
    only one at a time is in memory.

    Raises:
        InputError: No test was given, or the tests are of different cars.
        ParameterError: A record's rate is not a multiple of the model's rate.
        ConstantChannelError: A channel fails during its record.
        TooShortError: A record is too short.
        MissingChannelError: A channel that is to be advanced or synchronised is missing.
    """
    how = preparation or Preparation()
    singles: list[_Single] = []
    for number, test in enumerate(tests, start=1):
        name = test.source.name if test.source else f"record {number}"
        single = _prepared(test, how, name, singles[0] if singles else None)
        singles.append(single._replace(full=None) if singles else single)
    if not singles:
        raise InputError("no rig test was given; give one or more")
    return _together(singles, how)


class _Single(NamedTuple):
    """One prepared record."""

    name: str
    corners: tuple[str, ...]
    series: TimeSeries
    means: Mapping[str, float]
    lags: tuple[Lag, ...]
    drifts: tuple[Lag, ...]
    findings: tuple[Fault, ...]
    steps: tuple[str, ...]
    sha256: str
    full: TimeSeries | None
    """Channel at full rate that other records are synchronised with."""
    notes: tuple[str, ...]


def _prepared(test: RigTest, how: Preparation, name: str, first: _Single | None) -> _Single:
    corners = test.corners
    check_lost_channels(test.series, corners, path=test.source)
    series = advance_channels(test.series, how.delays)
    changes = drifts(series, corners)
    findings = record_findings(series, corners, mass=how.mass)
    full = series.select([how.same_start]) if how.same_start and first is None else None
    lags = list(record_lags(series, corners))
    if how.same_start and first is not None and first.full is not None:
        late = _start(series, first.full, how.same_start, name)
        lags.append(late)
        series = advance_channels(series, dict.fromkeys(series.names, late.seconds))
    computed, steps = _math_channels(series, corners, pot_cutoff=how.pot_cutoff, geometry=how.geometry)
    if how.settling >= series.duration:
        raise TooShortError(f"{name}: the record has {series.duration:.4g} s, but the settling is {how.settling:.4g} s")
    start = int(np.searchsorted(series.time, series.time[0] + how.settling)) if how.settling else 0
    try:
        record, means = _decimated(series, computed, start, how.decimation)
    except ParameterError as error:
        raise ParameterError(f"{name}: {error}") from error
    return _Single(name, corners, record, means, tuple(lags), changes, findings, steps, test.sha256, full, test.notes)


def _start(series: TimeSeries, first: TimeSeries, channel: str, name: str) -> Lag:
    """Return the lag of a record behind the first one."""
    if abs(series.sample_rate / first.sample_rate - 1.0) > 1e-3:
        rates = f"{series.sample_rate:g} and {first.sample_rate:g} Hz"
        raise InputError(f"{name}: records of {rates} cannot be synchronised; export both at one rate")
    late = drive_lag(series, first, channel)
    if late.correlation < SMALLEST_CORRELATION:
        raise InputError(
            f"{name}: its {channel} is not that of the first record (correlation {late.correlation:.2f}), so the two "
            "cannot be synchronised; omit same_start for records with different drives"
        )
    return late


def _decimated(
    series: TimeSeries, computed: Mapping[str, Array], first: int, decimation: Decimation
) -> tuple[TimeSeries, dict[str, float]]:
    """Return a record with its math channels at the model's rate without means, and the means."""
    rate = series.sample_rate
    rows = {**dict(zip(series.names, series.values, strict=True)), **computed}
    units = dict(zip(series.names, series.units, strict=True)) | {name: CHANNEL_UNITS[name] for name in computed}
    means = {name: float(row[first:].mean()) for name, row in rows.items()}
    # Row by row, because all channels at full rate and their filtered copies would take gigabytes.
    low = for_each(rows, lambda name: decimation.apply(rows[name][first:] - means[name], rate))
    channels = {name: (units[name], row) for name, row in zip(rows, low, strict=True)}
    return TimeSeries.from_channels(series.time[first :: decimation.factor(rate)], channels), means


def _together(singles: Sequence[_Single], how: Preparation) -> Prepared:
    named: dict[str, str] = {}
    for single in singles:
        if single.sha256 in named:
            raise InputError(f"{single.name} is the same record as {named[single.sha256]}; give every test once")
        named |= {single.sha256: single.name} if single.sha256 else {}
        if single.corners != singles[0].corners:
            raise InputError(f"{single.name} has other corners than {singles[0].name}; give tests of one car")
        if len(single.series) < _FEWEST:
            raise TooShortError(
                f"{single.name}: {len(single.series)} samples are left at {how.decimation.rate:g} Hz; at least "
                f"{_FEWEST} are needed: use a longer record or a higher rate"
            )
    shared = [name for name in singles[0].series.names if all(name in single.series for single in singles)]
    records = [single.series.select(shared) for single in singles]
    if how.same_start:
        size = min(len(record) for record in records)
        records = [record.window(record.time[0], record.time[size - 1]) for record in records]
    return Prepared(
        records=tuple(records),
        means=tuple({name: single.means[name] for name in shared} for single in singles),
        names=tuple(single.name for single in singles),
        corners=singles[0].corners,
        lags=tuple(single.lags for single in singles),
        steps=_steps(singles[0], how),
        notes=_notes(singles, shared, how),
        sources={single.name: single.sha256 for single in singles if single.sha256},
        findings=tuple(single.findings for single in singles),
    )


def _steps(single: _Single, how: Preparation) -> tuple[str, ...]:
    decimation = how.decimation
    return (
        *(f"{name} advanced by {1e3 * delay:.4g} ms" for name, delay in how.delays.items()),
        *((f"every record synchronised with the first one by {how.same_start}",) if how.same_start else ()),
        *single.steps,
        *((f"the first {how.settling:g} s omitted",) if how.settling else ()),
        "means removed and stored",
        f"decimated to {decimation.rate:g} Hz: Chebyshev I of order {decimation.order}, forward and backward, "
        f"pass band to {decimation.cutoff:g} Hz",
    )


def unexplained_lags(lags: Iterable[Lag], findings: Sequence[Fault]) -> tuple[Lag, ...]:
    """Return the notable lags of a record, without those of channels that a finding already reports as out of step.

    The lag `tire_force` is that of all corners together, so it is reported by a finding on any of them.
    """
    delayed = {
        name for finding in findings if finding.rule.name == "a channel is out of step" for name in finding.channels
    }
    delayed |= {name.rpartition(".")[2] for name in delayed}
    return tuple(lag for lag in lags if lag.is_notable and lag.channel not in delayed)


def _notes(singles: Sequence[_Single], shared: Sequence[str], how: Preparation) -> tuple[str, ...]:
    notes = []
    for single in singles:
        notes += [f"{single.name}: {note}" for note in single.notes]
        lost = [name for name in single.series.names if name not in shared]
        if lost:
            notes.append(f"{single.name}: omitted, because not all records have them: {', '.join(lost)}")
        for lag in unexplained_lags(single.lags, single.findings):
            if lag.channel != how.same_start:
                notes.append(
                    f"{single.name}: {lag}; if its logger is late, give each of that logger's channels a delay of "
                    f"{lag.seconds:.5f} s"
                )
        notes += [
            f"{single.name}: between start and end {drift.drift_text}; use part of the record"
            for drift in single.drifts
        ]
    names, findings = [single.name for single in singles], [single.findings for single in singles]
    notes += [f"{listed(places)}: {finding}" for finding, places in _places(names, findings)]
    return tuple(notes)


# ==== Files with settings ============================================================================================

_Seconds, _Hertz = Annotated[float, in_unit("s")], Annotated[float, in_unit("Hz")]
_Geometry: Any = object_of({one.name: Annotated[float, in_unit("m")] for one in fields(Geometry)})


class _Entries(TypedDict, total=False):
    schema: int
    rate: _Hertz
    pot_cutoff: Annotated[_Hertz, WrapValidator(lambda value, hertz: None if value == "own" else hertz(value))]
    settling: _Seconds
    same_start: str
    mass: Annotated[float, in_unit("kg")]
    delays: dict[str, _Seconds]
    geometry: _Geometry


def read_preparation(path: str | Path) -> Preparation:
    """Read the settings of a preparation from a TOML file; missing keys take the defaults of `Preparation`.

    Every number needs a unit::

        rate = "125 Hz"
        pot_cutoff = "50 Hz"        # or "own": keep the records' velocities
        settling = "2 s"
        same_start = "lf.road"
        mass = "1400 kg"

        [delays]
        "lf.force" = "4.2 ms"

        [geometry]                  # complete, or omit the table
        front_axle = "60 in"

    Raises:
        FileFormatError: The file does not exist or is not TOML, or an entry is unknown, missing or wrong.
        ParameterError: A value is outside its range.
    """
    path = Path(path)
    given: dict[str, Any] = dict(parse_model(_Entries, read_text(path), path))
    del given["schema"]
    if "geometry" in given:
        given["geometry"] = Geometry(**given["geometry"])
    try:
        if "rate" in given:
            given["decimation"] = Decimation(given.pop("rate"))
        return Preparation(**given)
    except ParameterError as error:
        raise ParameterError(f"{path}: {error}") from error
