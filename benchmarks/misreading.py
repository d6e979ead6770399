"""Dynamometer records that are not what they say: labels, two settings in one record; random shocks.

    python -m benchmarks.misreading --shocks 140 --seed 9000

Each shock has random shims, jets, gas pressure and adjuster, and is tested at two random settings with a random motion
or a steady sine. Every record is judged as it is, with a force that fades by 2 to 20 %, with its pounds labelled N, and
with the second setting from a random time on.
"""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from benchmarks.settings import MOST, RandomShock
from eightpost.rig.damper.body import GasChamber
from eightpost.rig.dynamometer import Actuator, measure
from eightpost.rig.dyno_conditions import DynoConditions
from eightpost.rig.excitations import random_multisine, sine_test
from eightpost.rig.plausibility import MixedUnits, part_reasons, record_reasons
from eightpost.rig.plausibility_rules import SMALL_CHANGE, TWO_SETTINGS, UNLIKELY_UNITS
from eightpost.signals import Drivefile, TimeSeries
from eightpost.units import convert

#: Rate of the records [Hz], and shares of the largest speed at which two settings are compared.
RATE, SPEEDS = 500.0, np.array([-0.7, -0.3, -0.1, 0.1, 0.3, 0.7])
CHANGED = {TWO_SETTINGS.name, SMALL_CHANGE.name}


def found(series: TimeSeries, gas_pressure: float | None = None) -> set[str]:
    """Return the names of the rules whose reasons a record has."""
    known = {"measured": series.names, "origin": "-", "units": MixedUnits()}
    reasons = record_reasons(series, **known, conditions=DynoConditions(gas_pressure=gas_pressure))  # type: ignore[arg-type]
    return {reason.rule for reason in (*reasons, *part_reasons(series, origin="-"))}


def with_force(series: TimeSeries, factor: float | np.ndarray) -> TimeSeries:
    """Return a record with its force multiplied."""
    return series.with_channel("force", "N", factor * series["force"])


def joined(first: TimeSeries, second: TimeSeries, share: float) -> TimeSeries:
    """Return a record that continues with the second one from a share of its duration on."""
    early = first.time < first.time[0] + share * first.duration
    units = dict(zip(first.names, first.units, strict=True))
    return TimeSeries.from_channels(
        first.time, {name: (units[name], np.where(early, first[name], second[name])) for name in first.names}
    )


def motion(random: np.random.Generator, seed: int) -> Drivefile:
    """Return a random motion of 10 s, or a steady sine."""
    if random.random() < 0.5:
        return random_multisine(seed, duration=10.0, rate=2000.0)
    amplitude, speed = random.choice([0.0127, 0.0254]), random.choice([0.127, 0.254, 0.508])
    return sine_test(float(amplitude), float(speed), cycles=int(random.integers(8, 20)), rate=2000.0).drivefile


def judged(seed: int) -> Iterator[tuple[str, bool]]:
    """Yield what was done to the records of a random shock, and whether it was found."""
    random = np.random.default_rng(seed)
    shock = RandomShock.drawn(random)
    gas = convert(float(random.uniform(50.0, 300.0)), "psi", "Pa")
    shock = replace(shock, base=replace(shock.base, gas=GasChamber(gas)))
    clicks = random.choice(round(MOST) + 1, 2, replace=False)
    drive = motion(random, seed)
    records = [
        measure(shock.at(float(c)), drive, rate=RATE, actuator=Actuator(), seed=seed + k) for k, c in enumerate(clicks)
    ]
    for record in records:
        yield "clean: false alarm", bool(found(record, gas))
        share = (record.time - record.time[0]) / record.duration
        fading = 1.0 - random.uniform(0.02, 0.2) * (1.0 - np.exp(-share / random.uniform(0.05, 1.0)))
        yield "force fades: false alarm", bool(found(with_force(record, fading), gas))
    pounds = with_force(records[0], convert(1.0, "N", "lbf"))
    cold = pounds.select([name for name in pounds.names if name != "temperature"])
    yield "lbf labelled N, gas pressure and temperature", UNLIKELY_UNITS.name in found(pounds, gas)
    yield "lbf labelled N, temperature", UNLIKELY_UNITS.name in found(pounds)
    yield "lbf labelled N, gas pressure", UNLIKELY_UNITS.name in found(cold, gas)
    yield "lbf labelled N, neither", UNLIKELY_UNITS.name in found(cold)
    change = 100.0 * _change(shock, clicks, float(np.abs(records[0]["velocity"]).max()))
    low = max((edge for edge in (0, 2, 5, 10) if edge <= change), default=0)
    two = joined(records[0], records[1], float(random.uniform(0.25, 0.75)))
    yield f"two settings, RMS change of the curve from {low:2d} %", bool(CHANGED & found(two, gas))


def _change(shock: RandomShock, clicks: np.ndarray, peak: float) -> float:
    """Return the RMS difference of the static curves of two settings, relative to the first."""
    curves = []
    for click in clicks:
        damper = shock.at(float(click))
        curves.append(np.array([damper.static_force(v) for v in peak * SPEEDS]) - damper.static_force(0.0))
    return float(np.sqrt(np.mean((curves[1] - curves[0]) ** 2) / np.mean(curves[0] ** 2)))


def main() -> None:
    """Print how many of each kind were found."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--shocks", type=int, default=140)
    parser.add_argument("--seed", type=int, default=9000)
    chosen = parser.parse_args()
    total, hits = Counter[str](), Counter[str]()
    for seed in range(chosen.seed, chosen.seed + chosen.shocks):
        for kind, hit in judged(seed):
            total[kind] += 1
            hits[kind] += hit
    for kind in sorted(total):
        print(f"{kind}: {hits[kind]} of {total[kind]}")


if __name__ == "__main__":
    main()
