"""The runs of a fit: prepared records that are fitted together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from eightpost.array_types import Array
from eightpost.errors import ParameterError
from eightpost.ident.shock.lag import RowFilter
from eightpost.ident.shock.record import Prepared, prepare
from eightpost.ident.shock.stroke_range import strokes
from eightpost.rig.dyno_test import DynoTest
from eightpost.rig.runs import SMALLEST_SPREAD

#: Runs whose peak speeds and frequencies are within this factor have one motion.
ONE_MOTION = 1.5


@dataclass(frozen=True, eq=False)
class Runs:
    """Prepared records that are fitted together, with N samples and R rows in total."""

    prepared: tuple[Prepared, ...]  #: One or more records.
    weights: Array  #: Weights (R,) of the rows, 0 to 1.

    @classmethod
    def of(cls, prepared: Sequence[Prepared]) -> Runs:
        """Return prepared records as runs whose rows all have weight 1."""
        runs = cls(tuple(prepared), np.empty(0))
        return runs.weighted(np.ones(sum(f.rows.size for f in runs.filters)))

    @property
    def first(self) -> Prepared:
        """The first run, for values that all runs share."""
        return self.prepared[0]

    @cached_property
    def filters(self) -> tuple[RowFilter, ...]:
        """The filter to the rows of each run."""
        return tuple(RowFilter.of(p.inside, p.rate, p.cutoff) for p in self.prepared)

    @cached_property
    def parts(self) -> tuple[slice, ...]:
        """The slice of each run's samples among all samples."""
        ends = np.cumsum([0, *(len(p.record) for p in self.prepared)]).tolist()
        return tuple(slice(start, stop) for start, stop in pairwise(ends))

    @cached_property
    def velocity(self) -> Array:
        """Damper velocity (N,) [m/s]."""
        return np.concatenate([p.record["velocity"] for p in self.prepared])

    @cached_property
    def inside(self) -> NDArray[np.bool_]:
        """Whether each sample (N,) counts."""
        return np.concatenate([p.inside for p in self.prepared])

    @cached_property
    def measured(self) -> Array:
        """The low-passed measured force of the samples that count [N]."""
        return np.concatenate([p.measured for p in self.prepared])

    @cached_property
    def target(self) -> Array:
        """The measured force at the rows (R,) [N]."""
        return np.concatenate([p.record["force"][f.rows] for p, f in zip(self.prepared, self.filters, strict=True)])

    @cached_property
    def row_velocity(self) -> Array:
        """Damper velocity at the rows (R,) [m/s]."""
        return np.concatenate([p.record["velocity"][f.rows] for p, f in zip(self.prepared, self.filters, strict=True)])

    @cached_property
    def deviation(self) -> float:
        """Standard deviation of `measured`, each run about its own mean [N]."""
        squares = [float(np.var(p.measured)) * p.measured.size for p in self.prepared]
        return float(np.sqrt(sum(squares) / self.measured.size))

    @cached_property
    def covariate(self) -> Array:
        """Slow influence on a shock at the rows (R,): the temperature [K] about its mean over all runs.

        If a run has no temperature, or if it changes by less than 1 K, it is the time of each run about its middle [s].
        """
        pairs = list(zip(self.prepared, self.filters, strict=True))
        known = [p.temperature[f.rows] for p, f in pairs if p.temperature is not None]
        if len(known) == len(pairs):
            temperature = np.concatenate(known)
            if np.ptp(temperature) >= SMALLEST_SPREAD:
                return np.asarray(temperature - temperature.mean())
        times = [p.record.time[f.rows] for p, f in pairs]
        return np.concatenate([time - time.mean() for time in times])

    @property
    def builds(self) -> tuple[str, ...]:
        """The builds of the shock in the order of the runs; empty if a run does not state its build."""
        names = [p.build for p in self.prepared]
        return tuple(dict.fromkeys(name for name in names if name is not None)) if None not in names else ()

    @property
    def rate(self) -> float:
        """The lowest sampling rate [Hz]."""
        return min(p.rate for p in self.prepared)

    @cached_property
    def motions(self) -> list[tuple[float, float]]:
        """Peak speed [m/s] and frequency of the median stroke [Hz] of each run."""
        found = []
        for p in self.prepared:
            _, speed, duration = strokes(p.record["velocity"][p.inside], p.step)
            found.append((float(speed.max()), float(0.5 / np.median(duration))))
        return found

    @property
    def has_repeated_motions(self) -> bool:
        """Whether every run has another one of nearly the same motion, from which it can be predicted."""
        numbered = list(enumerate(self.motions))
        return all(any(_are_alike(one, other) for k, other in numbered if k != n) for n, one in numbered)

    @property
    def has_repeated_builds(self) -> bool:
        """Whether there are several builds, and every run has one of nearly the same motion in another build."""
        pairs = [(p.build, motion) for p, motion in zip(self.prepared, self.motions, strict=True)]
        return len(self.builds) > 1 and all(
            any(other != build and _are_alike(motion, one) for other, one in pairs) for build, motion in pairs
        )

    @property
    def has_one_motion(self) -> bool:
        """Whether every run is one sine, and their peak speeds and frequencies are nearly equal."""
        return self._are_sines and all(_are_alike(self.motions[0], motion) for motion in self.motions)

    @property
    def are_two_sines(self) -> bool:
        """Whether there are two runs, each of them one sine."""
        return len(self.prepared) == 2 and self._are_sines

    @property
    def _are_sines(self) -> bool:
        return all(p.single_frequency is not None for p in self.prepared)

    @property
    def changes(self) -> tuple[str, ...]:
        """Every departure from the dissertation's choices, with the number of the run if there are several."""
        if len(self.prepared) == 1:
            return self.first.changes
        numbered = enumerate(self.prepared, start=1)
        return tuple(f"run {number}: {change}" for number, run in numbered for change in run.changes)

    def rows(self, values: Array) -> Array:
        """Return the low-passed rows (..., R) of values (..., N)."""
        parts = zip(self.filters, self.parts, strict=True)
        return np.concatenate([f(values[..., part]) for f, part in parts], axis=-1)

    def weighted(self, weights: Array) -> Runs:
        """Return the same runs with weights (R,) of their rows."""
        return replace(self, weights=weights)

    def thinned(self, by: int) -> tuple[Runs, NDArray[np.intp]]:
        """Return the runs with every `by`-th sample, at the same rows, and the indices (M,) of these samples."""
        starts = [f.first % by for f in self.filters]
        kept = [np.arange(part.start + start, part.stop, by) for part, start in zip(self.parts, starts, strict=True)]
        prepared = tuple(_every(p, start, by) for p, start in zip(self.prepared, starts, strict=True))
        return replace(self, prepared=prepared), np.concatenate(kept)

    def blocks(self, duration: float) -> list[slice]:
        """Return consecutive blocks of rows of about a duration [s] each; no block spans two runs."""
        blocks, start = [], 0
        for f in self.filters:
            pieces = max(round(f.rows.size / (duration * f.row_rate)), 1)
            ends = start + np.linspace(0, f.rows.size, pieces + 1).astype(int)
            blocks += [slice(int(a), int(b)) for a, b in pairwise(ends)]
            start += f.rows.size
        return blocks


def _are_alike(one: tuple[float, float], other: tuple[float, float]) -> bool:
    return all(max(a, b) <= ONE_MOTION * min(a, b) for a, b in zip(one, other, strict=True))


def _every(prepared: Prepared, start: int, by: int) -> Prepared:
    kept = slice(start, None, by)
    temperature = None if prepared.temperature is None else prepared.temperature[kept]
    record, inside = prepared.record.at(kept), prepared.inside[kept]
    return replace(prepared, record=record, rate=prepared.rate / by, inside=inside, temperature=temperature)


def prepare_runs(
    tests: Sequence[DynoTest],
    *,
    segment: tuple[float, float] | None = None,
    cutoff: float | None = None,
) -> Runs:
    """Prepare records to be fitted together.

    Args:
        tests: One or more records.
        segment: Start and end [s] of each record; see `prepare`.
        cutoff: Cutoff frequency of the low-pass [Hz]; see `prepare`.

    Raises:
        ParameterError: There is no record.
        DataError: A record has a fault; see `prepare`.
    """
    if not tests:
        raise ParameterError("no record to fit; give one or more")
    return Runs.of([prepare(test, segment=segment, cutoff=cutoff) for test in tests])
