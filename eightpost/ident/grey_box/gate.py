"""Residual gate: whether the inputs still explain a part of the residual, which an adequate model leaves as noise.

In narrow frequency bands the residual's lines are regressed on those of the inputs and of powers of the simulated
output. The regression is compared with its own remainder (F test), so the noise may have any colour and need not be
known. A missing mode shows in the inputs, a missing nonlinearity in the powers. What the records do not excite, and a
missing effect that resembles noise, cannot be seen.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from scipy.stats import f as f_distribution
from scipy.stats import norm

from eightpost.array_types import Array, Complex
from eightpost.ident.grey_box.output_error import Band, Record

#: Significance level of all tests of a fit together [1].
LEVEL = 1e-3

#: Largest part of the residual that inputs explain, over the RMS of the output [1], even if significant.
EXPLAINED = 0.02

#: Largest residual over the RMS of the output that is accepted as noise [1]; no test separates the two.
RESIDUAL = 0.05

#: Number of lines per regressor and band.
_SPARE = 3

#: Powers of the simulated output among the regressors.
_POWERS = (2, 3)

#: Smallest share of a regressor that the others do not explain, relative to its size [1].
_INDEPENDENT = 1e-6


class OutputGate(NamedTuple):
    """Residual of one output."""

    residual: float  #: RMS of the residual over that of the output [1].
    #: RMS of the part of the residual that the inputs explain, without that of chance, over the output [1].
    explained: float
    upper: float  #: Upper 95 % limit of `explained` [1].
    probability: float  #: Probability of such a relation by chance [1], corrected for the number of bands.
    frequency: float  #: Frequency at which the relation is strongest [Hz].


def failures(outputs: Mapping[str, OutputGate]) -> dict[str, str]:
    """Return a sentence on every output whose residual is neither noise nor too small to matter, by output."""
    sentences = {}
    for name, output in outputs.items():
        if output.probability < LEVEL / len(outputs) and output.upper > EXPLAINED:
            sentences[name] = (
                f"{name}: the inputs explain a part of the residual that is {100 * output.explained:.2g} % of the "
                f"output (limit {100 * EXPLAINED:g} %), most at {output.frequency:.3g} Hz; the model lacks an effect."
            )
        elif output.residual > RESIDUAL:
            sentences[name] = (
                f"{name}: the residual is {100 * output.residual:.2g} % of the output (limit {100 * RESIDUAL:g} %); "
                "it is not known whether this is noise."
            )
    return sentences


def residual_gate(
    names: Sequence[str], records: Sequence[Record], simulated: Sequence[Array], *, band: Band
) -> dict[str, OutputGate]:
    """Return the residuals of simulated outputs (N, Y) of every record, by the outputs' names."""
    outputs = {}
    simulated = [record.counted(signals) for record, signals in zip(records, simulated, strict=True)]
    records = [Record(r.counted(r.inputs), r.counted(r.outputs), r.rate) for r in records]
    for y, name in enumerate(names):
        if not all(np.isfinite(signals[:, y]).all() for signals in simulated):  # the simulation diverged
            outputs[name] = OutputGate(np.inf, np.inf, np.inf, 0.0, 0.0)
            continue
        tests = list(_tests(records, simulated, y, band))
        power = sum(_power(record.outputs[:, y], record.rate, band) for record in records)
        outputs[name] = _judged(tests, power)
    return outputs


class _Test(NamedTuple):
    """Regression in one band: centre [Hz], sums of squares explained and left, and their degrees of freedom."""

    frequency: float
    explained: float
    left: float
    regressors: int
    free: int


def _power(signal: Array, rate: float, band: Band) -> float:
    lines = band.lines(signal - signal.mean(), rate)
    return float(np.sum(np.abs(lines) ** 2))


def _tests(records: Sequence[Record], simulated: Sequence[Array], y: int, band: Band) -> Iterator[_Test]:
    plain = Band(band.low, band.high)  # the window would correlate the lines
    frequency = np.concatenate([plain.frequencies(len(r.inputs), r.rate) for r in records])
    residual = np.concatenate(
        [plain.lines(r.outputs[:, y] - s[:, y], r.rate) for r, s in zip(records, simulated, strict=True)]
    )
    signals = [_regressors(r, s[:, y]) for r, s in zip(records, simulated, strict=True)]
    columns = np.concatenate([plain.lines(x, r.rate) for x, r in zip(signals, records, strict=True)], axis=1).T
    kept = frequency > 0.0
    order = np.argsort(frequency[kept], kind="stable")
    frequency, residual, columns = frequency[kept][order], residual[kept][order], columns[kept][order]
    width = _SPARE * columns.shape[1]
    for rows in np.array_split(np.arange(frequency.size), max(1, frequency.size // width)):
        yield _regression(float(frequency[rows].mean()), residual[rows], columns[rows])


def _regressors(record: Record, simulated: Array) -> Array:
    """Return the inputs and the powers of a simulated output (R, N), of unit size."""
    deviation = simulated - simulated.mean()
    deviation = deviation / max(float(deviation.std()), 1e-300)
    rows = np.vstack([record.inputs.T, *(deviation**power for power in _POWERS)])
    rows = rows - rows.mean(axis=1, keepdims=True)
    return np.asarray(rows / np.maximum(rows.std(axis=1, keepdims=True), 1e-300))


def _regression(frequency: float, residual: Complex, columns: Complex) -> _Test:
    U, sizes, _ = np.linalg.svd(columns, full_matrices=False)
    rank = int(np.sum(sizes > _INDEPENDENT * sizes[0])) if sizes.size and sizes[0] > 0.0 else 0
    rank = min(rank, residual.size - 1)
    share = U[:, :rank].conj().T @ residual
    explained = float(np.sum(np.abs(share) ** 2))
    left = max(float(np.sum(np.abs(residual) ** 2)) - explained, 1e-300)
    return _Test(frequency, explained, left, rank, residual.size - rank)


def _judged(tests: Sequence[_Test], power: float) -> OutputGate:
    chances = np.array([_chance(test) for test in tests])
    # Stouffer's sum finds a weak relation in all bands, the smallest probability a strong one in few.
    together = float(norm.sf(np.sum(norm.isf(np.clip(chances, 1e-300, 1.0 - 1e-12))) / np.sqrt(chances.size)))
    probability = min(1.0, 2.0 * min(together, float(chances.min()) * chances.size))
    by_chance = np.array([test.left / test.free * test.regressors for test in tests])
    surplus = np.array([test.explained for test in tests]) - by_chance
    spread = np.sqrt(sum((t.left / t.free) ** 2 * t.regressors * (1.0 + t.regressors / t.free) for t in tests))
    spread = float(
        np.sqrt(spread**2 + 4.0 * max(float(surplus.sum()), 0.0) * np.mean([t.left / t.free for t in tests]))
    )
    whole = sum(test.explained + test.left for test in tests)
    return OutputGate(
        float(np.sqrt(whole / power)),
        float(np.sqrt(max(surplus.sum(), 0.0) / power)),
        float(np.sqrt(max(surplus.sum() + norm.ppf(0.95) * spread, 0.0) / power)),
        probability,
        tests[int(np.argmax(surplus))].frequency,
    )


def _chance(test: _Test) -> float:
    if test.regressors == 0 or test.free <= 0:
        return 1.0
    ratio = (test.explained / test.regressors) / (test.left / test.free)
    return float(f_distribution.sf(ratio, 2 * test.regressors, 2 * test.free))
