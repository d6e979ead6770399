"""Entries of a report: runs on a dynamometer, peak-velocity tables and fitted laws, with all their figures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np

from eightpost.array_types import Array
from eightpost.ident.dyno_report.cycles import (
    SLOW,
    STROKES,
    Cycles,
    Found,
    SlowFigures,
    Stroke,
    Unknown,
    cycles_of,
    energy_over_time,
    force_at_rest,
    slow_figures,
)
from eightpost.ident.dyno_report.loop import (
    Branches,
    StrokeFigures,
    VelocityCurve,
    branches_of,
    closed_loop,
    curve_of_law,
    curve_of_series,
    curve_of_table,
    force_at_zero,
    stroke_figures,
)
from eightpost.rig.dyno_test import DynoTest, temperature_drift
from eightpost.rig.motion import force_lag
from eightpost.rig.peak_velocity import PeakVelocityTable
from eightpost.shock import Shock, law_title
from eightpost.signals import TimeSeries

Kind = Literal["run", "table", "law"]

CORRELATED = 0.3  #: Correlation of force and velocity below which a closed loop has no meaning.


@dataclass(frozen=True, slots=True)
class EntrySetting:
    """Build and conditions of an entry; unknown conditions are None."""

    build: str  #: Name of the build.
    clicks: str | None = None  #: Settings of the adjusters, in the team's words.
    gas_pressure: float | None = None  #: Gas pressure [Pa].
    temperature: float | None = None  #: Mean temperature [K].


@dataclass(frozen=True, slots=True)
class Warming:
    """Temperature and energy of a run."""

    start: Found  #: Mean temperature of the first tenth [K].
    drift: Found  #: Mean temperature of the last tenth minus that of the first [K].
    #: Energy from the first to the last sample [J], and mean power [W].
    energy: Found
    power: Found


@dataclass(frozen=True, slots=True, eq=False)
class ForceBand:
    """A band about a curve: velocities (M,) [m/s], lower and upper forces (M,) [N]."""

    velocity: Array
    low: Array
    high: Array


@dataclass(frozen=True, slots=True, eq=False)
class Entry:
    """A run, a table or a law, with its figures."""

    kind: Kind
    #: Unique display name.
    name: str
    setting: EntrySetting
    #: Path of the file, None for data in memory, and its digest, empty without a file.
    source: Path | None
    sha256: str
    curve: VelocityCurve | Unknown  #: Mean force over velocity, without `level` and, of a run, without its lag.
    strokes: Mapping[Stroke, StrokeFigures]  #: Knee and slopes of each stroke.
    offset: Found  #: Force at zero velocity [N], of a run after its lag is removed.
    level: Found  #: Constant part of the force [N] that the curve is without: gas force of a slow run, else `offset`.
    cycles: Cycles | Unknown  #: Cycles of a run, with the peaks of its closed loop, or the reason why they are unknown.
    lag: Found  #: Lag of force behind velocity [s]; of a law its time constant, at zero velocity if it has several.
    #: Gas force and friction.
    slow: SlowFigures
    warming: Warming
    branches: Branches | None = None  #: Measured branches of a run, without `level`.
    test: DynoTest | None = None  #: Record of a run with an even time step.
    #: Shock of a law, and the 95 % band of its static curve.
    shock: Shock | None = None
    band: ForceBand | None = None
    notes: tuple[str, ...] = field(default=())  #: Notes on the file.

    @property
    def highest(self) -> float:
        """Highest speed of its curve in either stroke [m/s]."""
        return max(figures.highest for figures in self.strokes.values())

    @property
    def title(self) -> str:
        """Kind of the entry as text."""
        return law_title(self.shock.law_name) if self.shock else {"run": "run", "table": "PVP table"}[self.kind]


def _strokes_of(curve: VelocityCurve | Unknown) -> dict[Stroke, StrokeFigures]:
    return {stroke: stroke_figures(curve, stroke) for stroke in STROKES}


# ---- Runs -----------------------------------------------------------------------------------------------------------


def entry_of_test(test: DynoTest, name: str, build: str, *, cycle: str | int = "mean") -> Entry:
    """Return the entry of a run.

    Args:
        test: Run; its record is resampled if its time steps are uneven.
        name: Unique display name.
        build: Name of the build.
        cycle: Cycle of a steady sine that is shown: `mean` of all, the `last`, or its number.

    Raises:
        InputError: The run has fewer cycles.
    """
    series = test.series if test.series.is_uniform else test.series.resample(test.series.sample_rate)
    closed = _closed(series)
    static = cycles_of(closed, cycle)
    cycles = replace(cycles_of(series, cycle), peak_velocity=static.peak_velocity, peak_force=static.peak_force)
    at_rest = force_at_rest(closed)
    offset = force_at_zero(curve_of_series(closed, static)) if isinstance(at_rest, Unknown) else at_rest
    curve: VelocityCurve | Unknown
    if isinstance(offset, Unknown):
        curve, branches = offset, None
    else:
        steady, measured = (one if static.span is None else one.window(*static.span) for one in (closed, series))
        curve, branches = curve_of_series(steady, static, offset), branches_of(measured, offset)
    delay = force_lag(series)
    lag = Unknown("the motion does not separate a lag from gas and friction") if delay is None else delay.seconds
    whole = f"all cycles are shown, not the one of --set cycle={cycle}, because the motion is not one steady cycle"
    known = test.conditions
    heat = float(series["temperature"].mean()) if "temperature" in series else known.temperature
    return Entry(
        "run", name, EntrySetting(build, known.clicks, known.gas_pressure, heat), test.source, test.sha256,
        curve, _strokes_of(curve), offset, offset, cycles, lag, slow_figures(series), _warming(series, test),
        branches, test=replace(test, series=series),
        notes=(*test.derived, *test.notes, *([whole] if cycle != "mean" and cycles.span is None else [])),
    )  # fmt: skip


def _closed(series: TimeSeries) -> TimeSeries:
    """Return the closed loop of a record; a motion that is slow, or has no damping, keeps its loop."""
    if float(np.abs(series["velocity"]).max()) <= SLOW:
        return series
    closed = closed_loop(series)
    damped = float(np.corrcoef(closed["force"], closed["velocity"])[0, 1]) >= CORRELATED
    return closed if damped else series


def _warming(series: TimeSeries, test: DynoTest) -> Warming:
    energy = float(energy_over_time(series)[-1])
    power = energy / series.duration
    if "temperature" not in series:
        none = Unknown("the record has no temperature")
        known = test.conditions.temperature
        return Warming(none if known is None else known, none, energy, power)
    tenth = max(1, len(series) // 10)
    return Warming(float(series["temperature"][:tenth].mean()), temperature_drift(series), energy, power)


def with_gas_of_slow_runs(entries: Sequence[Entry]) -> tuple[Entry, ...]:
    """Return the entries; fast runs have the gas force of a slow run of their setting subtracted, if there is one.

    The force of a fast sine at zero velocity is not its gas force, because it contains what the shock does not release
    at the ends of the stroke. A slow run of the same build, clicks and gas pressure shows the gas force.
    """
    slow = [entry for entry in entries if entry.kind == "run" and isinstance(entry.slow.gas_force, float)]
    found = []
    for entry in entries:
        same = [one for one in slow if _condition(one) == _condition(entry)]
        is_fast = entry.kind == "run" and isinstance(entry.slow.gas_force, Unknown)
        found.append(_without_gas(entry, same[0]) if is_fast and same else entry)
    return tuple(found)


def _condition(entry: Entry) -> tuple[object, ...]:
    return entry.setting.build, entry.setting.clicks, entry.setting.gas_pressure


def _without_gas(entry: Entry, slow: Entry) -> Entry:
    """Return a fast run without the gas force of a slow one, in the middle of its stroke, instead of its own offset."""
    gas, stiffness, own = slow.slow.gas_force, slow.slow.stiffness, entry.offset
    if not isinstance(own, float) or not isinstance(gas, float) or not isinstance(stiffness, float):
        return entry
    if isinstance(entry.curve, Unknown) or entry.branches is None:
        return entry
    assert entry.test is not None and slow.test is not None  # both are runs
    if "displacement" not in entry.test.series:
        return entry
    ends = [0.5 * float(one.series["displacement"].max() + one.series["displacement"].min())
            for one in (entry.test, slow.test)]  # fmt: skip
    level = gas + stiffness * (ends[0] - ends[1])
    curve = replace(entry.curve, force=entry.curve.force + own - level)
    branches = replace(entry.branches, opening=entry.branches.opening + own - level,
                       closing=entry.branches.closing + own - level)  # fmt: skip
    note = (
        f"gas: {level:.4g} N in the middle of the stroke, from the slow run {slow.name}, is subtracted; the force of "
        f"this run at zero velocity is {own:.4g} N"
    )
    return replace(entry, curve=curve, branches=branches, strokes=_strokes_of(curve), level=level,
                   notes=(*entry.notes, note))  # fmt: skip


_NO_TIME = Unknown("a peak-velocity table has no time")


def entry_of_table(table: PeakVelocityTable, name: str, build: str) -> Entry:
    """Return the entry of a peak-velocity table; see `entry_of_test` for the arguments."""
    curve = curve_of_table(table)
    no_gas = Unknown("the table shows no gas force: it has no points at zero speed and none near it, or no gas")
    gas: Found = table.gas_force if table.gas_source else no_gas
    no_time = SlowFigures(gas, _NO_TIME, _NO_TIME, _NO_TIME)
    notes = (f"the gas force was found from {table.gas_source}",) if table.gas_source else ()
    return Entry(
        "table", name, EntrySetting(build, table.clicks), table.source, table.sha256, curve, _strokes_of(curve),
        gas, gas, _NO_TIME, _NO_TIME, no_time, Warming(*(_NO_TIME,) * 4), notes=notes,
    )  # fmt: skip


# ---- Laws -----------------------------------------------------------------------------------------------------------

_NO_RECORD = Unknown("a law has no record; see its runs")


def entry_of_shock(shock: Shock, name: str, build: str, *, source: Path | None = None, sha256: str = "") -> Entry:
    """Return the entry of a fitted law; see `entry_of_test` for the arguments."""
    curve, port, known = curve_of_law(shock.law), shock.law.port, shock.conditions
    heat = _numbers(known.get("temperature_range [K]"))
    pressure, clicks = known.get("gas_pressure [Pa]"), known.get("clicks")
    setting = EntrySetting(
        build,
        str(clicks) if clicks else None,
        float(pressure) if isinstance(pressure, int | float) else None,
        float(np.mean(heat)) if heat is not None and heat.size else None,
    )
    lag = _time_constant(shock)
    estimates = (_estimate(known, "gas_preload_estimate [N]"), _estimate(known, "gas_stiffness_estimate [N/m]"))
    gas = SlowFigures(*estimates, port.seal_friction if port.seal_friction else Unknown("the law has no seal friction"),
                      _NO_RECORD)  # fmt: skip
    changes = tuple(str(change) for change in shock.fit.get("changes", ()) if isinstance(change, str))
    return Entry(
        "law", name, setting, source, sha256, curve, _strokes_of(curve), port.gas_preload, port.gas_preload, _NO_RECORD,
        lag, gas, Warming(*(_NO_RECORD,) * 4), shock=shock, band=_band(shock), notes=changes,
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


def _band(shock: Shock) -> ForceBand | None:
    """Return the band of the fit section; None if it is missing or has another form."""
    found = shock.fit.get("curve_band")
    if not isinstance(found, Mapping):
        return None
    columns = [_numbers(found.get(key)) for key in ("velocity [m/s]", "force [N]", "half_width [N]")]
    known = [column for column in columns if column is not None and column.size > 1]
    if len(known) < 3 or len({column.size for column in known}) > 1:
        return None
    velocity, force, half = known
    return ForceBand(velocity, force - half, force + half)


def _numbers(value: object) -> Array | None:
    """Return a list of finite numbers as an array (N,), None for anything else."""
    if not isinstance(value, (list, tuple)) or not all(type(item) in (int, float) for item in value):
        return None
    array = np.asarray(value, dtype=np.float64)
    return array if np.isfinite(array).all() else None
