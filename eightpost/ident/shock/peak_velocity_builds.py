"""Peak-velocity tables of several builds of a shock: their mean curve, and the spread between the builds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from eightpost.array_types import Array
from eightpost.errors import InputError
from eightpost.ident.shock.between_builds import POINTS, BuildSpread, side_scales
from eightpost.ident.shock.curve import curve_forces
from eightpost.ident.shock.gas import GasTreatment
from eightpost.ident.shock.peak_velocity import fit_peak_velocity
from eightpost.rig.peak_velocity import PeakVelocityTable, peak_velocity_tables
from eightpost.shock import Shock
from eightpost.signals import ChannelMap
from eightpost.validity import judged


def builds_in(
    files: Sequence[Path], units: Mapping[str, str], builds: Mapping[Path, str], channel_map: ChannelMap | None = None
) -> dict[str, tuple[PeakVelocityTable, ...]]:
    """Return the tables of each build if the files are peak-velocity tables of several builds; else nothing.

    Args:
        files: Files.
        units: Units by column, for columns without a unit in the file.
        builds: Name of the build of each file.
        channel_map: Columns with unusual names.

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

    Args:
        tables: Tables of each build, by its name; one setting of the adjusters.
        name: Name of the shock; default that of the first file.
        gas: Treatment of the gas force, see `fit_peak_velocity`.

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
