"""Correction of the response between passes, and gains from coherence, by channel and band."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from eightpost.array_types import Array, Complex
from eightpost.drivefile.lines import Lines

#: Weight of a step relative to the step after it [1].
_MEMORY = 0.5

#: Weight of the starting response relative to that of the steps [1].
_PRIOR = 0.1

#: Minimum gain relative to the maximum gain [1]; a channel without coherence is not abandoned.
_LOWEST = 0.15

#: Gain where the identification has no coherence, for example above its band [1].
_UNKNOWN = 0.6

#: Power of a step, relative to that of the target, below which it carries no information [1].
_NO_STEP = 1e-16


class PassSpectra(NamedTuple):
    """Lines of one pass."""

    drive: Complex  #: Commands (K, m).
    record: Complex  #: Target channels measured on the rig (K, p).


@dataclass(frozen=True, slots=True, eq=False)
class Correction:
    """Correction of the starting response by the passes so far."""

    factor: Complex  #: Factor of each target channel (K, p), by which the starting response is multiplied.
    coherence: Array  #: Coherence of the predicted and the measured change in the last step (K, p) [1].


def correction(H: Complex, passes: Sequence[PassSpectra], lines: Lines, width: float) -> Correction:
    """Return the correction from the changes between successive passes.

    A step from one pass to the next changes the drive by dX and the record by dY. With the prediction dP = H dX, the
    factor c of a channel in a band minimises

        sum_steps w |dY - c dP|^2 + prior |c - 1|^2

    Later steps and steps with high coherence have larger weights, because the car's response to small changes about the
    target is needed, and noise and drift from pass to pass must not enter it. The first step is that from rest.

    Args:
        H: Starting response (K, p, m).
        passes: Passes in their order.
        lines: Lines of the drive file.
        width: Width of the bands [Hz].
    """
    measured = np.zeros((len(H), H.shape[1]), dtype=np.complex128)
    predicted = np.zeros(measured.shape)
    coherence = np.ones(measured.shape)
    before = PassSpectra(np.zeros_like(passes[0].drive), np.zeros_like(passes[0].record))
    for now in passes:
        dP = np.einsum("kij,kj->ki", H, now.drive - before.drive)
        dY = now.record - before.record
        power, cross = lines.band_sum(np.abs(dP) ** 2, width), lines.band_sum(dY * np.conj(dP), width)
        moved = power > _NO_STEP * np.max(np.abs(now.record) ** 2, initial=1e-300)
        likeness = _coherence(cross, power, dY, lines, width)
        weight = np.where(moved, likeness / np.sqrt(np.where(moved, power, 1.0)), 0.0)
        measured = _MEMORY * measured + weight * cross
        predicted = _MEMORY * predicted + weight * power
        coherence = np.where(moved, likeness, coherence)
        before = now
    known = predicted > 0.0
    total = np.where(known, (1.0 + _PRIOR) * predicted, 1.0)
    factor = np.where(known, (measured + _PRIOR * predicted) / total, 1.0)
    return Correction(np.asarray(factor, dtype=np.complex128), np.asarray(coherence, dtype=np.float64))


def _coherence(cross: Complex, power: Array, dY: Complex, lines: Lines, width: float) -> Array:
    """Return the coherence (K, p) in bands, without the bias 1 / n of an estimate from n lines."""
    whole = np.maximum(power * lines.band_sum(np.abs(dY) ** 2, width), 1e-300)
    count = lines.band_sum(np.ones(len(dY)), width)[:, None]
    raw = np.abs(cross) ** 2 / whole
    return np.asarray(np.clip((raw - 1.0 / count) / (1.0 - 1.0 / count), 0.0, 1.0))


def start_gains(coherence: Array | None, shape: tuple[int, int], highest: float) -> Array:
    """Return the gains (K, p) of the first pass.

    Args:
        coherence: Coherence of the identification (p, K); None if it is not known, which is then taken as 1.
        shape: Numbers K of lines and p of channels.
        highest: Maximum gain [1].
    """
    if coherence is None:
        return np.full(shape, highest)
    return np.asarray(highest * np.maximum(coherence.T, _UNKNOWN))


def gains(coherence: Array, highest: float) -> Array:
    """Return the gains (K, p) for the coherence of the last step: `highest` times the coherence.

    If noise or drift from pass to pass dominates a step, its coherence is low and so is the gain. The drive then
    averages over the passes.
    """
    return np.asarray(highest * np.maximum(coherence, _LOWEST))
