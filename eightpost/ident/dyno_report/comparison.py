"""Comparison of builds with the reference, and repeatability of the runs of one build."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from eightpost.ident.dyno_report.builds import DynoReport, Variant
from eightpost.ident.dyno_report.entry import Entry
from eightpost.ident.dyno_report.found import Found, Unknown, known, mean_of
from eightpost.ident.dyno_report.velocity_curve import STROKES, Stroke, forces_at
from eightpost.rig.temperature import TemperatureEffect, temperature_effect

#: Runs repeat each other if the standard deviations of their velocities agree within this share.
ALIKE = 0.05

# ---- Differences from the reference ---------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Difference:
    """Force of a variant and of the reference at a speed, from curves of the same kind.

    Attributes:
        variant: Label of the variant.
        basis: Source of both forces, measured or law.
        stroke: Stroke.
        speed: Speed [m/s].
        force: Force of the variant [N].
        reference: Force of the reference [N].
    """

    variant: str
    basis: str
    stroke: Stroke
    speed: float
    force: Found
    reference: Found

    @property
    def change(self) -> Found:
        """Force minus that of the reference [N]."""
        if isinstance(self.force, Unknown):
            return self.force
        return self.reference if isinstance(self.reference, Unknown) else self.force - self.reference

    @property
    def percent(self) -> Found:
        """Change in percent of the reference's force."""
        change = self.change
        if isinstance(change, Unknown) or isinstance(self.reference, Unknown):
            return change
        return 100.0 * change / self.reference if self.reference else Unknown("the reference's force is 0")


def differences(report: DynoReport) -> tuple[Difference, ...]:
    """Return the differences of all variants from the reference: means of measured curves, and of laws."""
    found = []
    for variant in report.variants[1:]:
        for basis in ("measured", "law"):
            ours, base = representatives(variant, basis), representatives(report.reference, basis)
            if ours and base:
                found += [
                    Difference(variant.label, basis, stroke, speed, mean_force(ours, speed, stroke),
                               mean_force(base, speed, stroke))
                    for stroke in STROKES for speed in report.speeds
                ]  # fmt: skip
    return tuple(found)


def representatives(variant: Variant, basis: str) -> tuple[Entry, ...]:
    """Return the fastest entries of a variant, either `measured` ones or laws."""
    return variant.fastest("run", "table") if basis == "measured" else variant.fastest("law")


def mean_force(entries: Iterable[Entry], speed: float, stroke: Stroke) -> Found:
    """Return the mean force magnitude [N] of the entries that reach a speed [m/s]."""
    return mean_of(forces_at(entry.curve, speed, stroke) for entry in entries)


# ---- Repeatability --------------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Repeat:
    """Repeatability of runs of one variant.

    Attributes:
        variant: Label of the variant.
        runs: Names of the runs that repeat each other.
        stroke: Stroke.
        speed: Speed [m/s].
        mean: Mean force [N].
        deviation: Standard deviation of the runs' forces [N].
        spread: Largest force minus the smallest [N].
    """

    variant: str
    runs: tuple[str, ...]
    stroke: Stroke
    speed: float
    mean: Found
    deviation: Found
    spread: Found


def repeats(report: DynoReport) -> tuple[Repeat, ...]:
    """Return the repeatability at the report's speeds of runs with the same build, clicks, gas pressure and motion."""
    found = []
    for variant in report.variants:
        for group in repeated_runs(variant):
            names = tuple(entry.name for entry in group)
            for stroke in STROKES:
                for speed in report.speeds:
                    forces = known(forces_at(entry.curve, speed, stroke) for entry in group)
                    if len(forces) > 1:
                        mean, deviation = float(np.mean(forces)), float(np.std(forces, ddof=1))
                        spread = float(np.ptp(forces))
                        found.append(Repeat(variant.label, names, stroke, speed, mean, deviation, spread))
    return tuple(found)


def repeated_runs(variant: Variant) -> tuple[tuple[Entry, ...], ...]:
    """Return the groups of two or more runs with the same gas pressure and standard deviations of velocity."""
    groups: list[list[Entry]] = []
    for entry in sorted(variant.of_kind("run"), key=_motion):
        if groups and _motion(entry) <= (1.0 + ALIKE) * _motion(groups[-1][0]):
            groups[-1].append(entry)
        else:
            groups.append([entry])
    same: list[tuple[Entry, ...]] = []
    for group in groups:
        for pressure in dict.fromkeys(entry.setting.gas_pressure for entry in group):
            same.append(tuple(entry for entry in group if entry.setting.gas_pressure == pressure))
    return tuple(group for group in same if len(group) > 1)


def _motion(entry: Entry) -> float:
    return float(entry.series["velocity"].std()) if entry.series else 0.0


def heat_effect(variant: Variant) -> TemperatureEffect | None:
    """Return the change of force with temperature over the repeated runs of a variant; None without them."""
    return temperature_effect(entry.test for entry in variant.of_kind("run") if entry.test)
