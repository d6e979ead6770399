"""Splitting of a dynamometer record into runs, at pauses and at changes of amplitude or frequency of a sine."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
from scipy.ndimage import maximum_filter1d, minimum_filter1d

from eightpost.array_types import Array
from eightpost.rig.cycles import path_of, turning_points
from eightpost.rig.dyno_test import FEWEST, SHORTEST, DynoTest

if TYPE_CHECKING:
    from numpy.typing import NDArray


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
