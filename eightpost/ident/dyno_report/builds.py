"""Builds of a report with their clicks, and the report as a whole."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from eightpost.errors import InputError
from eightpost.ident.dyno_report.corner import CarCorner
from eightpost.ident.dyno_report.entry import Entry, Kind
from eightpost.units import convert

#: Minimum share of the highest speed of a build's entries for an entry to represent it.
FAST = 0.9
#: Speeds of the tables [m/s] unless others are given: 1 to 20 in/s, as far as any curve goes.
SPEEDS = tuple(float(convert(speed, "in/s", "m/s")) for speed in (1.0, 2.0, 3.0, 5.0, 10.0, 15.0, 20.0))


# ---- Variants: builds with their clicks -----------------------------------------------------------------------------


@dataclass(frozen=True, slots=True, eq=False)
class Variant:
    """A build at one setting of the adjusters.

    Attributes:
        label: Display name: the build, and the clicks if the report has several of this build.
        build: Name of the build.
        entries: Entries in the order of the files.
    """

    label: str
    build: str
    entries: tuple[Entry, ...]

    def of_kind(self, *kinds: Kind) -> tuple[Entry, ...]:
        """Return the entries of the given kinds."""
        return tuple(entry for entry in self.entries if entry.kind in kinds)

    def fastest(self, *kinds: Kind) -> tuple[Entry, ...]:
        """Return the entries of the given kinds that reach 90 % of the highest speed among them."""
        found = self.of_kind(*kinds)
        highest = max((entry.highest for entry in found), default=0.0)
        return tuple(entry for entry in found if entry.highest >= FAST * highest)

    @property
    def measured(self) -> tuple[Entry, ...]:
        """Runs and tables."""
        return self.of_kind("run", "table")


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
    return tuple(
        Variant(f"{build}, {clicks or 'clicks not stated'}" if build in several else build, build, tuple(found))
        for (build, clicks), found in groups.items()
    )


# ---- The report -----------------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True, eq=False)
class DynoReport:
    """Content of a report.

    Attributes:
        entries: Runs, tables and laws.
        variants: Builds with their clicks; the reference is the first.
        speeds: Speeds of the tables [m/s].
        corners: Corners for damping ratios.
        fitted_to: Build of corners of the car: a name for each corner.
        every_speed: Whether tables also have the speeds that an entry does not reach, because the user chose them.
    """

    entries: tuple[Entry, ...]
    variants: tuple[Variant, ...]
    speeds: tuple[float, ...]
    corners: tuple[CarCorner, ...] = ()
    fitted_to: Mapping[str, str] = field(default_factory=dict)
    every_speed: bool = False

    def speeds_of(self, entry: Entry) -> tuple[float, ...]:
        """Return the speeds [m/s] of an entry's rows."""
        return tuple(speed for speed in self.speeds if self.every_speed or speed <= entry.highest)

    @property
    def reference(self) -> Variant:
        """Variant with which the others are compared."""
        return self.variants[0]

    @property
    def runs(self) -> tuple[Entry, ...]:
        """Runs of all variants."""
        return tuple(entry for entry in self.entries if entry.kind == "run")


def dyno_report(
    entries: Sequence[Entry],
    *,
    reference: str | None = None,
    speeds: Sequence[float] = (),
    corners: Sequence[CarCorner] = (),
    fitted_to: Mapping[str, str] | None = None,
) -> DynoReport:
    """Return the report of entries.

    Args:
        entries: Runs, tables and laws.
        reference: Build, or build with clicks as in the report; default the first.
        speeds: Speeds of the tables [m/s]; default 1 to 20 in/s as far as any curve goes.
        corners: Corners for damping ratios.
        fitted_to: Build of corners of the car.

    Raises:
        InputError: A name is not a build of the report, or a speed is not positive.
    """
    variants = list(variants_of(entries))
    if reference is not None:
        chosen = next((v for v in variants if reference in (v.label, v.build)), None)
        if chosen is None:
            raise InputError(f"--reference {reference!r} is not one of the builds: {_listed(variants)}")
        variants.sort(key=lambda variant: (variant is not chosen, variant.build != chosen.build))
    fitted = dict(fitted_to or {})
    for corner, build in fitted.items():
        if not any(build in (v.label, v.build) for v in variants):
            raise InputError(f"--corner {corner}={build}: {build!r} is not one of the builds: {_listed(variants)}")
    if wrong := [speed for speed in speeds if not speed > 0.0]:
        raise InputError(f"--speed must be above 0, not {wrong[0]:g} m/s")
    reached = max((entry.highest for entry in entries), default=0.0)
    shown = tuple(sorted(set(speeds))) or tuple(speed for speed in SPEEDS if speed <= reached) or SPEEDS[:1]
    return DynoReport(tuple(entries), tuple(variants), shown, tuple(corners), fitted, bool(speeds))


def _listed(variants: Sequence[Variant]) -> str:
    return ", ".join(dict.fromkeys(name for variant in variants for name in (variant.build, variant.label)))
