"""The record check on sound records of true cars, and on records with one fault."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.cars.car import CORNERS, Car
from benchmarks.cars.draw import draw
from benchmarks.cars.faults import FAULTS, faulted
from benchmarks.cars.laps import LAPS, lap_drive
from benchmarks.cars.rig import RATE, random_drive, recorded, run
from eightpost.errors import DataError
from eightpost.ident.preparation.plausibility import record_findings
from eightpost.rig.post.rig_faults import check_rig_record
from eightpost.rig.post.rig_test import CHANNEL_UNITS
from eightpost.signals import TimeSeries
from eightpost.signals.filters import velocity_from_displacement

Array = NDArray[np.float64]

#: Length of random tests and of laps [s].
TEST, LAP = 60.0, 30.0


def records(car: Car, seed: int) -> Iterator[tuple[str, dict[str, Array]]]:
    """Yield sound records: a random test, and a lap of each kind with different shocks."""
    yield "random", recorded(car, run(car, [car.bank[car.baseline]] * 4, random_drive(car, TEST, seed)), 90 + seed)
    shocks = [car.bank[k] for k in np.random.default_rng([45, seed]).integers(0, len(car.bank), 4)]
    for kind in LAPS:
        yield kind, recorded(car, run(car, shocks, lap_drive(car, LAP, seed, kind)), 91 + seed)


def series_of(channels: dict[str, Array]) -> TimeSeries:
    """Return a record as it is checked: with shock velocities of the potentiometers."""
    speeds = {f"{c}.velocity": velocity_from_displacement(channels[f"{c}.displacement"], RATE, 50.0) for c in CORNERS}
    rows = channels | speeds
    time = np.arange(len(channels["lf.road"])) / RATE
    return TimeSeries(time, np.array(list(rows.values())), tuple(rows), tuple(CHANNEL_UNITS[n] for n in rows))


def found_in(channels: dict[str, Array]) -> list[tuple[str, tuple[str, ...]]]:
    """Return rule and channels of each finding; a record that is refused has one."""
    series = series_of(channels)
    try:
        check_rig_record(series, CORNERS)
    except DataError as error:
        return [(type(error).__name__, (str(error.channel),))]
    return [(one.rule.name, one.channels) for one in record_findings(series, CORNERS)]


def rows(kinds: Iterable[str], seeds: Iterable[int]) -> Iterator[dict[str, Any]]:
    """Yield the findings of sound records, and those of the random test and the track lap with each fault."""
    for kind in kinds:
        for seed in seeds:
            for drive, channels in records(draw(kind, seed), seed):
                yield {"kind": kind, "seed": seed, "drive": drive, "fault": "", "found": found_in(channels)}
                for fault in FAULTS if drive != "own" else ():
                    found = found_in(faulted(channels, fault))
                    yield {"kind": kind, "seed": seed, "drive": drive, "fault": fault, "found": found}


def table(found: list[dict[str, Any]]) -> str:
    """Return sound records with a finding, and for each fault how often it is found, and a wrong channel is named."""
    lines = ["| record | sound, with a finding |", "|---|---|"]
    for drive in dict.fromkeys(row["drive"] for row in found):
        sound = [row for row in found if row["drive"] == drive and not row["fault"]]
        lines.append(f"| {drive} | {sum(bool(row['found']) for row in sound)} of {len(sound)} |")
    lines += [
        "",
        "| fault | named | named, and another channel too | not named, but another channel |",
        "|---|---|---|---|",
    ]
    for fault, (_, guilty) in FAULTS.items():
        own = [{c for _, names in row["found"] for c in names} for row in found if row["fault"] == fault]
        named = [bool(channels & set(guilty)) for channels in own]
        more = [hit and not channels <= set(guilty) for hit, channels in zip(named, own, strict=True)]
        wrong = [bool(channels) and not hit for hit, channels in zip(named, own, strict=True)]
        lines.append(f"| {fault} | {sum(named)} of {len(own)} | {sum(more)} | {sum(wrong)} |")
    return "\n".join(lines)
