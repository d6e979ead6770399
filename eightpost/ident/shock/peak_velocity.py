"""Static curves from peak-velocity tables, of one build or of several builds of a shock."""

from __future__ import annotations

import re
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from eightpost.array_types import Array
from eightpost.errors import DataError, InputError
from eightpost.ident.shock.curve import MOST_POINTS, curve_forces, curve_through, held
from eightpost.ident.shock.force import GasTreatment
from eightpost.ident.shock.verdict import POINTS, BuildSpread, peak_velocity_validity, side_scales
from eightpost.rig.peak_velocity import GAS_SHARE, PeakVelocityTable, peak_velocity_tables
from eightpost.shock import Polylinear, Port, Shock, write_shock
from eightpost.shock.curve import KNOTS
from eightpost.signals import ChannelMap
from eightpost.validity import judged

# ---- The monotone interpolant of the points -------------------------------------------------------------------------

#: Number of velocities at which the curve is compared with the interpolant of all points.
_PLACES = 801

#: Deviation of the curve from the interpolant that is reported, as a share of the force's standard deviation.
_FAR = 0.02


#: A table whose forces are all below this one [N] has no curve.
_NO_FORCE = 1e-6


def fit_peak_velocity(table: PeakVelocityTable, *, name: str | None = None, gas: GasTreatment = "estimate") -> Shock:
    """Return a Polylinear shock whose curve interpolates the points of a table: force over speed, no dynamics.

    The points of both strokes and the origin are joined by a monotone cubic interpolant (Fritsch and Carlson), which
    does not oscillate. With up to 12 speeds it is the curve of the shock file; for more see `curve_through`. Where the
    points fall, the curve is held level between them; a warning states the speeds and the change of force. The
    deviation from the points and from the interpolant is in the shock's fit section.

    Args:
        table: Table of one setting of the adjusters.
        name: Name of the shock; default the file's name, else the clicks.
        gas: `estimate` keeps the gas force of the table as gas preload; `included` leaves it out of the shock, because
            the static load of the car already counts it; `subtracted` treats it as a force of the valves, because the
            dynamometer already subtracted the gas force.

    Raises:
        DataError: All forces are zero.
    """
    started = time.perf_counter()
    if gas == "subtracted":
        table = replace(
            table, compression=table.compression + table.gas_force, rebound=table.rebound + table.gas_force,
            gas_force=0.0, gas_source="",
        )  # fmt: skip
    preload = table.gas_force if gas == "estimate" else 0.0
    velocity = np.concatenate([-table.speed[::-1], [0.0], table.speed])
    force = np.concatenate([table.rebound[::-1], [0.0], table.compression])
    if np.abs(force).max() < _NO_FORCE:
        what = "all forces are 0 N, so there is no curve; check the columns of force and their signs"
        raise DataError(what, path=table.source, channel="force")
    rising = held(velocity, force)
    curve, joined = curve_through(velocity, rising)
    at_points = curve_forces(curve, velocity) - force
    grid = np.linspace(velocity[0], velocity[-1], _PLACES)
    between = curve_forces(curve, grid) - joined(grid)
    fit: dict[str, Any] = {
        "recipe": "peak velocity",
        "points": int(force.size),
        "rms [N]": float(np.sqrt(np.mean(at_points**2))),
        "greatest_error_at_points [N]": float(np.abs(at_points).max()),
        "rms_to_interpolant [N]": float(np.sqrt(np.mean(between**2))),
        "standard_deviation [N]": float(np.std(force)),
        "seconds": time.perf_counter() - started,
        "gas_force [N]": table.gas_force,
        "changes": [*table.notes, _why(table), *_gas_note(table, gas)],
        "warnings": _warnings(table, gas, at_points, force, rising, _share(between, force)),
    }
    conditions = {
        **({"clicks": table.clicks} if table.clicks else {}),
        "velocity_range [m/s]": [-float(table.speed[-1]), float(table.speed[-1])],
    }
    shock = Shock(
        name=name or (table.source.stem if table.source else table.clicks or "shock"),
        law=Polylinear(curve, port=Port(gas_preload=preload)),
        conditions=conditions,
        fit=fit,
        inputs=({"name": table.source.name, "sha256": table.sha256},) if table.source else (),
        validity=peak_velocity_validity(
            percent=100.0 * _share(at_points, force),
            points=force.size,
            doubts=fit["warnings"],
            conditions=conditions,
            origin=table.source.name if table.source else "a table in memory",
        ),
    )
    return judged(shock)


def _share(error: Array, force: Array) -> float:
    """Return the RMS of an error as a share of the standard deviation of the force."""
    return float(np.sqrt(np.mean(error**2)) / np.std(force))


@dataclass(frozen=True, slots=True)
class _FittedTable:
    """A table of one setting of the adjusters, its shock, and the shock file."""

    table: PeakVelocityTable
    shock: Shock
    path: Path

    def __str__(self) -> str:
        fit = self.shock.fit
        return (
            f"{self.shock.name}: {len(self.table)} speeds on each side, up to {self.table.speed[-1]:.4g} m/s; the "
            f"curve deviates from its points by at most {fit['greatest_error_at_points [N]']:.3g} N, "
            f"{fit['rms [N]']:.3g} N RMS"
        )


def tables_in(
    files: Sequence[Path], units: Mapping[str, str], channel_map: ChannelMap | None = None
) -> tuple[PeakVelocityTable, ...]:
    """Return the tables of a peak-velocity file; empty if the files are records over time.

    Raises:
        InputError: A peak-velocity file is given together with other files.
    """
    found = [tables for path in files if (tables := peak_velocity_tables(path, units=units, channel_map=channel_map))]
    if found and len(files) > 1:
        what = "fit it alone, or give each table its build (--build FILE=NAME)"
        raise InputError(f"{found[0][0].source} is a peak-velocity table: {what}")
    return found[0] if found else ()


def fit_tables(
    tables: Sequence[PeakVelocityTable],
    output: Path,
    *,
    name: str | None = None,
    build: str | None = None,
    gas: GasTreatment = "estimate",
) -> tuple[_FittedTable, ...]:
    """Fit and write a shock for each table of a file."""
    fitted = []
    for table in tables:
        shock, path = fit_peak_velocity(table, name=name, gas=gas), output
        if len(tables) > 1:
            shock = replace(shock, name=f"{shock.name} {table.clicks}" if table.clicks else shock.name)
            setting = re.sub(r"[^A-Za-z0-9.+-]+", "_", table.clicks or "").strip("_") or "setting"
            path = output.with_stem(f"{output.stem}_{setting}")
        shock = replace(shock, conditions=dict(shock.conditions) | ({"build": build} if build else {}))
        write_shock(shock, path)
        fitted.append(_FittedTable(table, shock, path))
    return tuple(fitted)


def _why(table: PeakVelocityTable) -> str:
    if len(table) <= MOST_POINTS:
        return f"{len(table)} speeds per side are joined by a monotone interpolant, which passes through every point"
    return (
        f"{len(table)} speeds per side are joined by a monotone interpolant; on each side the curve passes through the "
        f"{MOST_POINTS} of them from which it follows the interpolant best"
    )


def _gas_note(table: PeakVelocityTable, gas: GasTreatment) -> list[str]:
    if not table.gas_force:
        return []
    found = f"a gas force of {table.gas_force:.4g} N, found from {table.gas_source}, is not part of the curve"
    if gas == "included":
        return [f"{found} and is left out of the shock (--gas included)"]
    return [f"{found} but of the gas preload; if the dynamometer already subtracted the gas force: --gas subtracted"]


def _warnings(
    table: PeakVelocityTable, gas: GasTreatment, errors: Array, force: Array, rising: Array, between: float
) -> list[str]:
    found = _gas_note(table, gas) if gas == "estimate" else []
    if table.rest_force < -GAS_SHARE * float(np.abs(force).max()):
        found.append(
            f"the force at zero speed is {table.rest_force:.4g} N, although gas pushes: either the load cell was "
            "zeroed with the gas force on it, or all signs are reversed and compression and rebound are swapped"
        )
    for side, sign, here in (("rebound", -1.0, slice(len(table))), ("compression", 1.0, slice(len(table) + 1, None))):
        falls = np.flatnonzero(np.diff(sign * np.append(0.0, getattr(table, side))) < 0.0).tolist()
        if falls:
            rows = ", ".join(f"{table.speed[i]:.4g} m/s ({getattr(table, side)[i]:.4g} N)" for i in falls)
            change = float(np.abs(rising - force)[here].max())
            found.append(
                f"{side} falls towards {rows}: the curve is held level there and differs from the table by up "
                f"to {change:.3g} N, {100.0 * change / float(np.abs(force).max()):.2g} % of the largest force; check "
                "these rows"
            )
    if between > _FAR:
        found.append(
            f"between the points, the curve deviates from their monotone interpolant by {100.0 * between:.2g} % of the "
            f"force's standard deviation (RMS): {KNOTS} knots cannot follow this table"
        )
    if np.abs(errors + force - rising).max() > 0.02 * float(np.abs(force).max()):
        found.append(f"the curve misses a point of the table by {np.abs(errors).max():.3g} N")
    return found


# ---- Several builds: their mean curve, and the spread between them --------------------------------------------------


def builds_in(
    files: Sequence[Path], units: Mapping[str, str], builds: Mapping[Path, str], channel_map: ChannelMap | None = None
) -> dict[str, tuple[PeakVelocityTable, ...]]:
    """Return the tables of each build if the files are peak-velocity tables of several builds; else nothing.

    Raises:
        InputError: A file has no build, is no table, or has several settings of the adjusters.
    """
    if len(set(builds.values())) < 2:
        return {}
    tables_of = {file: peak_velocity_tables(file, units=units, channel_map=channel_map) for file in files}
    if not any(tables_of.values()):
        return {}
    found: dict[str, tuple[PeakVelocityTable, ...]] = {}
    for file in files:
        if file not in builds:
            raise InputError(f"{file} has no build, but other tables have one: add --build {file.name}=NAME")
        if not (tables := tables_of[file]):
            raise InputError(f"{file} is not a peak-velocity table, but others are: fit records and tables separately")
        if len(tables) > 1:
            settings = ", ".join(table.clicks or "unnamed" for table in tables)
            raise InputError(f"{file} has {len(tables)} settings ({settings}): give one setting of each build")
        found[builds[file]] = (*found.get(builds[file], ()), *tables)
    return found


def fit_builds(
    tables: Mapping[str, Sequence[PeakVelocityTable]], *, name: str | None = None, gas: GasTreatment = "estimate"
) -> tuple[Shock, BuildSpread]:
    """Return the Polylinear shock of the mean of several builds, and the spread between the builds.

    Each build counts once, with the mean of its tables. A table states no error of its own, so what two tests of one
    build differ by is part of the spread.

    Raises:
        InputError: The speeds of the tables do not overlap.
    """
    means = {build: mean_table(own) for build, own in tables.items()}
    common = mean_table(tuple(means.values()))
    shock = fit_peak_velocity(common, name=name, gas=gas)
    alone = [fit_peak_velocity(table, gas=gas) for table in means.values()]
    velocity = np.linspace(-common.speed[-1], common.speed[-1], POINTS)
    force = np.array([curve_forces(one.law.curve, velocity) for one in alone])
    preloads = np.array([one.law.port.gas_preload for one in alone])
    spread = BuildSpread(
        builds=tuple(means),
        runs=tuple(len(own) for own in tables.values()),
        velocity=velocity,
        force=force,
        deviation=np.std(force, axis=0, ddof=1),
        scales=side_scales(force, curve_forces(shock.law.curve, velocity), velocity),
        parameters={"gas_preload": (preloads, "N")},
        notes=("tables have no error of their own: what two tests of one build differ by is part of the spread",),
    )
    inputs = tuple({"name": t.source.name, "sha256": t.sha256} for own in tables.values() for t in own if t.source)
    fit = dict(shock.fit) | {"between_builds": spread.to_json()}
    return judged(shock, fit=fit, inputs=inputs), spread


def mean_table(tables: Sequence[PeakVelocityTable]) -> PeakVelocityTable:
    """Return the mean of tables at all speeds that they share, interpolated linearly.

    Raises:
        InputError: Their speeds do not overlap.
    """
    if len(tables) == 1:
        return tables[0]
    low, high = max(table.speed[0] for table in tables), min(table.speed[-1] for table in tables)
    speeds = np.unique(np.concatenate([table.speed for table in tables]))
    speeds = speeds[(speeds >= low) & (speeds <= high)]
    if speeds.size < 2:
        names = ", ".join(table.source.name for table in tables if table.source)
        raise InputError(f"the speeds of the tables {names} do not overlap: {low:.3g} to {high:.3g} m/s")

    def mean(name: str) -> Array:
        return np.asarray(np.mean([np.interp(speeds, table.speed, getattr(table, name)) for table in tables], axis=0))

    gas = float(np.mean([table.gas_force for table in tables]))
    sources = list(dict.fromkeys(table.gas_source for table in tables if table.gas_source))
    return replace(
        tables[0], speed=speeds, compression=mean("compression"), rebound=mean("rebound"), gas_force=gas,
        gas_source="; ".join(sources),
    )  # fmt: skip
