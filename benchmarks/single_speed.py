"""Benchmark of the choice of the law on tests of a single speed, with random virtual shocks.

    python benchmarks/single_speed.py [--shocks 24]

Each shock (shims, clicks, gas pressure, dish and jet drawn at random) is tested with a sine of random amplitude and
frequency. Law and curve are chosen on this record, and judged on a sine of the same amplitude that is 1.5 to 4 times
faster or slower, and on the same sine after 3 s of rest. No measured record is used. Prints, for the choice among all
laws and for that without Hysteresis: in how many tests it is within 5 % of the best law and curve in hindsight, the
largest excesses, and the geometric mean of its errors in percent of the force's standard deviation.
"""

from __future__ import annotations

import argparse
import os
import sys
from collections import defaultdict
from collections.abc import Mapping
from dataclasses import replace

os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np

from benchmarks.law_choice import CLOSE, CURVES, Candidate
from eightpost.ident import choose_law, evaluate, fit_shock
from eightpost.ident.shock.law_choice import LawChoice
from eightpost.rig import Actuator, DynoTest, read_out, shim_build
from eightpost.rig.damper import PhysicalDamper
from eightpost.rig.damper.valves import ShimStack
from eightpost.rig.excitations import sine_test
from eightpost.shock import LAWS
from eightpost.signals import TimeSeries
from eightpost.units import convert

#: Sampling rate of the motion, and every how many samples are recorded.
RATE, EVERY = 2000.0, 4

#: Seconds of rest before a sine, and length of the sines [s].
REST, DURATION, SHORT = 3.0, 10.5, 5.0

#: Codes of Table 7.2 for the main piston and for the head valve.
MAIN, HEAD = ("AA", "A", "B", "C", "D", "A+", "B+"), ("B", "A+", "A")

#: Judgements on two held-out records: errors of each law and curve by the name of the record.
Judged = dict[str, dict[Candidate, float]]


def random_shock(generator: np.random.Generator) -> PhysicalDamper:
    """Return a shock with random valves and gas pressure."""
    compression, rebound, head = (str(generator.choice(codes)) for codes in (MAIN, MAIN, HEAD))
    clicks, pressure = int(generator.integers(0, 29)), convert(float(generator.uniform(50.0, 250.0)), "psi", "Pa")
    dish = float(generator.choice([0.0, 3e-4, 6.35e-4]))
    jet = 1e-6 * _between(generator, 0.3, 2.7)
    shock = shim_build(f"{compression}/{rebound}", clicks=clicks, gas_pressure=pressure)
    main, valve = shock.piston, shock.head.compression
    dished = {side: replace(getattr(main, side), dish=dish) for side in ("compression", "rebound")}
    softer = replace(shock.head, compression=replace(valve, stack=ShimStack(head)))
    return replace(shock, piston=replace(main, jet_area=jet, **dished), head=softer)


def _between(generator: np.random.Generator, low: float, high: float) -> float:
    return float(np.exp(generator.uniform(np.log(low), np.log(high))))


def sine(amplitude: float, speed: float, duration: float, *, rest: float = 0.0) -> TimeSeries:
    """Return a sine [m] of a peak speed [m/s], after some rest [s]."""
    cycles = max(3, int(np.ceil(duration * speed / (2.0 * np.pi * amplitude))))
    moved = sine_test(amplitude, speed, cycles=cycles).drivefile.series["displacement"]
    travel = np.concatenate([np.zeros(round(rest * RATE)), moved])
    return TimeSeries.from_channels(np.arange(travel.size) / RATE, {"displacement": ("m", travel)})


def record(shock: PhysicalDamper, motion: TimeSeries, seed: int) -> DynoTest:
    """Return what the dynamometer records."""
    truth = shock.respond(Actuator().follow(motion), rate=RATE)
    return DynoTest(read_out(truth, seed=seed).at(slice(None, None, EVERY)))


def records(number: int) -> tuple[DynoTest, Mapping[str, DynoTest]]:
    """Return the fitted record of a shock, and the records to judge on by their names."""
    generator = np.random.default_rng([2024, number])
    shock = random_shock(generator)
    amplitude, frequency = 0.0254 * _between(generator, 0.2, 1.0), _between(generator, 0.5, 3.0)
    speed, factor = 2.0 * np.pi * frequency * amplitude, _between(generator, 1.5, 4.0)
    factor = factor if generator.random() < 0.5 else 1.0 / factor
    name = "faster" if factor > 1.0 else "slower"
    other = record(shock, sine(amplitude, factor * speed, DURATION), number + 1000)
    rested = record(shock, sine(amplitude, speed, SHORT, rest=REST), number + 2000)
    return record(shock, sine(amplitude, speed, DURATION), number), {name: other, "after rest": rested}


def judged(fitted: DynoTest, held_out: Mapping[str, DynoTest]) -> Judged:
    """Return the errors of all laws and curves on held-out records, in percent of the force's standard deviation."""
    found: Judged = {name: {} for name in held_out}
    for law in LAWS:
        for curve in CURVES:
            try:
                fit = fit_shock(fitted, law, curve=curve)
            except ValueError:  # raised by laws and fits that reject the data
                continue
            for name, test in held_out.items():
                found[name][law, curve] = evaluate(fit.shock, test, segment=(0.0, test.series.duration)).percent
    return found


def candidate(choice: LawChoice) -> Candidate:
    """Return the chosen law and curve."""
    assert choice.chosen.curve is not None
    return choice.law, choice.chosen.curve.kind


def main() -> None:
    """Run the benchmark and print its figures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--shocks", type=int, default=24, help="number of shocks")
    others = tuple(law for law in LAWS if law != "hysteresis")
    found: dict[tuple[str, str], list[tuple[float, float]]] = defaultdict(list)
    for number in range(parser.parse_args().shocks):
        fitted, held_out = records(number)
        errors = judged(fitted, held_out)
        for laws, names in (("all laws", tuple(LAWS)), ("without Hysteresis", others)):
            chosen = candidate(choose_law(fitted, names))
            for name, percents in errors.items():
                found[laws, name].append((percents[chosen], percents[chosen] / min(percents.values()) - 1.0))
        print(f"shock {number} of {parser.parse_args().shocks}", file=sys.stderr, flush=True)
    for (laws, name), pairs in found.items():
        percent, excess = np.array(pairs).T
        worst = ", ".join(f"{100.0 * value:.0f}" for value in np.sort(excess)[::-1][:4])
        close = f"{int(np.sum(excess <= CLOSE))} of {len(pairs)} within {100.0 * CLOSE:.0f} %"
        print(
            f"{laws}, judged {name}: {close} of the best; largest excesses {worst} %; error "
            f"{np.exp(np.mean(np.log(percent))):.3g} %"
        )


if __name__ == "__main__":
    main()
