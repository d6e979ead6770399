"""Static curves from peak-velocity tables, by monotone interpolation of the points."""

from __future__ import annotations

import re
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.interpolate import PchipInterpolator

from eightpost.array_types import Array
from eightpost.errors import InputError
from eightpost.ident.shock.curve import CurveBasis, split_coefficients
from eightpost.ident.shock.options import GasTreatment
from eightpost.ident.shock.record import TRANSITION_SPEED, TRANSITION_WIDTH
from eightpost.ident.shock.verdict import peak_velocity_validity
from eightpost.rig.peak_velocity import PeakVelocityTable, is_peak_velocity, read_peak_velocity
from eightpost.shock import Polylinear, Port, Shock, StaticCurve, write_shock
from eightpost.signals import read_records

#: Suffixes of files that may be a peak-velocity table.
_TEXT = (".csv", ".txt", ".tsv", ".dat", ".xlsx", ".xls", ".ods")

#: Number of speeds per side that determines a polynomial of the dissertation's order; with fewer it oscillates.
ENOUGH = 15

#: Number of points of the interpolant that the curve is refitted to, and the weight of a fall of the curve [1].
_POINTS, _FALL_PRICE = 801, 1e3
_ROUNDS = 40

#: The transition is at most at this share of the table's highest speed.
_TRANSITION_SHARE = 0.6
#: Deviation of the curve from the interpolant that is reported, as a share of the force's standard deviation.
_FAR = 0.02
#: Further transition speeds to try, as shares of the highest speed.
_SHARES = (0.1, 0.15, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8)


def fit_peak_velocity(table: PeakVelocityTable, *, name: str | None = None, gas: GasTreatment = "estimate") -> Shock:
    """Return a Polylinear shock whose curve interpolates the points of a table: force over speed, no dynamics.

    The points of both strokes and the origin are joined by a monotone cubic interpolant (Fritsch and Carlson), which
    does not oscillate. The curve of the shock file is then refitted to it, and its error is in the shock's fit section.

    Args:
        table: Table of one setting of the adjusters.
        name: Name of the shock; default the file's name, else the clicks.
        gas: `estimate` keeps the gas force of the table as gas preload; `included` leaves it out of the shock, because
            the static load of the car already counts it; `subtracted` treats it as a force of the valves, because the
            dynamometer already subtracted the gas force.
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
    joined = PchipInterpolator(velocity, force)
    basis, coefficients = _best_curve(joined, velocity)
    curve = _curve(basis, coefficients, joined, float(table.speed[-1]))
    at_points = np.array([curve.force(v) for v in velocity.tolist()]) - force
    grid = np.linspace(velocity[0], velocity[-1], _POINTS)
    between = basis.design(grid) @ coefficients - joined(grid)
    fit: dict[str, Any] = {
        "recipe": "peak velocity",
        "points": int(force.size),
        "rms [N]": float(np.sqrt(np.mean(at_points**2))),
        "greatest_error_at_points [N]": float(np.abs(at_points).max()),
        "rms_to_interpolant [N]": float(np.sqrt(np.mean(between**2))),
        "standard_deviation [N]": float(np.std(force)),
        "seconds": time.perf_counter() - started,
        "gas_force [N]": table.gas_force,
        "changes": [_why(table), *_gas_note(table, gas)],
        "warnings": _warnings(table, gas, at_points, force, float(np.sqrt(np.mean(between**2)) / np.std(force))),
    }
    conditions = {
        **({"clicks": table.clicks} if table.clicks else {}),
        "velocity_range [m/s]": [-float(table.speed[-1]), float(table.speed[-1])],
    }
    return Shock(
        name=name or (table.source.stem if table.source else table.clicks or "shock"),
        law=Polylinear(curve, port=Port(gas_preload=preload)),
        conditions=conditions,
        fit=fit,
        inputs=({"name": table.source.name, "sha256": table.sha256},) if table.source else (),
        validity=peak_velocity_validity(
            percent=100.0 * fit["rms [N]"] / fit["standard_deviation [N]"],
            points=force.size,
            doubts=fit["warnings"],
            conditions=conditions,
            origin=table.source.name if table.source else "a table in memory",
        ),
    )


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


def tables_in(files: Sequence[Path], units: Mapping[str, str]) -> tuple[PeakVelocityTable, ...]:
    """Return the tables of a peak-velocity file; empty if the files are records over time.

    Raises:
        InputError: A peak-velocity file is given together with other files.
    """
    tables = [path for path in files if path.suffix.lower() in _TEXT and is_peak_velocity(read_records(path)[0])]
    if tables and len(files) > 1:
        raise InputError(f"{tables[0]} is a peak-velocity table: fit it alone")
    return read_peak_velocity(tables[0], units=units) if tables else ()


def fit_tables(
    tables: Sequence[PeakVelocityTable],
    output: Path,
    *,
    name: str | None = None,
    build: str | None = None,
    gas: GasTreatment = "estimate",
) -> tuple[_FittedTable, ...]:
    """Fit and write a shock for each table of a file.

    Args:
        tables: Tables, one for each setting of the adjusters.
        output: Shock file; of several tables, each has the setting in its file name and its shock's name.
        name: Name of the shock.
        build: Team's own name for the shock build.
        gas: Treatment of the gas force; see `fit_peak_velocity`.
    """
    fitted = []
    for table in tables:
        shock, path = fit_peak_velocity(table, name=name, gas=gas), output
        if len(tables) > 1:
            shock = replace(shock, name=f"{shock.name} {table.clicks}" if table.clicks else shock.name)
            path = output.with_stem(f"{output.stem}_{_slug(table.clicks)}")
        shock = replace(shock, conditions=dict(shock.conditions) | ({"build": build} if build else {}))
        write_shock(shock, path)
        fitted.append(_FittedTable(table, shock, path))
    return tuple(fitted)


def _slug(clicks: str | None) -> str:
    return re.sub(r"[^A-Za-z0-9.+-]+", "_", clicks or "").strip("_") or "setting"


def _best_curve(joined: PchipInterpolator, velocity: Array) -> tuple[CurveBasis, Array]:
    """Return the curve closest to an interpolant, over the dissertation's transition speed and shares of the range."""
    fastest = float(velocity[-1])
    speeds = dict.fromkeys((min(TRANSITION_SPEED, _TRANSITION_SHARE * fastest), *(s * fastest for s in _SHARES)))
    bases = [CurveBasis(speed, TRANSITION_WIDTH * speed / TRANSITION_SPEED) for speed in speeds]
    fitted = [(basis, _refitted(basis, joined, velocity)) for basis in bases]
    grid = np.linspace(velocity[0], fastest, _POINTS)
    return min(fitted, key=lambda one: float(np.sum((one[0].design(grid) @ one[1] - joined(grid)) ** 2)))


def _refitted(basis: CurveBasis, joined: PchipInterpolator, knots: Array) -> Array:
    """Return coefficients (23,) [N] fitted to an interpolant, closest at its knots, constrained not to fall."""
    grid = np.linspace(knots[0], knots[-1], _POINTS)
    ties = basis.ties(compression="slope", rebound="slope")
    columns = np.vstack([basis.design(grid), np.sqrt(0.2 * _POINTS) * basis.design(knots)]) @ ties
    target = np.concatenate([joined(grid), np.sqrt(0.2 * _POINTS) * joined(knots)])
    size = np.linalg.norm(columns, axis=0)
    rises = np.diff(basis.design(grid) @ ties / size, axis=0)
    expected = np.diff(joined(grid)) >= 0.0
    free = np.linalg.lstsq(columns / size, target, rcond=1e-12)[0]
    held = np.zeros(rises.shape[0], dtype=bool)
    for _ in range(_ROUNDS):
        falling = expected & (rises @ free < 0.0)
        if not (falling & ~held).any():
            break
        held |= falling
        stiff = _FALL_PRICE * rises[held]
        free = np.linalg.lstsq(
            np.vstack([columns / size, stiff]), np.append(target, np.full(held.sum(), 1e-3)), rcond=1e-12
        )[0]
    return np.asarray(ties @ (free / size))


def _curve(basis: CurveBasis, coefficients: Array, joined: PchipInterpolator, fastest: float) -> StaticCurve:
    inner, compression, rebound = split_coefficients(coefficients)
    high, low = (max(float(joined(end, 1)), 0.0) for end in (fastest, -fastest))
    return StaticCurve(
        inner, compression, rebound, basis.transition_speed, basis.transition_width, fastest, fastest, high, low
    )


def _why(table: PeakVelocityTable) -> str:
    return f"{len(table)} speeds per side are joined by a monotone interpolant" + (
        f" and not by a polynomial of order 15, which needs {ENOUGH} or more" if len(table) < ENOUGH else ""
    )


def _gas_note(table: PeakVelocityTable, gas: GasTreatment) -> list[str]:
    if not table.gas_force:
        return []
    found = f"a gas force of {table.gas_force:.4g} N, found from {table.gas_source}, is not part of the curve"
    if gas == "included":
        return [f"{found} and is left out of the shock (--gas included)"]
    return [f"{found} but of the gas preload; if the dynamometer already subtracted the gas force: --gas subtracted"]


def _warnings(table: PeakVelocityTable, gas: GasTreatment, errors: Array, force: Array, between: float) -> list[str]:
    found = _gas_note(table, gas) if gas == "estimate" else []
    for side, sign in (("compression", 1.0), ("rebound", -1.0)):
        falls = np.flatnonzero(np.diff(sign * np.append(0.0, getattr(table, side))) < 0.0)
        if falls.size:
            speeds = ", ".join(f"{table.speed[i]:.4g}" for i in falls.tolist())
            found.append(f"the {side} force does not rise at {speeds} m/s: check this row")
    if between > _FAR:
        found.append(
            f"between the points, the curve deviates from their monotone interpolant by {100.0 * between:.2g} % of the "
            "force's standard deviation (RMS): the polynomials of a shock file cannot follow this table"
        )
    if np.abs(errors).max() > 0.02 * float(np.abs(force).max()):
        found.append(f"the curve misses a point of the table by {np.abs(errors).max():.3g} N")
    return found
