"""Runs of a dynamometer record, and what runs that are repeated at several temperatures tell of their effect."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
from scipy.ndimage import maximum_filter1d, minimum_filter1d

from eightpost.array_types import Array
from eightpost.rig.dyno_test import FEWEST, SHORTEST, DynoTest
from eightpost.rig.motion import path_of, turning_points

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from eightpost.signals.timeseries import TimeSeries


# ---- Splitting at pauses and at changes of amplitude or frequency of a sine -----------------------------------------

#: The shock is at rest if it moves by less than this share of the record's stroke, ...
REST_SHARE = 0.01
#: ... for at least this time [s], ...
PAUSE = 0.5
#: ... and for this share of the adjacent half cycle: a sine stays within 1 % of its stroke for 13 % of a half cycle.
PAUSE_SHARE = 0.5
#: Half cycles belong to one block if stroke and duration are within this share of the block's median.
ALIKE = 0.1
#: Minimum stroke of a half cycle, as a share of the stroke of the section; smaller motions are noise.
SMALLEST = 0.02
#: Minimum number of half cycles in a block.
FEWEST_HALVES = 6
#: Minimum share of a section that blocks must fill. Otherwise the section is one run, for example a random drive.
FILLED = 0.75


@dataclass(frozen=True, slots=True)
class _Half:
    """A half cycle between two turning points: samples, stroke [m], duration [s]."""

    start: int
    stop: int
    stroke: float
    duration: float

    def like(self, block: list[_Half]) -> bool:
        """Return whether the half cycle belongs to a block."""
        stroke, duration = np.median([half.stroke for half in block]), np.median([half.duration for half in block])
        return bool(abs(self.stroke - stroke) <= ALIKE * stroke and abs(self.duration - duration) <= ALIKE * duration)


def split_runs(test: DynoTest, *, pause: float = PAUSE) -> tuple[DynoTest, ...]:
    """Split a record into its runs.

    1. A *pause* is a time of at least `pause` seconds in which the shock moves by less than 1 % of the record's stroke.
       It must last at least half as long as the adjacent half cycle, because a slow sine is nearly at rest at its ends.
       The record is split at pauses, and pauses are left out.
    2. A section between pauses is divided into half cycles at its turning points. Three or more consecutive cycles
       whose stroke and duration are within 10 % of their median are a *block*. If blocks fill three quarters of the
       section, each block is a run, and the cycles in between (in which the machine changes speed) are left out.
       Otherwise, as in a random drive, the section is one run.
    3. Runs with less than 0.5 s or 200 samples are left out, and a note of the first run says so.

    If displacement is unknown, the integral of velocity is used instead. The times are not shifted.

    Args:
        test: Record to split.
        pause: Minimum duration of a pause [s].

    Returns:
        Runs in their order, or only the test itself if there is nothing to split.
    """
    path = path_of(test.series)
    stretches = _stretches(test, path, pause)
    pieces = [piece for stretch in stretches for piece in _blocks(test, path, *stretch)]
    kept = [piece for piece in pieces if _long_enough(test, *piece)]
    if len(kept) < 2 and len(pieces) < 2:
        return (test,)
    runs = [_run(test, piece, f"run {i} of {len(kept)}") for i, piece in enumerate(kept, 1)]
    if runs and len(kept) < len(pieces):
        count = len(pieces) - len(kept)
        left_out = f"{count} runs with less than {SHORTEST:g} s or {FEWEST} samples are left out"
        runs[0] = replace(runs[0], notes=(left_out, *runs[0].notes))
    return tuple(runs) or (test,)


def _stretches(test: DynoTest, path: Array, pause: float) -> list[tuple[int, int]]:
    """Return the first sample and the sample after the last of each section between pauses."""
    width = max(3, round(pause * test.series.sample_rate))
    if width >= path.size:
        return [(0, path.size)]
    moved = maximum_filter1d(path, width) - minimum_filter1d(path, width)
    still = moved < REST_SHARE * float(np.ptp(path))
    # If a window is at rest, all of its samples belong to the pause, not only the middle one.
    resting = maximum_filter1d(still.astype(np.int8), width).astype(bool)
    turns = np.array(turning_points(path, threshold=SMALLEST * float(np.ptp(path))))
    for start, stop in _intervals(resting):
        if stop - start < PAUSE_SHARE * _half_cycle_beside(turns, start, stop):
            resting[start:stop] = False
    return _intervals(~resting) or [(0, path.size)]


def _intervals(flags: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Return the first sample and the sample after the last of each sequence of True."""
    edges = np.diff(np.concatenate(([0], flags.astype(np.int8), [0])))
    starts, stops = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)
    return [(int(start), int(stop)) for start, stop in zip(starts, stops, strict=True)]


def _half_cycle_beside(turns: NDArray[np.int64], start: int, stop: int) -> float:
    """Return the number of samples between a pause and the farther of the two adjacent turning points."""
    before, after = turns[turns < start], turns[turns >= stop]
    return float(max(start - before[-1] if before.size else 0, after[0] - stop if after.size else 0))


def _blocks(test: DynoTest, path: Array, start: int, stop: int) -> list[tuple[int, int]]:
    """Return the steady sines of a section, or the whole section if they do not fill it."""
    halves = _halves(test.series.time[start:stop], path[start:stop], start)
    blocks: list[list[_Half]] = []
    for half in halves:
        if blocks and half.like(blocks[-1]):
            blocks[-1].append(half)
        else:
            blocks.append([half])
    steady = [block for block in blocks if len(block) >= FEWEST_HALVES]
    filled = sum(block[-1].stop - block[0].start for block in steady)
    if len(steady) < 2 or filled < FILLED * (stop - start):
        return [(start, stop)]
    return [(block[0].start, block[-1].stop) for block in steady]


def _halves(time: Array, path: Array, offset: int) -> list[_Half]:
    """Return the half cycles between turning points at least 2 % of the section's stroke apart."""
    turns = turning_points(path, threshold=SMALLEST * float(np.ptp(path)))
    return [
        _Half(a + offset, b + offset, float(abs(path[b] - path[a])), float(time[b] - time[a]))
        for a, b in pairwise(turns)
    ]


def _long_enough(test: DynoTest, start: int, stop: int) -> bool:
    time = test.series.time
    return stop - start >= FEWEST and float(time[stop - 1] - time[start]) >= SHORTEST


def _run(test: DynoTest, piece: tuple[int, int], name: str) -> DynoTest:
    start, stop = piece
    series = test.series.window(test.series.time[start], test.series.time[stop - 1])
    section = f"{name}: {series.time[0]:.4g} to {series.time[-1]:.4g} s of the record"
    return replace(test, series=series, derived=(*test.derived, section), notes=()).judged()


# ---- Effect of temperature on the force -----------------------------------------------------------------------------

#: Runs are repetitions if the standard deviations of their velocities agree within this share.
REPEATED = 0.05
#: Minimum range of temperature [K] for an estimate.
SMALLEST_SPREAD = 1.0


@dataclass(frozen=True, slots=True)
class TemperatureEffect:
    """Change of force with temperature, estimated from repeated runs."""

    per_kelvin: float  #: Relative change of the force's standard deviation [1/K]; negative if the shock becomes softer.
    error: float  #: Standard error of per_kelvin [1/K]; NaN if it is determined exactly by two runs.
    runs: int  #: Number of runs.
    spread: float  #: Range of the mean temperatures of the runs [K].

    def __str__(self) -> str:
        return (
            f"force changes by {100.0 * self.per_kelvin:+.2f} %/K (standard error {100.0 * self.error:.2f}), from "
            f"{self.runs} repeated runs over a range of {self.spread:.1f} K"
        )


def temperature_effect(tests: Iterable[DynoTest]) -> TemperatureEffect | None:
    """Estimate the change of force with temperature from runs that repeat each other.

    The model log(standard deviation of force) = g_k + b T is fitted by least squares. The groups k are runs with the
    same velocity (standard deviation within 5 %); within a group, the force is assumed proportional to the velocity.
    The result is None if no runs are repeated, or if their temperatures differ by less than 1 K.

    Args:
        tests: Runs from `split_runs` or from several files of one build.
    """
    known = [test for test in tests if "temperature" in test.series]
    temperatures, logs = [], []
    for group in _groups(known):
        if len(group) > 1:
            heat = np.array([test.series["temperature"].mean() for test in group])
            force = np.array([np.log(test.series["force"].std() / test.series["velocity"].std()) for test in group])
            temperatures.append(heat - heat.mean())
            logs.append(force - force.mean())
    if not temperatures or max(float(np.ptp(heat)) for heat in temperatures) < SMALLEST_SPREAD:
        return None
    return _regress(temperatures, logs)


def _groups(tests: Sequence[DynoTest]) -> list[list[DynoTest]]:
    """Return the runs in groups with the same standard deviation of velocity."""
    groups: list[list[DynoTest]] = []
    for test in sorted(tests, key=_speed):
        if groups and _speed(test) <= (1.0 + REPEATED) * _speed(groups[-1][0]):
            groups[-1].append(test)
        else:
            groups.append([test])
    return groups


def _speed(test: DynoTest) -> float:
    return float(test.series["velocity"].std())


def _regress(temperatures: list[Array], logs: list[Array]) -> TemperatureEffect:
    heat, force = np.concatenate(temperatures), np.concatenate(logs)
    slope = float(heat @ force / (heat @ heat))
    free = heat.size - len(temperatures) - 1
    residual = force - slope * heat
    error = float(np.sqrt(residual @ residual / free / (heat @ heat))) if free > 0 else float("nan")
    spread = max(float(np.ptp(group)) for group in temperatures)
    return TemperatureEffect(slope, error, heat.size, spread)


# ---- Change of the temperature within a record ----------------------------------------------------------------------


def temperature_drift(series: TimeSeries) -> float:
    """Return the change of temperature [K] over a record, from the mean of its first tenth to that of its last."""
    values = series["temperature"]
    tenth = max(1, values.size // 10)
    return float(values[-tenth:].mean() - values[:tenth].mean())
