"""Records to fit and records to compare with: from the virtual dynamometer, and measured ones.

The measured records are in the folder that EIGHTPOST_DATA names; they are not part of the project.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

from eightpost.rig import Actuator, DynoTest, cavitation, configuration, random_multisine, read_dyno_test, read_out
from eightpost.signals import Drivefile

Segment = tuple[float, float]

LAWS = ("polylinear", "lpf1", "lpnl2", "hysteresis")
BOUC_WEN = "bouc-wen"

#: Phase draws for fit and validation; the damper was calibrated with other draws (docs/explanation/dynamometer.md).
DRAWS = ((11, 12), (13, 14), (15, 16))

#: Runs of one magneto-rheological damper: each is held out in turn. The last two have the same force level, and each of
#: them is also predicted from the other alone.
LABCONTROL = ("ensaio1", "ensaio8.2", "ensaio.vali.1")
ALIKE = LABCONTROL[1:]

#: Pairs of runs with the same clicks, and the difference between them; forces of 18-18 runs are positive in extension.
OHLINS_PAIRS = (
    ("1_1_18_18_s1_n10_150psi", "1_1_18_18_s5_n10_150psi", "speed"),
    ("1_1_18_18_s5_n10_50psi", "1_1_18_18_s5_n10_150psi", "gas pressure"),
)
#: Settings with one run, whose last third is held out.
OHLINS_SINGLE = ("3_3_18_18_s5_n100_50psi", "3_3_24_24_s5_n10_100psi")


@dataclass(frozen=True, slots=True, eq=False)
class Case:
    """One or more runs to fit, and one held-out run."""

    record: str  #: Name of the case in the rows.
    fitted: tuple[DynoTest, ...]  #: Fitted runs of one damper.
    held_out: DynoTest  #: Run to predict.
    segment: Segment | None = None  #: Time range of the fitted runs [s]; None for that of the dissertation, 1 to 10 s.
    held_out_segment: Segment | None = None  #: Time range of the held-out run [s].
    about_mean: bool = False  #: Whether the load cell's zero is unknown, so that errors are evaluated about their mean.
    configuration: int = 0  #: Configuration number of Table 3.1; 0 for a measured record.
    cavitates: bool = False  #: Whether the damper cavitates in the held-out run.

    @property
    def is_measured(self) -> bool:
        """Whether the record is a measured one."""
        return not self.configuration

    @property
    def laws(self) -> tuple[str, ...]:
        """Names of the laws that are fitted to the case."""
        return (*LAWS, BOUC_WEN) if self.about_mean else LAWS


def configurations(numbers: Sequence[int], *, quick: bool) -> Iterator[Case]:
    """Yield shocks of Table 3.1, fitted on one phase draw and compared with another.

    If `quick`, there is one pair of draws of 10.5 s, of which 1 to 10 s are used as in 3.3; otherwise three pairs of
    30 s.
    """
    duration = 10.5 if quick else 30.0
    segment = None if quick else (1.0, duration - 0.5)
    for number in numbers:
        for fitted, held_out in DRAWS[:1] if quick else DRAWS:
            name = f"configuration {number}"
            name = name if quick else f"{name}, draws {fitted} and {held_out}"
            first, _ = _virtual(number, fitted, duration)
            other, cavitates = _virtual(number, held_out, duration)
            yield Case(name, (first,), other, segment, segment, configuration=number, cavitates=cavitates)


def _virtual(number: int, seed: int, duration: float) -> tuple[DynoTest, bool]:
    """Return the record of a configuration on a phase draw, and whether it cavitates."""
    truth = configuration(number).respond(Actuator().follow(_drive(seed, duration).series), rate=2000.0)
    return DynoTest(read_out(truth, seed=seed)), cavitation(truth).cavitates


@lru_cache
def _drive(seed: int, duration: float) -> Drivefile:
    return random_multisine(seed, duration=duration)


def measured(*, quick: bool) -> Iterator[Case]:
    """Yield the measured records if EIGHTPOST_DATA names their folder; phases at rest are not fitted.

    If `quick`, 1 to 10 s of each run are used as in 3.3; otherwise the whole run.
    """
    folder = Path(os.environ.get("EIGHTPOST_DATA") or "/nowhere")
    if (folder / "labcontrol").is_dir():
        yield from _labcontrol(folder / "labcontrol", quick=quick)
    if (folder / "ohlins").is_dir():
        yield from _ohlins(folder / "ohlins", quick=quick)


def measured_runs(folder: Path) -> Iterator[tuple[str, DynoTest]]:
    """Yield name and run of every measured record in a folder."""
    if (folder / "labcontrol").is_dir():
        for name in LABCONTROL:
            yield f"labcontrol: {name}", read_dyno_test(folder / "labcontrol" / f"labcontrol_{name}.csv")
    if (folder / "ohlins").is_dir():
        for name in dict.fromkeys([*(name for pair in OHLINS_PAIRS for name in pair[:2]), *OHLINS_SINGLE]):
            yield f"ohlins: {name}", _ohlins_run(folder / "ohlins", name)


def _labcontrol(folder: Path, *, quick: bool) -> Iterator[Case]:
    runs = {name: read_dyno_test(folder / f"labcontrol_{name}.csv") for name in LABCONTROL}
    for held_out, among in (*((name, LABCONTROL) for name in LABCONTROL), *((name, ALIKE) for name in ALIKE)):
        fitted = [name for name in among if name != held_out]
        yield _by_run(
            f"labcontrol: {' + '.join(fitted)}, held out {held_out}",
            [runs[name] for name in fitted],
            runs[held_out],
            quick=quick,
        )


def _ohlins(folder: Path, *, quick: bool) -> Iterator[Case]:
    for one, other, differing in OHLINS_PAIRS:
        for fitted, held_out in ((one, other), (other, one)):
            name = f"ohlins: {fitted}, held out {held_out} (other {differing})"
            yield _by_run(name, [_ohlins_run(folder, fitted)], _ohlins_run(folder, held_out), quick=quick)
    slow, fast = (_ohlins_run(folder, name) for name in OHLINS_PAIRS[0][:2])
    other = _ohlins_run(folder, OHLINS_PAIRS[1][0])
    segment = (1.0, 10.0) if quick else (0.0, fast.series.duration)
    two = f"ohlins: {OHLINS_PAIRS[0][0]} + {OHLINS_PAIRS[0][1]} (two speeds), held out"
    rest = (segment[1], slow.series.duration)
    yield Case(f"{two} the rest of the slow run", (slow, fast), slow, segment, rest, about_mean=True)
    yield Case(f"{two} {OHLINS_PAIRS[1][0]}", (slow, fast), other, segment, about_mean=True)
    for name in OHLINS_SINGLE:
        run = _ohlins_run(folder, name)
        duration = run.series.duration
        until = 2.0 / 3.0 * duration
        segment = (1.0, min(10.0, until)) if quick else (0.0, until)
        yield Case(f"ohlins: {name}, held out its last third", (run,), run, segment, (until, duration), about_mean=True)


def _by_run(name: str, fitted: Sequence[DynoTest], held_out: DynoTest, *, quick: bool) -> Case:
    if quick:
        return Case(name, tuple(fitted), held_out, about_mean=True)
    # A segment must not be longer than a run, so the shortest fitted run limits it.
    whole = (0.0, min(run.series.duration for run in fitted))
    return Case(name, tuple(fitted), held_out, whole, (0.0, held_out.series.duration), about_mean=True)


def _ohlins_run(folder: Path, name: str) -> DynoTest:
    path = folder / f"ohlins_t1_{name}.csv"
    return read_dyno_test(path, flip=("force",) if "18_18" in name else ())
