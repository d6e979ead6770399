"""The least-squares problem of an output-error fit, with single or multiple shooting.

The unknowns are the parameters' coordinates and, in multiple shooting, the states at the start of every segment but the
first. The residuals are the spectral lines of model minus measurement over the expected noise, the priors, and, in
multiple shooting, the differences between the end of a segment and the start of the next.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from eightpost.array_types import Array, Complex
from eightpost.ident.output_error.band import Band
from eightpost.ident.output_error.model import Model, Record
from eightpost.ident.output_error.parameters import ParameterTable
from eightpost.ident.threads import for_each
from eightpost.progress import beat
from eightpost.workers.process import usable_processors

#: Value that replaces residuals of simulations that diverged, relative to the expected noise.
_DIVERGED = 1e6

#: Minimum number of simulations per thread, and of simulated samples for which threads are started.
_TOGETHER, _HEAVY = 2, 200_000


class _Segment(NamedTuple):
    """Part of a record: the number of the record, its samples, and the column of its first unknown state, or -1."""

    record: int
    begin: int
    end: int
    column: int


@dataclass(frozen=True, eq=False)
class Problem:
    """Records, model and parameters of a fit."""

    model: Model  #: Model.
    table: ParameterTable  #: Parameters.
    records: Sequence[Record]  #: Records.
    band: Band  #: Frequency band of the residuals.
    noise: Array  #: Expected standard deviation of each output's residual (Y,).
    difference: float = 1e-5  #: Step of the finite differences, in the parameters' coordinates.
    segments: int = 1  #: Number of segments of every record.
    stiffness: float = 0.0  #: Weight of the differences between segments, relative to that of the outputs.

    @cached_property
    def _parts(self) -> tuple[_Segment, ...]:
        found, column = [], len(self.table.free)
        for number, record in enumerate(self.records):
            ends = np.linspace(0, len(record.inputs), self.segments + 1).round().astype(int)
            for k, (begin, end) in enumerate(pairwise(ends)):
                found.append(_Segment(number, int(begin), int(end), column if k else -1))
                column += self.model.state_sizes.size if k else 0
        return tuple(found)

    @property
    def unknowns(self) -> int:
        """Number of unknowns: parameters and states of segments."""
        return len(self.table.free) + self.model.state_sizes.size * (self.segments - 1) * len(self.records)

    def bounds(self) -> tuple[Array, Array]:
        """Return the lower and upper bounds of the unknowns, each (Z,)."""
        low, high = self.table.bounds()
        free = np.full(self.unknowns - len(self.table.free), np.inf)
        return np.concatenate([low, -free]), np.concatenate([high, free])

    def states(self, theta: Array) -> Array:
        """Return unknowns with the parameters' coordinates theta (P,) and the states that a simulation reaches.

        A simulation of a segment starts where the previous one ends; if it leaves a range of three typical sizes, it
        starts at the typical range instead.
        """
        z = np.concatenate([theta, np.zeros(self.unknowns - len(self.table.free))])
        sizes, values = self.model.state_sizes, self.table.values(theta)[None]
        reached = sizes[None]
        for part in self._parts:
            if part.column >= 0:
                z[part.column : part.column + sizes.size] = np.clip(np.nan_to_num(reached[0] / sizes), -3.0, 3.0)
                start = sizes * z[None, part.column : part.column + sizes.size]
            else:
                start = self.model.start(values)
            _, reached = self._run(part, values, start)
        return z

    def states_from(self, theta: Array, guesses: Sequence[Array]) -> Array:
        """Return unknowns with coordinates theta (P,) and the states of guesses (N, n), one for each record."""
        z = np.concatenate([theta, np.zeros(self.unknowns - len(self.table.free))])
        n, sizes = self.model.state_sizes.size, self.model.state_sizes
        for part in self._parts:
            if part.column >= 0:
                z[part.column : part.column + n] = guesses[part.record][part.begin] / sizes
        return z

    # ---- Residuals --------------------------------------------------------------------------------------------------

    def residual(self, z: Array) -> Array:
        """Return the residuals (R,), in standard deviations of the noise, for unknowns z (Z,), which are scaled."""
        beat()
        theta = z[: len(self.table.free)]
        outputs, ends = self._simulate([(part, *self._batch(part, z)) for part in self._parts])
        found = [self._real(lines) for lines in self._lines(outputs)]
        found += [self._gaps(z, [end[:1] for end in ends])[0], self._prior(theta)]
        return _finite(np.concatenate(found))

    def simulated(self, theta: Array) -> list[Array]:
        """Return the outputs (N, Y) of every record in one piece, for coordinates theta (P,)."""
        values = self.table.values(theta)[None]
        return [
            self._run(_Segment(k, 0, len(record.inputs), -1), values, self.model.start(values))[0][0]
            for k, record in enumerate(self.records)
        ]

    def residual_lines(self, theta: Array) -> list[Complex]:
        """Return the spectral lines (Y, B) of model minus measurement over the noise, for every record."""
        outputs = self.simulated(theta)
        return [self._record_lines(k, _bounded(y - self.records[k].outputs, self.noise)) for k, y in enumerate(outputs)]

    def jacobian(self, z: Array) -> Array:
        """Return the derivatives (R, Z) of the residuals by the unknowns z (Z,)."""
        beat()
        jobs = [(part, *self._batch(part, z, perturbed=True)) for part in self._parts]
        outputs, ends = self._simulate(jobs)
        rows = [self._real(lines) for lines in self._slope_lines(outputs)]
        gaps = self._gap_slopes(ends)
        prior = np.zeros((len(self.table.free), self.unknowns))
        np.fill_diagonal(prior, self.table.prior_weights())
        return _finite(np.vstack([*(row.T for row in rows), gaps, prior[self.table.prior_weights() > 0.0]]), 0.0)

    def slope_lines(self, theta: Array) -> list[Complex]:
        """Return the derivatives (P, Y, B) of `residual_lines` by theta, for single shooting."""
        jobs = [(part, *self._batch(part, theta, perturbed=True)) for part in self._parts]
        return self._slope_lines(self._simulate(jobs)[0])

    def _real(self, lines: Complex) -> Array:
        flat = lines.reshape(*lines.shape[:-2], -1)
        return np.concatenate([flat.real, flat.imag], axis=-1)

    def _record_lines(self, number: int, signals: Array) -> Complex:
        """Return lines (..., Y, B) of signals (..., N, Y) of a record over the noise."""
        record = self.records[number]
        rows = np.moveaxis(record.counted(signals), -1, -2) / self.noise[:, None]
        return self.band.lines(rows, record.rate)

    def _lines(self, outputs: list[Array]) -> list[Complex]:
        found = []
        for number, record in enumerate(self.records):
            y = np.concatenate([o[0] for p, o in zip(self._parts, outputs, strict=True) if p.record == number])
            found.append(self._record_lines(number, _bounded(y - record.outputs, self.noise)))
        return found

    def _slope_lines(self, outputs: list[Array]) -> list[Complex]:
        """Return the derivatives (unknowns, Y, B) of every record's lines from outputs (K, N, Y) of its segments."""
        found, count, n = [], len(self.table.free), self.model.state_sizes.size
        for number, record in enumerate(self.records):
            slopes = np.zeros((self.unknowns, *record.outputs.shape))
            for part, y in zip(self._parts, outputs, strict=True):
                if part.record == number:
                    change = (y[1:] - y[:1]) / self.difference
                    slopes[:count, part.begin : part.end] = change[:count]
                    if part.column >= 0:
                        slopes[part.column : part.column + n, part.begin : part.end] = change[count:]
            found.append(self._record_lines(number, _bounded(slopes, self.noise)))
        return found

    # ---- Priors, and differences between segments -------------------------------------------------------------------

    def _prior(self, theta: Array) -> Array:
        weights = self.table.prior_weights()
        return np.asarray((weights * (theta - self.table.prior_means()))[weights > 0.0])

    def _pairs(self) -> list[tuple[int, int]]:
        """Return the segments before and after every gap."""
        return [(k - 1, k) for k, part in enumerate(self._parts) if part.column >= 0]

    @property
    def _gap_weight(self) -> float:
        """Weight of a difference of one typical state; the gaps of stiffness 1 weigh as much as the outputs."""
        samples = sum(record.outputs.size for record in self.records)
        spread = np.sqrt(np.mean([np.mean(np.var(r.outputs, axis=0) / self.noise**2) for r in self.records]))
        return float(self.stiffness * spread * np.sqrt(samples / max(1, self.unknowns - len(self.table.free))))

    def _gaps(self, z: Array, ends: list[Array]) -> Array:
        """Return the weighted differences (K, n gaps) between the ends (K, n) of segments and the next starts."""
        n, sizes = self.model.state_sizes.size, self.model.state_sizes
        found = [np.zeros((len(ends[0]), 0))]
        for before, after in self._pairs():
            column = self._parts[after].column
            found.append(self._gap_weight * (ends[before] / sizes - z[column : column + n]))
        return np.concatenate(found, axis=1)

    def _gap_slopes(self, ends: list[Array]) -> Array:
        n, sizes, count = self.model.state_sizes.size, self.model.state_sizes, len(self.table.free)
        pairs = self._pairs()
        slopes = np.zeros((n * len(pairs), self.unknowns))
        for row, (before, after) in enumerate(pairs):
            part, rows = self._parts[before], slice(n * row, n * row + n)
            change = ((ends[before][1:] - ends[before][:1]) / self.difference / sizes).T
            slopes[rows, :count] = change[:, :count]
            if part.column >= 0:
                slopes[rows, part.column : part.column + n] = change[:, count:]
            column = self._parts[after].column
            slopes[rows, column : column + n] -= np.eye(n)
        return self._gap_weight * slopes

    # ---- Simulations ------------------------------------------------------------------------------------------------

    def _batch(self, part: _Segment, z: Array, *, perturbed: bool = False) -> tuple[Array, Array]:
        """Return the parameters (K, P) and the states (K, n) of a segment's simulations."""
        count, n = len(self.table.free), self.model.state_sizes.size
        extra = n if part.column >= 0 else 0
        steps = self.difference * np.eye(count + extra) if perturbed else np.zeros((0, count + extra))
        steps = np.vstack([np.zeros(count + extra), steps])
        values = self.table.values(z[:count] + steps[:, :count])
        if part.column < 0:
            return values, self.model.start(values)
        return values, self.model.state_sizes * (z[part.column : part.column + n] + steps[:, count:])

    def _simulate(self, jobs: Sequence[tuple[_Segment, Array, Array]]) -> tuple[list[Array], list[Array]]:
        """Return outputs (K, N, Y) and end states (K, n) of every job, computed in threads."""
        heavy = sum((part.end - part.begin) * len(values) for part, values, _ in jobs) > _HEAVY
        pieces: list[tuple[_Segment, Array, Array]] = []
        owners: list[int] = []
        for number, (part, values, states) in enumerate(jobs):
            count = max(1, min(usable_processors(), len(values) // _TOGETHER)) if heavy else 1
            for rows in np.array_split(np.arange(len(values)), count):
                pieces.append((part, values[rows], states[rows]))
                owners.append(number)
        with np.errstate(all="ignore"):
            found = for_each(pieces, self._piece) if heavy else [self._piece(piece) for piece in pieces]
        whole = [[f for f, owner in zip(found, owners, strict=True) if owner == k] for k in range(len(jobs))]
        return [np.concatenate([y for y, _ in f]) for f in whole], [np.concatenate([x for _, x in f]) for f in whole]

    def _piece(self, piece: tuple[_Segment, Array, Array]) -> tuple[Array, Array]:
        return self._run(*piece)

    def _run(self, part: _Segment, values: Array, states: Array) -> tuple[Array, Array]:
        record = self.records[part.record]
        inputs = record.inputs[part.begin : part.end + 1]
        if part.end == len(record.inputs):
            inputs = np.vstack([inputs, inputs[-1:]])
        return self.model.run(values, states, inputs, record.rate)


def _finite(values: Array, otherwise: float = _DIVERGED) -> Array:
    return np.nan_to_num(values, nan=otherwise, posinf=otherwise, neginf=-otherwise)


def _bounded(signals: Array, noise: Array) -> Array:
    """Return signals (..., Y) in which values that overflowed are large and finite."""
    limit = _DIVERGED * noise
    return np.clip(np.nan_to_num(signals, nan=_DIVERGED, posinf=_DIVERGED, neginf=-_DIVERGED), -limit, limit)
