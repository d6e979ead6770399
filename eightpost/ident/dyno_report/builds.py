"""Builds of a report with their clicks, their comparison, the corners of a car, and the report as a whole."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import takewhile
from math import sqrt
from pathlib import Path

import numpy as np

from eightpost.array_types import Array
from eightpost.corners import CORNERS
from eightpost.errors import InputError, ParameterError
from eightpost.ident.dyno_report.curve import Stroke, forces_at
from eightpost.ident.dyno_report.entry import Entry
from eightpost.ident.dyno_report.found import Found, Unknown, known, mean_of
from eightpost.ident.dyno_report.limits import Judgement, Limits, judgements
from eightpost.rig.runs import TemperatureEffect, temperature_effect
from eightpost.units import convert
from eightpost.vehicle import QuarterCar, StructuralVehicle, read_vehicle

#: Minimum share of the highest speed of a build's entries for an entry to represent it.
FAST = 0.9
#: Runs repeat each other if the standard deviations of their velocities agree within this share.
ALIKE = 0.05
#: Speeds of the tables [m/s] unless others are given: 1 to 20 in/s, as far as any curve goes.
SPEEDS = tuple(float(convert(speed, "in/s", "m/s")) for speed in (1.0, 2.0, 3.0, 5.0, 10.0, 15.0, 20.0))
#: Names are shortened if one has more letters than this.
LONG_NAME = 20


def short_names(names: Iterable[str]) -> dict[str, str]:
    """Return names without their common beginning, up to a separator, if one of them is long.

    >>> short_names(["ohlins_t1_18_18_s5_150psi", "ohlins_t1_24_24_s5_100psi"])
    {'ohlins_t1_18_18_s5_150psi': '18_18_s5_150psi', 'ohlins_t1_24_24_s5_100psi': '24_24_s5_100psi'}
    """
    names = list(dict.fromkeys(names))
    letters = zip(*names, strict=False) if len(names) > 1 and max(map(len, names)) > LONG_NAME else ()
    common = "".join(column[0] for column in takewhile(lambda column: len(set(column)) == 1, letters))
    cut = max(common.rfind(separator) for separator in "_- .") + 1
    return {name: name[cut:] for name in names}


# ---- Variants: builds with their clicks -----------------------------------------------------------------------------


@dataclass(frozen=True, slots=True, eq=False)
class Variant:
    """A build at one setting of the adjusters."""

    #: Display name: the build in short, and the clicks if the report has several of this build.
    label: str
    #: Name of the build.
    build: str
    #: Entries in the order of the files.
    entries: tuple[Entry, ...]

    @property
    def runs(self) -> tuple[Entry, ...]:
        """Runs of this build."""
        return tuple(entry for entry in self.entries if entry.kind == "run")

    def of_basis(self, basis: str) -> tuple[Entry, ...]:
        """Return the entries that are `measured`, or laws."""
        return tuple(entry for entry in self.entries if (entry.kind == "law") == (basis == "law"))

    def representatives(self, basis: str) -> tuple[Entry, ...]:
        """Return the entries of a basis that reach 90 % of the highest speed among them."""
        found = self.of_basis(basis)
        highest = max((entry.highest for entry in found), default=0.0)
        return tuple(entry for entry in found if entry.highest >= FAST * highest)


def variants_of(entries: Sequence[Entry]) -> tuple[Variant, ...]:
    """Return the builds with their clicks; a law without clicks belongs to the clicks of its build if there is one."""
    stated: dict[str, list[str | None]] = {}
    for entry in entries:
        known = stated.setdefault(entry.setting.build, [])
        if entry.setting.clicks not in known:
            known.append(entry.setting.clicks)
    groups: dict[tuple[str, str | None], list[Entry]] = {}
    for entry in entries:
        build, clicks = entry.setting.build, entry.setting.clicks
        named = [one for one in stated[build] if one is not None]
        if entry.kind == "law" and clicks is None and len(named) == 1:
            clicks = named[0]
        groups.setdefault((build, clicks), []).append(entry)
    several = {build for build, _ in groups if sum(key[0] == build for key in groups) > 1}
    short = short_names(stated)
    return tuple(
        Variant(f"{short[build]}, {clicks or 'clicks not stated'}" if build in several else short[build], build,
                tuple(found))
        for (build, clicks), found in groups.items()
    )  # fmt: skip


def mean_force(entries: Iterable[Entry], speed: float, stroke: Stroke) -> Found:
    """Return the mean force magnitude [N] of the entries that reach a speed [m/s]."""
    return mean_of(forces_at(entry.curve, speed, stroke) for entry in entries)


def repeated_runs(variant: Variant) -> tuple[tuple[Entry, ...], ...]:
    """Return the groups of two or more runs with the same gas pressure and standard deviations of velocity."""
    groups: list[list[Entry]] = []
    for entry in sorted(variant.runs, key=_motion):
        if groups and _motion(entry) <= (1.0 + ALIKE) * _motion(groups[-1][0]):
            groups[-1].append(entry)
        else:
            groups.append([entry])
    same: list[tuple[Entry, ...]] = []
    for group in groups:
        for pressure in dict.fromkeys(entry.setting.gas_pressure for entry in group):
            same.append(tuple(entry for entry in group if entry.setting.gas_pressure == pressure))
    return tuple(group for group in same if len(group) > 1)


def deviation_of(group: Iterable[Entry], speed: float, stroke: Stroke) -> Found:
    """Return the standard deviation of the forces [N] of runs at a speed [m/s]."""
    forces = known(forces_at(entry.curve, speed, stroke) for entry in group)
    return float(np.std(forces, ddof=1)) if len(forces) > 1 else Unknown("fewer than two runs reach this speed")


def _motion(entry: Entry) -> float:
    return float(entry.test.series["velocity"].std()) if entry.test else 0.0


def heat_effect(variant: Variant) -> TemperatureEffect | None:
    """Return the change of force with temperature over the repeated runs of a variant; None without them."""
    return temperature_effect(entry.test for entry in variant.runs if entry.test)


# ---- Corners of a car -----------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class CarCorner:
    """A corner of a car; a ParameterError is raised if a value is not positive."""

    name: str
    #: Sprung mass on the corner [kg].
    mass: float
    #: Rate of the suspension at the wheel [N/m].
    wheel_rate: float
    #: Damper travel per wheel travel [1].
    motion_ratio: float = 1.0

    def __post_init__(self) -> None:
        for what, value, option in (
            ("sprung mass", self.mass, "--corner-mass"),
            ("wheel rate", self.wheel_rate, "--wheel-rate"),
            ("motion ratio", self.motion_ratio, "--motion-ratio"),
        ):
            if not value > 0.0:
                raise ParameterError(f"{self.name}: the {what} must be above 0, not {value:g}; correct {option}")

    def damping_ratio(self, rate: Found) -> Found:
        """Return c r^2 / (2 sqrt(k m)) [1] of a damping rate c at the damper [N.s/m].

        The tire is rigid in this equation, and the damper moves r times as far as the wheel.

        Args:
            rate: Damping rate at the damper [N.s/m].
        """
        if isinstance(rate, Unknown):
            return rate
        return rate * self.motion_ratio**2 / (2.0 * sqrt(self.wheel_rate * self.mass))


def corners_of_car(path: Path, motion_ratio: float = 1.0) -> tuple[CarCorner, ...]:
    """Return the corners of a car file: one of a quarter car, four of a seven-DOF car with the static weight of each.

    Args:
        path: Vehicle file (.toml) with masses and rates.
        motion_ratio: Damper travel per wheel travel [1].

    Raises:
        InputError: The file is an identified model, which has no separate masses and rates.
    """
    vehicle = read_vehicle(path)
    if not isinstance(vehicle, StructuralVehicle):
        raise InputError(
            f"{path} is an identified model without separate masses and wheel rates; give a .toml file, or "
            "--corner-mass and --wheel-rate"
        )
    found = vehicle.parameters
    if isinstance(found, QuarterCar):
        return (CarCorner(vehicle.name, found.sprung_mass, found.suspension_stiffness, motion_ratio),)
    front = 0.5 * found.sprung_mass * found.cg_to_rear_axle / found.wheelbase
    rear = 0.5 * found.sprung_mass * found.cg_to_front_axle / found.wheelbase
    masses = (front, front, rear, rear)
    return tuple(
        CarCorner(corner, mass, rate, motion_ratio)
        for corner, mass, rate in zip(CORNERS, masses, found.spring_rate, strict=True)
    )


# ---- The report -----------------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True, eq=False)
class DynoReport:
    """Content of a report."""

    #: Runs, tables and laws.
    entries: tuple[Entry, ...]
    #: Builds with their clicks; the reference is the first.
    variants: tuple[Variant, ...]
    #: Speeds of the tables [m/s].
    speeds: tuple[float, ...]
    #: Corners for damping ratios.
    corners: tuple[CarCorner, ...] = ()
    #: Build of corners of the car: a name for each corner.
    fitted_to: Mapping[str, str] = field(default_factory=dict)
    #: Curve with tolerances that the measured curves must meet.
    limits: Limits | None = None
    #: Velocities of the shaft on a track (N,) [m/s] by name of the file.
    track: Mapping[str, Array] = field(default_factory=dict)

    @property
    def judgements(self) -> tuple[Judgement, ...]:
        """Strokes of runs and tables, judged by the limits; nothing without limits."""
        return () if self.limits is None else tuple(judgements(self.limits, self.entries, self.speeds))

    @property
    def unjudged(self) -> tuple[str, ...]:
        """Names of runs and tables without a curve at a speed of the master; of laws if there is nothing else."""
        judged = {one.entry.name for one in self.judgements}
        measured = [entry for entry in self.entries if entry.kind != "law"] or self.entries
        return tuple(entry.name for entry in measured if self.limits is not None and entry.name not in judged)

    @property
    def runs(self) -> tuple[Entry, ...]:
        """Runs of all variants."""
        return tuple(entry for entry in self.entries if entry.kind == "run")


def dyno_report(
    entries: Sequence[Entry],
    *,
    speeds: Sequence[float] = (),
    corners: Sequence[CarCorner] = (),
    fitted_to: Mapping[str, str] | None = None,
    limits: Limits | None = None,
    track: Mapping[str, Array] | None = None,
) -> DynoReport:
    """Return the report of entries.

    Args:
        entries: Runs, tables and laws.
        speeds: Speeds of the tables [m/s]; default 1 to 20 in/s as far as any curve goes.
        corners: Corners for damping ratios.
        fitted_to: Build of corners of the car.
        limits: Curve with tolerances for the measured curves.
        track: Velocities of the shaft on a track [m/s] by name of the file.

    Raises:
        InputError: A name is not a build of the report, or a speed is not positive.
    """
    variants = variants_of(entries)
    fitted = dict(fitted_to or {})
    for corner, build in fitted.items():
        if not any(build in (v.label, v.build) for v in variants):
            raise InputError(f"--corner {corner}={build}: {build!r} is not one of the builds: {_listed(variants)}")
    if wrong := [speed for speed in speeds if not speed > 0.0]:
        raise InputError(f"--speed must be above 0, not {wrong[0]:g} m/s")
    reached = max((entry.highest for entry in entries), default=0.0)
    shown = tuple(sorted(set(speeds))) or tuple(speed for speed in SPEEDS if speed <= reached) or SPEEDS[:1]
    return DynoReport(tuple(entries), variants, shown, tuple(corners), fitted, limits, dict(track or {}))


def _listed(variants: Sequence[Variant]) -> str:
    return ", ".join(dict.fromkeys(name for variant in variants for name in (variant.build, variant.label)))
