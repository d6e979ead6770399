"""Entries of a report: runs on a dynamometer, peak-velocity tables and fitted laws, with all their figures."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np

from eightpost.array_types import Array
from eightpost.ident.dyno_report.cycles import Cycles, cycles_of, energy_over_time, force_at_rest
from eightpost.ident.dyno_report.found import Found, Unknown
from eightpost.ident.dyno_report.slow import SlowFigures, slow_figures
from eightpost.ident.dyno_report.velocity_curve import (
    STROKES,
    Stroke,
    StrokeFigures,
    VelocityCurve,
    curve_of_law,
    curve_of_series,
    curve_of_table,
    stroke_figures,
)
from eightpost.rig.dyno_test import DynoTest
from eightpost.rig.lag import force_lag
from eightpost.rig.peak_velocity_table import PeakVelocityTable
from eightpost.rig.temperature_drift import temperature_drift
from eightpost.shock import Shock, law_title
from eightpost.signals import TimeSeries

Kind = Literal["run", "table", "law"]


@dataclass(frozen=True, slots=True)
class Setting:
    """Build and conditions of an entry; unknown conditions are None.

    Attributes:
        build: Name of the build.
        clicks: Settings of the adjusters, in the team's words.
        gas_pressure: Gas pressure [Pa].
        temperature: Mean temperature [K].
    """

    build: str
    clicks: str | None = None
    gas_pressure: float | None = None
    temperature: float | None = None


@dataclass(frozen=True, slots=True)
class Warming:
    """Temperature and energy of a run.

    Attributes:
        start: Mean temperature of the first tenth [K].
        drift: Mean temperature of the last tenth minus that of the first [K].
        energy: Energy from the first to the last sample [J].
        power: Mean power [W].
    """

    start: Found
    drift: Found
    energy: Found
    power: Found


@dataclass(frozen=True, slots=True, eq=False)
class Band:
    """The 95 % band of a fitted static curve: velocities (M,) [m/s], lower and upper forces (M,) [N]."""

    velocity: Array
    low: Array
    high: Array


@dataclass(frozen=True, slots=True, eq=False)
class Entry:
    """A run, a table or a law, with its figures.

    Attributes:
        kind: Kind of the entry.
        name: Unique display name.
        setting: Build and conditions.
        source: Path of the file; None for data in memory.
        sha256: Digest of the file; empty without a file.
        curve: Mean force over velocity, without `level` and, of a run, without its lag.
        strokes: Knee and slopes of each stroke.
        offset: Force at zero velocity [N], of a run after its lag is removed.
        cycles: Cycles of a run, or the reason why they are unknown.
        lag: Lag of force behind velocity [s]; of a law its time constant, at zero velocity if it has several.
        slow: Gas force and friction.
        warming: Temperature and energy.
        test: Record of a run.
        shock: Shock of a law.
        band: Band of a law's curve.
        notes: Notes on the file.
        shared_gas: Gas force in the middle of the stroke [N] that was taken from a slow run; None if it was not.
    """

    kind: Kind
    name: str
    setting: Setting
    source: Path | None
    sha256: str
    curve: VelocityCurve | Unknown
    strokes: Mapping[Stroke, StrokeFigures]
    offset: Found
    cycles: Cycles | Unknown
    lag: Found
    slow: SlowFigures
    warming: Warming
    test: DynoTest | None = None
    shock: Shock | None = None
    band: Band | None = None
    notes: tuple[str, ...] = field(default=())
    shared_gas: float | None = None

    @property
    def level(self) -> Found:
        """Constant part of the force [N] that the curve is without: gas force of a slow run, else `offset`."""
        return self.offset if self.shared_gas is None else self.shared_gas

    @property
    def highest(self) -> float:
        """Highest speed of its curve in either stroke [m/s]."""
        return max(figures.highest for figures in self.strokes.values())

    @property
    def series(self) -> TimeSeries | None:
        """Record of a run, None for tables and laws."""
        return self.test.series if self.test else None


def strokes_of(curve: VelocityCurve | Unknown) -> dict[Stroke, StrokeFigures]:
    """Return knee and slopes of each stroke of a curve."""
    return {stroke: stroke_figures(curve, stroke) for stroke in STROKES}


# ---- Runs -----------------------------------------------------------------------------------------------------------


def entry_of_test(test: DynoTest, name: str, build: str) -> Entry:
    """Return the entry of a run.

    Args:
        test: Run; its record is resampled if its time steps are uneven.
        name: Unique display name.
        build: Name of the build.
    """
    series = test.series if test.series.is_uniform else test.series.resample(test.series.sample_rate)
    cycles, lag = cycles_of(series), _lag(series)
    static = series if isinstance(lag, Unknown) else advanced(series, lag)
    at_rest = force_at_rest(series)
    offset = cycles_of(static).offset if isinstance(at_rest, Unknown) else at_rest
    curve = offset if isinstance(offset, Unknown) else curve_of_series(static, cycles, offset)
    known = test.conditions
    heat = float(series["temperature"].mean()) if "temperature" in series else known.temperature
    return Entry(
        "run", name, Setting(build, known.clicks, known.gas_pressure, heat), test.source, test.sha256,
        curve, strokes_of(curve), offset, cycles, lag, slow_figures(series), _warming(series, test),
        test=test, notes=(*test.derived, *test.notes),
    )  # fmt: skip


def advanced(series: TimeSeries, lag: float) -> TimeSeries:
    """Return a record whose force is advanced by its lag [s], without the samples at the end that have no force.

    A lag adds its product with acceleration and damping rate to the force at zero velocity. If the rates of both
    strokes differ, the mean of both ends of the stroke is not the gas force.
    """
    inside = (series.time + lag >= series.time[0]) & (series.time + lag <= series.time[-1])
    force = np.interp(series.time + lag, series.time, series["force"])
    names = [name for name in series.names if name != "force"]
    return series.select(names).with_channel("force", "N", force).at(inside)


def _lag(series: TimeSeries) -> Found:
    lag = force_lag(series)
    return Unknown("the motion does not separate a lag from gas and friction") if lag is None else lag.seconds


def _warming(series: TimeSeries, test: DynoTest) -> Warming:
    energy = float(energy_over_time(series)[-1])
    power = energy / series.duration
    if "temperature" not in series:
        none = Unknown("the record has no temperature")
        known = test.conditions.temperature
        return Warming(none if known is None else known, none, energy, power)
    tenth = max(1, len(series) // 10)
    return Warming(float(series["temperature"][:tenth].mean()), temperature_drift(series), energy, power)


# ---- Tables ---------------------------------------------------------------------------------------------------------

_NO_TIME = Unknown("a peak-velocity table has no time")


def entry_of_table(table: PeakVelocityTable, name: str, build: str) -> Entry:
    """Return the entry of a peak-velocity table; see `entry_of_test` for the arguments."""
    curve = curve_of_table(table)
    no_gas = Unknown("the table shows no gas force: it has no points at zero speed and none near it, or no gas")
    gas: Found = table.gas_force if table.gas_source else no_gas
    no_time = SlowFigures(gas, _NO_TIME, _NO_TIME, 0.0, _NO_TIME)
    notes = (f"the gas force was found from {table.gas_source}",) if table.gas_source else ()
    return Entry(
        "table", name, Setting(build, table.clicks), table.source, table.sha256, curve, strokes_of(curve), gas,
        _NO_TIME, _NO_TIME, no_time, Warming(_NO_TIME, _NO_TIME, _NO_TIME, _NO_TIME), notes=notes,
    )  # fmt: skip


# ---- Laws -----------------------------------------------------------------------------------------------------------

_NO_RECORD = Unknown("a law has no record; see its runs")


def entry_of_shock(shock: Shock, name: str, build: str, *, source: Path | None = None, sha256: str = "") -> Entry:
    """Return the entry of a fitted law; see `entry_of_test` for the arguments.

    Args:
        shock: Shock.
        name: Unique display name.
        build: Name of the build.
        source: Path of the shock file.
        sha256: Digest of the shock file.
    """
    curve, port, known = curve_of_law(shock.law), shock.law.port, shock.conditions
    heat = _numbers(known.get("temperature_range [K]"))
    pressure, clicks = known.get("gas_pressure [Pa]"), known.get("clicks")
    setting = Setting(
        build,
        str(clicks) if clicks else None,
        float(pressure) if isinstance(pressure, int | float) else None,
        float(np.mean(heat)) if heat is not None and heat.size else None,
    )
    lag = _time_constant(shock)
    estimates = (_estimate(known, "gas_preload_estimate [N]"), _estimate(known, "gas_stiffness_estimate [N/m]"))
    gas = SlowFigures(*estimates, port.seal_friction if port.seal_friction else Unknown("the law has no seal friction"),
                      0.0, _NO_RECORD)  # fmt: skip
    changes = tuple(str(change) for change in shock.fit.get("changes", ()) if isinstance(change, str))
    return Entry(
        "law", name, setting, source, sha256, curve, strokes_of(curve), port.gas_preload, _NO_RECORD, lag, gas,
        Warming(_NO_RECORD, _NO_RECORD, _NO_RECORD, _NO_RECORD), shock=shock, band=_band(shock), notes=changes,
    )  # fmt: skip


def _time_constant(shock: Shock) -> Found:
    """Return the time constant of a law [s]; of several ones, that at zero velocity."""
    found = getattr(shock.law, "time_constant", None)
    if found is None:
        return Unknown(f"{law_title(shock.law_name)} has no time constant")
    return float(found[len(found) // 2]) if isinstance(found, tuple) else float(found)


def _estimate(known: Mapping[str, Any], key: str) -> Found:
    value = known.get(key)
    if isinstance(value, int | float):
        return float(value)
    return Unknown("the shock file states no estimate of the gas force")


def _band(shock: Shock) -> Band | None:
    """Return the band of the fit section; None if it is missing or has another form."""
    found = shock.fit.get("curve_band")
    if not isinstance(found, Mapping):
        return None
    columns = [_numbers(found.get(key)) for key in ("velocity [m/s]", "force [N]", "half_width [N]")]
    if any(column is None or column.size < 2 or column.size != columns[0].size for column in columns):  # type: ignore[union-attr]
        return None
    velocity, force, half = columns
    assert velocity is not None and force is not None and half is not None
    return Band(velocity, force - half, force + half)


def _numbers(value: object) -> Array | None:
    """Return a list of finite numbers as an array (N,), None for anything else."""
    if not isinstance(value, list | tuple) or not all(type(item) in (int, float) for item in value):
        return None
    array = np.asarray(value, dtype=np.float64)
    return array if np.isfinite(array).all() else None
