"""Faults of rig records: which are found, from which size, and how often a sound record is reported.

    python -m benchmarks.rig_faults --clean 100 --short 100 --records 10

prints the tables of docs/how_to/rig_data.md. Records are 60 s of the random test on two cars: the 8-post stand-in, and
the flexible car with an engine on mounts (another car for each seed). Shocks are drawn from the virtual bank; every
second record has an alternate shock at one corner. Short records are sound: 20 s of a track and 14 s of the random
test, with four shocks drawn independently. All seeds are from 1000 on; lower seeds were used for tuning, and those of
rules for short records too: cars 1000 to 1003 and 1010.
"""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from time import perf_counter

import numpy as np

from eightpost.corners import CORNERS
from eightpost.ident.preparation import plausibility_rules
from eightpost.ident.preparation.mechanics import Spectra, spectra_of
from eightpost.ident.preparation.plausibility import checked_channels, law_findings, record_findings
from eightpost.ident.preparation.plausibility_rules import Finding
from eightpost.rig.post import RigTest, flexible_truth, random_drive, run_test, stand_in_truth, track_drive
from eightpost.rig.post.truths import shocks_named
from eightpost.signals import TimeSeries
from eightpost.verdict import Rule

SECONDS, FIRST_SEED = 60.0, 1000
CARS = ("stand-in", "flexible")
SHOCKS = ("demo:A", "demo:B", "configuration:1", "configuration:5", "build:B/B", "build:C/B")

#: Quantities at the corners, and other channels.
QUANTITIES = (
    "road", "road_command", "aero", "aero_command", "aero_position", "tire_force", "displacement", "velocity", "force",
    "hub_acceleration", "chassis_acceleration",
)  # fmt: skip
OTHERS = ("cg.vertical_acceleration", "front.ride_height")


@cache
def record(car: str, seed: int) -> RigTest:
    """Return a sound record."""
    generator = np.random.default_rng(seed)
    names = [str(generator.choice(SHOCKS))] * 4
    if seed % 2:
        names[generator.integers(4)] = str(generator.choice(SHOCKS))
    truth = stand_in_truth() if car == "stand-in" else flexible_truth(seed)
    bank = shocks_named(names)
    drive = random_drive(truth, seed, duration=SECONDS)
    return run_test(truth, drive, [bank[name] for name in names], seed=seed)


def short_record(car: str, seed: int, kind: str) -> RigTest:
    """Return a sound lap of 20 s, or a random test of 14 s, with four shocks."""
    names = [str(name) for name in np.random.default_rng(seed).choice(SHOCKS, 4)]
    truth = stand_in_truth() if car == "stand-in" else flexible_truth(seed)
    bank = shocks_named(names)
    drive = track_drive(truth, seed, duration=20.0) if kind == "track" else random_drive(truth, seed, duration=14.0)
    return run_test(truth, drive, [bank[name] for name in names], seed=seed)


@cache
def spectra(car: str, seed: int) -> Spectra:
    """Return the spectra of a sound record."""
    found = spectra_of(checked_channels(record(car, seed).series, CORNERS))
    assert found is not None
    return found


def scaled(car: str, seed: int, name: str, size: float) -> tuple[Finding, ...]:
    """Return the findings if a channel is multiplied by a factor; spectra are linear in it."""
    return law_findings(spectra(car, seed).corrected([name], gain=1.0 / size), CORNERS)


def delayed(car: str, seed: int, name: str, size: float) -> tuple[Finding, ...]:
    """Return the findings if a channel is delayed by a time [ms]; the phase of its spectra is turned."""
    return law_findings(spectra(car, seed).corrected([name], delay=-1e-3 * size), CORNERS)


def spiked(car: str, seed: int, name: str, size: float) -> tuple[Finding, ...]:
    """Return the findings in 15 s with three spikes of one sample [standard deviations of the channel]."""
    series, generator = record(car, seed).series.window(0.0, 15.0), np.random.default_rng((seed, len(name)))
    values = series[name].copy()
    values[generator.integers(50, len(series) - 50, 3)] += size * values.std()
    return record_findings(series.with_channel(name, series.unit(name), values), CORNERS)


def disconnected(car: str, seed: int, name: str, size: float) -> tuple[Finding, ...]:
    """Return the findings with white noise instead of a channel [standard deviations of the channel]."""
    series, generator = record(car, seed).series, np.random.default_rng((seed, len(name)))
    noise = series[name].mean() + size * series[name].std() * generator.standard_normal(len(series))
    return record_findings(series.with_channel(name, series.unit(name), noise), CORNERS)


def swapped(series: TimeSeries, left: str) -> TimeSeries:
    """Return the record with potentiometers, velocities and shock forces of an axle swapped."""
    right = left.replace("l", "r", 1)
    rows = {n: series[n] for n in series.names}
    for quantity in ("displacement", "velocity", "force"):
        for one, other in ((left, right), (right, left)):
            series = series.with_channel(
                f"{one}.{quantity}", series.unit(f"{one}.{quantity}"), rows[f"{other}.{quantity}"]
            )
    return series


@dataclass(frozen=True)
class Fault:
    """A kind of fault: how it is made, the rule that must find it, and its sizes, the named one first."""

    name: str
    findings: Callable[[str, int, str, float], tuple[Finding, ...]]
    rule: Rule
    named: tuple[float, ...]
    ladder: tuple[float, ...] = ()
    unit: str = ""


FAULTS = (
    Fault("factor", scaled, plausibility_rules.WRONG_SCALE, (1.3, 1.0 / 1.3), (1.2, 1.15, 1.1)),
    Fault("delay", delayed, plausibility_rules.WRONG_DELAY, (5.0, -5.0), (4.0, 3.0, 2.0), "ms"),
    Fault("spikes", spiked, plausibility_rules.SPIKES, (8.0,), (4.0, 2.0, 1.0), "sd"),
    Fault("noise", disconnected, plausibility_rules.DISCONNECTED, (1.0,), (), "sd"),
)
_FORCES, _LENGTHS = ("aero", "tire_force", "force"), ("road", "displacement", "aero_position", "height")


def unit_factor(quantity: str) -> float | None:
    """Return the factor of the wrong unit: N read as lbf, or in read as mm."""
    if quantity.removesuffix("_command") in _FORCES:
        return 4.4482
    return 1.0 / 25.4 if any(quantity.removesuffix("_command").endswith(name) for name in _LENGTHS) else None


@dataclass(frozen=True)
class Rate:
    """Number of trials, of those in which the faulty channel is named, and of those in which nothing else is."""

    trials: int
    found: int
    alone: int

    def __str__(self) -> str:
        return f"{100.0 * self.found / self.trials:.0f} / {100.0 * self.alone / self.trials:.0f}"


def rate(fault: Fault, quantity: str, size: float, seeds: Sequence[int]) -> Rate:
    """Return the detection rate of a fault of one size in a quantity, on records of both cars."""
    outcomes = [_outcome(fault, quantity, size, car, seed) for car in CARS for seed in seeds]
    return Rate(len(outcomes), sum(found for found, _ in outcomes), sum(alone for _, alone in outcomes))


def _outcome(fault: Fault, quantity: str, size: float, car: str, seed: int) -> tuple[bool, bool]:
    generator = np.random.default_rng((seed, len(quantity)))
    name = quantity if "." in quantity else f"{generator.choice(CORNERS)}.{quantity}"
    found = fault.findings(car, seed, name, size)
    own = [one for one in found if one.rule is fault.rule and name in one.channels]
    return bool(own), bool(own) and len(found) == 1 and one_channel(own[0])


def one_channel(finding: Finding) -> bool:
    """Return whether a finding names a single channel."""
    return len(finding.channels) == 1


def row(fault: Fault, quantity: str, seeds: Sequence[int]) -> list[str]:
    """Return the cells of a quantity: rates at the named sizes, then the smallest size that is found in 95 %."""
    named = [rate(fault, quantity, size, seeds) for size in fault.named]
    smallest = fault.named[0] if named[0].found >= 0.95 * named[0].trials else None
    for size in fault.ladder if smallest is not None else ():
        one = rate(fault, quantity, size, seeds)
        if one.found < 0.95 * one.trials:
            break
        smallest = size
    cells = [str(one) for one in named]
    return cells + ([f"{smallest:g} {fault.unit}".strip() if smallest is not None else "-"] if fault.ladder else [])


def detection_table(seeds: Sequence[int]) -> Iterator[str]:
    """Yield the lines of the table of detections."""
    heads = []
    for fault in FAULTS:
        heads += [f"{fault.name} {size:.3g} {fault.unit}".strip() for size in fault.named]
        heads += [f"{fault.name} from"] if fault.ladder else []
    yield "| channel | wrong unit | " + " | ".join(heads) + " |"
    yield "|---" * (len(heads) + 2) + "|"
    for quantity in (*QUANTITIES, *OTHERS):
        factor = unit_factor(quantity)
        unit = "-" if factor is None else str(rate(FAULTS[0], quantity, factor, seeds))
        cells = [cell for fault in FAULTS for cell in row(fault, quantity, seeds)]
        yield f"| {quantity} | {unit} | " + " | ".join(cells) + " |"
        sys.stdout.flush()


def swap_line(seeds: Sequence[int]) -> str:
    """Return a sentence on swapped pairs."""
    found = 0
    for car in CARS:
        for seed in seeds:
            test = record(car, seed)
            bad = swapped(test.series, "lf" if seed % 2 else "lr")
            found += [one.rule for one in record_findings(bad, test.corners)] == [plausibility_rules.SWAPPED]
    return f"swapped pairs of an axle: named alone in {found} of {2 * len(seeds)} records"


def clean_line(label: str, tests: Iterable[RigTest]) -> str:
    """Return a sentence on the findings in sound records."""
    wrong: Counter[str] = Counter()
    start, count = perf_counter(), 0
    for test in tests:
        found = record_findings(test.series, test.corners)
        count += 1
        wrong["records"] += bool(found)
        for one in found:
            wrong[one.rule.name] += 1
            print(f"  {label} {count - 1}: {one}", file=sys.stderr, flush=True)
    seconds = perf_counter() - start
    return f"{label}: {wrong['records']} of {count} sound records have a finding {dict(wrong)}; {seconds:.0f} s"


def clean_tests(car: str, count: int) -> Iterator[RigTest]:
    """Yield sound records of 60 s; they are not kept in memory."""
    yield from (record.__wrapped__(car, seed) for seed in range(FIRST_SEED + 500, FIRST_SEED + 500 + count))


def short_tests(car: str, count: int, kind: str) -> Iterator[RigTest]:
    """Yield short sound records."""
    yield from (short_record(car, seed, kind) for seed in range(FIRST_SEED + 700, FIRST_SEED + 700 + count))


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--records", type=int, default=10, help="records per car with faults")
    parser.add_argument("--clean", type=int, default=100, help="sound records per car")
    parser.add_argument("--short", type=int, default=100, help="short sound records per car and drive")
    given = parser.parse_args()
    seeds = range(FIRST_SEED, FIRST_SEED + given.records)
    for car in CARS if given.clean else ():
        print(clean_line(f"{car}, 60 s", clean_tests(car, given.clean)), flush=True)
    for car in CARS if given.short else ():
        for kind, name in (("track", "track, 20 s"), ("random", "random, 14 s")):
            print(clean_line(f"{car}, {name}", short_tests(car, given.short, kind)), flush=True)
    if given.records:
        print(swap_line(seeds), flush=True)
        for line in detection_table(seeds):
            print(line, flush=True)


if __name__ == "__main__":
    main()
