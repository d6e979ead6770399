"""Benchmark of the choice of the law on tests of a single speed, with random virtual shocks.

    python benchmarks/single_speed.py [--shocks 24] [--seed 7301] [--json FILE] [--page FILE]

Each shock (shims, clicks, gas pressure, dish and jet drawn at random) is tested with a sine of random amplitude and
frequency. Law and curve are chosen on this record, and judged on a sine of the same amplitude that is 1.5 to 4 times
faster or slower, and on the same sine after 3 s of rest. No measured record is used. Prints Markdown, largest values
first: for the choice among all laws and for that without Hysteresis, in how many tests it is within 5 % of the best law
and curve in hindsight, its excesses, and the geometric means of both errors in percent of the force's standard
deviation; for each law, how much knots instead of polynomials change the error, and the errors with knots.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np

from benchmarks.law_choice import CLOSE, CURVES, HYSTERESIS, Candidate, rewrite
from benchmarks.shock_tables import grid
from benchmarks.table import number
from eightpost.ident import choose_law, evaluate, fit_shock
from eightpost.ident.shock.law_choice import LawChoice, chosen_law
from eightpost.rig import Actuator, DynoTest, read_out, shim_build
from eightpost.rig.damper import PhysicalDamper
from eightpost.rig.damper.valves import ShimStack
from eightpost.rig.excitations import sine_test
from eightpost.shock import LAWS, law_title
from eightpost.signals import TimeSeries
from eightpost.units import convert

#: Sampling rate of the motion, and every how many samples are recorded.
RATE, EVERY = 2000.0, 4

#: Seconds of rest before a sine, and length of the sines [s].
REST, DURATION, SHORT = 3.0, 10.5, 5.0

#: Seed of the shocks and their tests; no setting was chosen with it.
SEED = 7301

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


def records(number: int, seed: int = SEED) -> tuple[DynoTest, Mapping[str, DynoTest]]:
    """Return the fitted record of a shock, and the records to judge on by their names."""
    generator = np.random.default_rng([seed, number])
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


@dataclass(frozen=True, slots=True)
class Outcome:
    """Judgement of a shock on one held-out record.

    Attributes:
        name: Name of the held-out record.
        errors: Errors of all laws and curves, in percent of the force's standard deviation.
        chosen: Choice among all laws, and among those without Hysteresis, by the name of the group.
    """

    name: str
    errors: Mapping[Candidate, float]
    chosen: Mapping[str, Candidate]

    def excess(self, group: str) -> float:
        """Return the excess of the choice's error over the lowest, over the lowest [1]."""
        return self.errors[self.chosen[group]] / min(self.errors.values()) - 1.0

    def change(self, law: str) -> float | None:
        """Return what knots instead of polynomials change of a law's error [1]; None if either is missing."""
        polynomials, knots = (self.errors.get((law, curve)) for curve in CURVES)
        return None if polynomials is None or knots is None else knots / polynomials - 1.0


def outcomes(number: int, seed: int = SEED) -> list[Outcome]:
    """Return the judgements of a shock on its held-out records."""
    fitted, held_out = records(number, seed)
    choice = choose_law(fitted)
    others = chosen_law([score for score in choice.scores if score.law != HYSTERESIS[0]])
    chosen = {"all laws": candidate(choice), "without Hysteresis": candidate(others)}
    return [Outcome(name, errors, chosen) for name, errors in judged(fitted, held_out).items()]


def report(found: Sequence[Outcome]) -> str:
    """Return the tables as Markdown."""
    names = sorted({one.name for one in found})
    by_name = {name: [one for one in found if one.name == name] for name in names}
    choices = ("judged on", "choice", "within 5 % of the best", "excesses [%]", "error of the choice, of the best [%]")
    changes = ("judged on", "law", "knots worse by more than 5 %", "change by knots [%]", "errors, knots [%]")
    rows = [_choice_row(name, group, of) for name, of in by_name.items() for group in found[0].chosen]
    tables = grid(choices, rows), grid(changes, [row for name, of in by_name.items() for row in _change_rows(name, of)])
    return "\n\n".join(tables)


def _choice_row(name: str, group: str, found: Sequence[Outcome]) -> list[str]:
    excess = [one.excess(group) for one in found]
    errors = [one.errors[one.chosen[group]] for one in found], [min(one.errors.values()) for one in found]
    close = f"{sum(value <= CLOSE for value in excess)} of {len(found)}"
    return [name, group, close, _spread([100.0 * value for value in excess]), ", ".join(map(_mean, errors))]


def _change_rows(name: str, found: Sequence[Outcome]) -> Iterator[list[str]]:
    for law in LAWS:
        changes = [change for one in found if (change := one.change(law)) is not None]
        errors = [one.errors[law, "knots"] for one in found if (law, "knots") in one.errors]
        if errors:
            worse = f"{sum(change > CLOSE for change in changes)} of {len(changes)}" if changes else ""
            cells = _spread([100.0 * change for change in changes]) if changes else ""
            yield [name, law_title(law), worse, cells, _spread(errors)]


def _spread(values: Sequence[float]) -> str:
    """Return the three largest values, the median and the smallest one."""
    ordered = np.sort(values)[::-1]
    largest = ", ".join(number(float(value)) for value in ordered[:3])
    return f"{largest}, .., {number(float(np.median(ordered)))} (median), .., {number(float(ordered[-1]))}"


def _mean(errors: Sequence[float]) -> str:
    return number(float(np.exp(np.mean(np.log(errors)))))


def row(shock: int, one: Outcome) -> dict[str, object]:
    """Return the row that --json writes."""
    errors = {f"{law}, {curve}": error for (law, curve), error in one.errors.items()}
    return {"shock": shock, "judged": one.name, "chosen": dict(one.chosen), "errors": errors}


def main() -> None:
    """Run the benchmark and print its tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--shocks", type=int, default=24, help="number of shocks")
    parser.add_argument("--seed", type=int, default=SEED, help="seed of the shocks and their tests")
    parser.add_argument("--json", type=Path, help="write the rows to this file")
    parser.add_argument("--page", type=Path, help="rewrite the tables of this page, docs/explanation/law_choice.md")
    options = parser.parse_args()
    found = []
    for shock in range(options.shocks):
        found += [(shock, one) for one in outcomes(shock, options.seed)]
        print(f"shock {shock + 1} of {options.shocks}", file=sys.stderr, flush=True)
        if options.json:
            options.json.write_text(json.dumps([row(*pair) for pair in found], indent=1) + "\n", encoding="utf-8")
    text = report([one for _, one in found])
    print(text)
    if options.page:
        rewrite(options.page, "single_speed", text)


if __name__ == "__main__":
    main()
