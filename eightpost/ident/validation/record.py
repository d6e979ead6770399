"""Records that shocks are validated on: kind of motion and configuration."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import cumulative_trapezoid
from scipy.ndimage import label, uniform_filter1d
from scipy.optimize import minimize_scalar

from eightpost.array_types import Array
from eightpost.errors import ParameterError
from eightpost.ident.shock.record import single_frequency
from eightpost.ident.shock.result import digest_of
from eightpost.signals import parquet_header
from eightpost.units import convert

if TYPE_CHECKING:
    from eightpost.rig.dyno_test import DynoTest
    from eightpost.signals import TimeSeries

    Mask = NDArray[np.bool_]


# ---- Analysis of a record's motion ----------------------------------------------------------------------------------

#: A record stands still where its displacement changes by less than this share of its stroke within a window.
_STANDS = 0.01

#: Length of the window as a share of the record, and its minimum [s].
_WINDOW, _SHORTEST_WINDOW = 1.0 / 200.0, 0.05


def displacement_of(series: TimeSeries) -> Array:
    """Return the displacement (N,) [m]; if it was not measured, the integral of the velocity minus its mean."""
    if "displacement" in series:
        return series["displacement"]
    velocity = series["velocity"]
    return np.asarray(cumulative_trapezoid(velocity - velocity.mean(), series.time, initial=0))


def standing(series: TimeSeries) -> Mask:
    """Return where a record stands still (N,): within 1/200 of its length it moves less than 1 % of its stroke.

    Args:
        series: `displacement` [m], or `velocity` [m/s] to integrate.
    """
    half = _half_window(series)
    # Means over a quarter of the window keep the sensor's noise from being taken for motion.
    smooth = uniform_filter1d(displacement_of(series), max(1, half // 2), mode="nearest")
    padded = np.pad(smooth, half, mode="edge")
    return np.asarray(np.abs(padded[2 * half :] - padded[: -2 * half]) < _STANDS * np.ptp(smooth))


def _half_window(series: TimeSeries) -> int:
    window = max(_WINDOW * series.duration, _SHORTEST_WINDOW)
    return max(1, round(0.5 * window * series.sample_rate))


def stretches(mask: Mask) -> list[tuple[int, int]]:
    """Return the first and last sample of every run of true values of a mask (N,)."""
    labels, count = label(mask)
    starts = np.flatnonzero(np.diff(labels, prepend=0) > 0) if count else np.empty(0, int)
    ends = np.flatnonzero(np.diff(labels, append=0) < 0) if count else np.empty(0, int)
    return [(int(a), int(b)) for a, b in zip(starts, ends, strict=True)]


def moving_part(series: TimeSeries) -> TimeSeries:
    """Return a record without standstill at its beginning and end."""
    moves, half = np.flatnonzero(~standing(series)), _half_window(series)
    if moves.size < 3:
        return series
    first, last = int(moves[0]), int(moves[-1])
    # Anything within half a window of a motion counts as moving.
    first, last = first + half * (first > half), last - half * (last < len(series) - 1 - half)
    return series if last - first < half else series.window(float(series.time[first]), float(series.time[last]))


def refined_frequency(values: Array, time: Array, near: float) -> float:
    """Return the frequency [Hz] of the sine that fits values (N,) best, within 15 % of a first estimate [Hz]."""

    def misfit(frequency: float) -> float:
        phase = 2.0 * np.pi * frequency * (time - time[0])
        columns = np.stack([np.cos(phase), np.sin(phase), np.ones_like(phase)], axis=1)
        return float(np.linalg.lstsq(columns, values, rcond=None)[1].sum())

    # The misfit has local minima one period over the whole record apart, so a grid is searched first.
    grid = np.linspace(0.85 * near, 1.15 * near, 61)
    best = int(np.argmin([misfit(frequency) for frequency in grid]))
    step = float(grid[1] - grid[0])
    found = minimize_scalar(misfit, bounds=(float(grid[best]) - step, float(grid[best]) + step), method="bounded")
    return float(found.x)


# ---- Recognition of the kind of test of a dynamometer record from its motion (3.2.3) --------------------------------

Kind = Literal["random", "sine", "static", "bump"]

#: Minimum number of periods for a record with one frequency to be a sine test.
_PERIODS = 1.8

#: Share of the time at standstill from which a record is a static test or a bump.
_STANDING = 0.5

#: Limit between the dissertation's static test (0.2 in/s) and its bump (30 in/s) [m/s].
SLOW = convert(1.0, "in/s", "m/s")

#: Maximum number of samples used for the recognition.
_ENOUGH = 40_000


@dataclass(frozen=True, slots=True)
class Recognition:
    """The kind of a record and the reason for it.

    Attributes:
        kind: `random`, `sine`, `static` or `bump`.
        reason: Description of the motion that led to this kind.
        frequency: Frequency of a sine [Hz]; None for other kinds.
    """

    kind: Kind
    reason: str
    frequency: float | None = None


def recognise(test: DynoTest) -> Recognition:
    """Return the kind of test of a record.

    The rules are applied in this order:

    1. sine: in its part between the first and the last motion, at least 1.8 periods, and 90 % of the velocity's power
       within 20 % of one frequency;
    2. static: it stands still at least half of the time and is never faster than 1 in/s (Fig 3.12: 0.2 in/s);
    3. bump: it stands still at least half of the time and is faster (Fig 3.13: 30 in/s);
    4. random: everything else, including track records.

    Args:
        test: Test with displacement; if displacement is missing, the velocity is integrated.
    """
    series = _coarse(test.series)
    frequency = frequency_of(series)
    if frequency is not None:
        return Recognition("sine", f"one frequency, {frequency:.4g} Hz", frequency)
    share = float(np.mean(standing(series)))
    if share < _STANDING:
        return Recognition("random", f"moves {100.0 * (1.0 - share):.0f} % of the time, at many frequencies")
    speed = _speed(series)
    stands = f"stands still {100.0 * share:.0f} % of the time, moves at up to {convert(speed, 'm/s', 'in/s'):.2g} in/s"
    return Recognition("static" if speed < SLOW else "bump", stands)


def frequency_of(series: TimeSeries) -> float | None:
    """Return the frequency [Hz] of a record that is a sine, else None."""
    part = moving_part(series)
    coarse = single_frequency(part["velocity"], part.sample_rate)
    if coarse is None or coarse * part.duration < _PERIODS:
        return None
    if coarse * part.duration > 3.0:  # the first and last half period may include standstill
        part = part.window(float(part.time[0]) + 0.5 / coarse, float(part.time[-1]) - 0.5 / coarse)
    return refined_frequency(displacement_of(part), part.time, coarse)


def _coarse(series: TimeSeries) -> TimeSeries:
    """Return a long record averaged over blocks of samples; the rate stays at 200 Hz or more."""
    even = series if series.is_uniform else series.resample(series.sample_rate)
    count = min(len(even) // _ENOUGH + 1, max(1, int(even.sample_rate // 200.0)))
    return block_means(even, count)


def block_means(series: TimeSeries, count: int) -> TimeSeries:
    """Return the means of every `count` samples, at the mean of their times."""
    if count < 2:
        return series
    whole = len(series) // count * count
    values = series.values[:, :whole].reshape(len(series.names), -1, count).mean(axis=2)
    time = series.time[:whole].reshape(-1, count).mean(axis=1)
    return type(series)(time, values, series.names, series.units)


def _speed(series: TimeSeries) -> float:
    """Return the peak speed [m/s] of means over 5 ms, so that noise of the velocity sensor has no effect."""
    count = max(1, int(0.005 * series.sample_rate))
    return float(np.abs(block_means(series, count)["velocity"]).max())


# ---- The dissertation's Tables 3.4 and 3.5, read from printed.toml --------------------------------------------------


@dataclass(frozen=True, slots=True)
class PrintedFit:
    """A row of Table 3.4.

    Attributes:
        rms_lbf: Fit error [lbf].
        percent_of_deviation: Fit error in percent of the force's standard deviation.
        fit_seconds: Time of the fit [s].
        evaluation_seconds: Time of an evaluation [s].
        percent_less_than_static: Reduction from Polylinear [percent]; None for Polylinear itself.
    """

    rms_lbf: float
    percent_of_deviation: float
    fit_seconds: float
    evaluation_seconds: float
    percent_less_than_static: float | None = None


@dataclass(frozen=True, slots=True)
class PrintedConfiguration:
    """A column of Table 3.5.

    Attributes:
        number: Number 1 to 12, in the order of Table 3.1.
        build: Build number: 1, 2 or 4.
        clicks: Clicks of the bleed adjuster.
        gas_pressure_psi: Gas pressure [psi].
        rms_lbf: Error on the random validation record [lbf] by law.
    """

    number: int
    build: int
    clicks: int
    gas_pressure_psi: float
    rms_lbf: Mapping[str, float]

    @property
    def title(self) -> str:
        """The heading of the column in the table."""
        return (
            f"Build {self.build}, {self.clicks} click{'' if self.clicks == 1 else 's'}, {self.gas_pressure_psi:g} psi"
        )


def _read() -> dict[str, Any]:
    return tomllib.loads(files("eightpost.ident.validation").joinpath("printed.toml").read_text(encoding="utf-8"))


_DOCUMENT = _read()

#: Publication with the printed figures.
SOURCE: str = _DOCUMENT["source"]

#: Configuration of Table 3.4.
TABLE_3_4_CONFIGURATION = 1

#: Table 3.4 by law.
TABLE_3_4 = {law: PrintedFit(**row) for law, row in _DOCUMENT["fit"].items()}

#: Table 3.5, configurations 1 to 12.
CONFIGURATIONS = tuple(PrintedConfiguration(**column) for column in _DOCUMENT["configuration"])


def printed_configuration(number: int) -> PrintedConfiguration:
    """Return a column of Table 3.5."""
    return CONFIGURATIONS[number - 1]


# ---- Assignment of records and shocks to the dissertation's twelve configurations (Table 3.1) -----------------------

#: Number of bytes of a text file that are searched for its note.
_HEAD = 2048

#: Tolerance between a stated gas pressure and that of the table [psi].
_NEAR = 10.0


def configuration_of(conditions: Mapping[str, Any]) -> int | None:
    """Return the configuration 1 to 12 that conditions state, or None.

    Args:
        conditions: Conditions of a test or shock. `configuration` takes precedence; otherwise `build` (such as
            `Build 1`), `clicks` (starting with 1 or 14) and `gas_pressure [Pa]` must together match Table 3.1.

    Raises:
        ParameterError: `configuration` is not a whole number from 1 to 12.
    """
    stated = conditions.get("configuration")
    if stated is not None:
        return checked(stated)
    build = re.fullmatch(r"\s*build\s*(\d+)\s*", str(conditions.get("build")), re.IGNORECASE)
    clicks = re.match(r"\s*(\d+)\b", str(conditions.get("clicks")))
    pressure = conditions.get("gas_pressure [Pa]")
    if not (build and clicks and pressure):
        return None
    for printed in CONFIGURATIONS:
        near = abs(convert(float(pressure), "Pa", "psi") - printed.gas_pressure_psi) <= _NEAR
        if near and int(build[1]) == printed.build and int(clicks[1]) == printed.clicks:
            return printed.number
    return None


def checked(number: object) -> int:
    """Return a configuration's number after checking it."""
    if isinstance(number, (int, float, str)) and str(number).strip().isdigit():
        found = int(str(number).strip())
        if 1 <= found <= len(CONFIGURATIONS):
            return found
    raise ParameterError(f"a configuration is a whole number from 1 to {len(CONFIGURATIONS)}, not {number!r}")


def configuration_of_file(path: Path) -> int | None:
    """Return the configuration that a note in a file states (`configuration 3`), or None.

    Args:
        path: Text file, whose first lines are searched, or Parquet file, whose header is searched.
    """
    suffix = path.suffix.lower()
    if suffix in (".csv", ".txt"):
        with path.open("rb") as stream:
            note = stream.read(_HEAD).decode("utf-8", errors="replace")
    elif suffix == ".parquet":
        note = str((parquet_header(path) or {}).get("note", ""))
    else:
        return None
    found = re.search(r"\bconfiguration\W{1,3}(\d{1,2})\b", note, re.IGNORECASE)
    return checked(found[1]) if found else None


def conditions_of_test(test: DynoTest) -> dict[str, Any]:
    """Return the conditions that a test states, under the names of a shock file."""
    known = test.conditions
    stated = {
        "configuration": getattr(known, "configuration", None),
        "build": known.build,
        "clicks": known.clicks,
        "gas_pressure [Pa]": known.gas_pressure,
    }
    return {name: value for name, value in stated.items() if value is not None}


# ---- A dynamometer record with its kind and its configuration -------------------------------------------------------


@dataclass(frozen=True, slots=True, eq=False)
class Record:
    """A record for validation.

    Attributes:
        name: Display name.
        test: Measured test.
        kind: Kind of the test.
        reason: Reason for the kind.
        configuration: Configuration 1 to 12 of Table 3.1; None if unknown.
        frequency: Frequency of a sine [Hz], if it was recognised as one.
        digest: SHA-256 of the file, or of the samples.
    """

    name: str
    test: DynoTest
    kind: Kind
    reason: str
    configuration: int | None
    frequency: float | None
    digest: str

    @property
    def conditions(self) -> Mapping[str, Any]:
        """The known conditions of the shock in the record, under the names of a shock file."""
        stated = conditions_of_test(self.test)
        return stated | {"configuration": self.configuration} if self.configuration else stated


def record_of(
    test: DynoTest, *, name: str | None = None, kind: Kind | None = None, configuration: int | None = None
) -> Record:
    """Return a record; its kind is recognised if it is not given.

    Args:
        test: Measured test.
        name: Display name; default the file's name.
        kind: Kind of the test, which replaces the recognised one.
        configuration: Configuration, which replaces that of the conditions and of a note in the file.

    Raises:
        ParameterError: The configuration is not a number from 1 to 12.
    """
    known = _stated(test) if configuration is None else checked(configuration)
    seen = recognise(test) if kind is None else None
    return Record(
        name=name or (test.source.stem if test.source else "record"),
        test=test,
        kind=seen.kind if seen else kind or "random",
        reason=seen.reason if seen else "given by the user",
        configuration=known,
        frequency=seen.frequency if seen else None,
        digest=digest_of(test),
    )


def _stated(test: DynoTest) -> int | None:
    known = configuration_of(conditions_of_test(test))
    return configuration_of_file(test.source) if known is None and test.source and test.source.is_file() else known
