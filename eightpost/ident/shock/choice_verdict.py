"""Verdict on the choice of a law: what the chosen law predicts, and what another test would settle."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from eightpost.array_types import Array
from eightpost.ident.shock.cross_validation import BLOCKS
from eightpost.ident.shock.law_choice import LawChoice
from eightpost.ident.shock.runs import ONE_SPEED, Runs
from eightpost.shock import law_title
from eightpost.units import convert
from eightpost.verdict import Grade, Reason, Rules

#: Held-out errors above these, in percent of the force's standard deviation, are doubtful and not usable.
DOUBTFUL, POOR = 10.0, 30.0

#: The level of the runs differs if the error with level exceeds that without by this factor, and this many percent.
LEVEL_FACTOR, LEVEL_PERCENT = 1.5, 5.0

#: A quarter differs if its held-out error is this many times that of the other quarters, and above this many percent.
UNEVEN_FACTOR, UNEVEN_PERCENT = 1.5, 5.0

#: Minimum number of cycles of the motion in each quarter of the records.
FEWEST_CYCLES = 4

#: Peak speed [m/s] below which a record shows only low speeds: 10 in/s.
NARROW = convert(10.0, "in/s", "m/s")

ABOUT = "choice of the law"
RULES = Rules()

PREDICTS = RULES.add("chosen law predicts", ABOUT, Grade.USABLE,
    condition=f"held-out error of the chosen law at most {DOUBTFUL:g} % of the force's standard deviation",
    why="the law predicts parts or runs that its parameters were not fitted to, within the stated velocities and "
    "frequencies",
)  # fmt: skip
PREDICTS_ROUGHLY = RULES.add("chosen law predicts roughly", ABOUT, Grade.LIMITED,
    condition=f"held-out error above {DOUBTFUL:g} %",
    why="shocks of one bank differ by some tens of percent; smaller differences cannot be distinguished then",
    remedy="compare only shocks that differ by more; repeat the test to see how far two runs of the shock differ",
)  # fmt: skip
PREDICTS_POORLY = RULES.add("chosen law predicts poorly", ABOUT, Grade.NOT_USABLE,
    condition=f"held-out error above {POOR:g} %",
    why="no law predicts what was left out: a third of the force is missing, and shocks would be ranked by chance",
    remedy="check whether the records are of one shock and one setting (eightpost inspect), and fit them separately",
)  # fmt: skip
LEVEL = RULES.add("level of the runs", ABOUT, Grade.LIMITED,
    condition=f"held-out error of whole runs with their level above {LEVEL_FACTOR:g} times that without, and above it "
    f"by {LEVEL_PERCENT:g} % of the standard deviation",
    why="the runs differ by a factor of the force, which no law predicts from the motion: temperature, setting or gas",
    remedy="repeat the runs at one temperature and setting, or fit them separately",
)  # fmt: skip
UNEVEN = RULES.add("uneven record", ABOUT, Grade.LIMITED,
    condition=f"a quarter of the record has {UNEVEN_FACTOR:g} times the held-out error of the others, and above "
    f"{UNEVEN_PERCENT:g} %",
    why="this part differs from the rest: another amplitude, warming, a ramp or a fault",
    remedy="look at this part (eightpost inspect), and leave it out with --segment if it is not of the test",
)  # fmt: skip
ONE_SPEED_ONLY = RULES.add("single speed", ABOUT, Grade.LIMITED,
    condition=f"every record is one sine, and their peak speeds are within a factor of {ONE_SPEED:g}",
    why="at one speed, lag, friction and a spring have the same effect on the loop: the error at a faster or a slower "
    "speed is unknown, and laws that agree here disagree by tens of percent there (docs/explanation/law_choice.md)",
    remedy="use the shock near this speed and frequency only; add a run at another speed, or a random test",
)  # fmt: skip
FEW_CYCLES = RULES.add("few cycles", ABOUT, Grade.LIMITED,
    condition=f"less than {FEWEST_CYCLES} cycles of the motion in a quarter of the records",
    why="a left-out quarter then contains too few strokes to compare laws",
    remedy=f"record {FEWEST_CYCLES * BLOCKS} or more cycles",
)  # fmt: skip
LOW_SPEED_ONLY = RULES.add("low speeds only", ABOUT, Grade.LIMITED,
    condition="peak speed below 10 in/s (0.254 m/s)",
    why="the valves of a race shock open at about this speed: the record does not show the force beyond",
    remedy="do not use it on kerbs and bumps; add a run that reaches the speeds of the track",
)  # fmt: skip


def choice_reasons(choice: LawChoice, runs: Runs, origin: str) -> Iterator[Reason]:
    """Yield the reasons of the verdict on a choice.

    Args:
        choice: Comparison of the laws.
        runs: Records of the comparison.
        origin: Names of the records.
    """
    yield _prediction(choice, runs, origin)
    for reason in (_level(choice, origin), _uneven(choice, origin)):
        if reason is not None:
            yield reason
    yield from _test_reasons(runs, origin)


def _prediction(choice: LawChoice, runs: Runs, origin: str) -> Reason:
    held = choice.chosen.held_out
    percent, count = held.mean_percent, len(runs.prepared)
    rule = PREDICTS if percent <= DOUBTFUL else PREDICTS_ROUGHLY if percent <= POOR else PREDICTS_POORLY
    verb = "predicts" if rule is PREDICTS else "does not predict"
    where = {
        "builds": f"whole builds, {len(runs.builds)} of them with {count} runs",
        "runs": f"whole runs, {count} of them",
        "quarters": "quarters of one run" if count == 1 else f"quarters of {count} runs, whose speeds differ",
    }[choice.left_out]
    where += "; other runs were not tried" if choice.left_out == "quarters" else ""
    low, high = float(runs.velocity[runs.inside].min()), float(runs.velocity[runs.inside].max())
    errors = f"held-out error {percent:.3g} % (typically {held.percent:.3g} +- {held.spread:.2g} %) on {where}"
    return rule.reason(
        f"{law_title(choice.law)} {verb} what was left out of its fit" + (" well" if rule is not PREDICTS else ""),
        figure=f"{errors}; limits {DOUBTFUL:g} and {POOR:g} %; velocities {low:.3g} to {high:.3g} m/s",
        origin=origin,
    )


def _level(choice: LawChoice, origin: str) -> Reason | None:
    held = choice.chosen.runs
    if held is None or held.raw_percent <= max(LEVEL_FACTOR * held.percent, held.percent + LEVEL_PERCENT):
        return None
    figure = f"held-out error {held.raw_percent:.3g} % with the level of each run, {held.percent:.3g} % without"
    return LEVEL.reason("the runs differ in the level of their forces", figure=figure, origin=origin)


def _uneven(choice: LawChoice, origin: str) -> Reason | None:
    blocks = choice.chosen.blocks
    if blocks is None or len(blocks.pieces) % BLOCKS:
        return None
    percent = 100.0 * np.sqrt(np.mean(np.reshape(blocks.pieces, (BLOCKS, -1)), axis=1))
    worst = int(np.argmax(percent))
    others = float(np.median(np.delete(percent, worst)))
    if percent[worst] <= max(UNEVEN_FACTOR * others, UNEVEN_PERCENT):
        return None
    figure = f"held-out error of quarter {worst + 1} of {BLOCKS}: {percent[worst]:.3g} %, of the others {others:.3g} %"
    return UNEVEN.reason("a part of the record differs from the rest", figure=figure, origin=origin)


def _test_reasons(runs: Runs, origin: str) -> Iterator[Reason]:
    """Yield what the test cannot show."""
    speeds = [float(np.abs(p.record["velocity"][p.inside]).max()) for p in runs.prepared]
    sines = [p.single_frequency for p in runs.prepared]
    if runs.has_one_speed:
        figure = f"sine of {sines[0]:.3g} Hz, peak speed {max(speeds):.3g} m/s"
        statement = "the test has a single speed; the error at other speeds is unknown"
        yield ONE_SPEED_ONLY.reason(statement, figure=figure, origin=origin)
    cycles = sum(_cycles(p.record["velocity"][p.inside]) for p in runs.prepared)
    if cycles < FEWEST_CYCLES * BLOCKS:
        figure = f"{cycles} cycles in all; {FEWEST_CYCLES * BLOCKS} are needed"
        yield FEW_CYCLES.reason("the test has few cycles", figure=figure, origin=origin)
    if max(speeds) < NARROW:
        figure = f"peak speed {max(speeds):.3g} m/s; limit {NARROW:.3g} m/s"
        yield LOW_SPEED_ONLY.reason("the test has low speeds only", figure=figure, origin=origin)


def _cycles(velocity: Array) -> int:
    """Return the number of times that a velocity (N,) becomes positive."""
    return int(np.sum((velocity[1:] > 0.0) & (velocity[:-1] <= 0.0)))
