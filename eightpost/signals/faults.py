"""Origin of signals, and faults in them: gaps, repeated times, spikes."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from eightpost.array_types import Array
from eightpost.errors import (
    BackwardTimeError,
    ConstantChannelError,
    DuplicateTimeError,
    NotANumberError,
    TimeGapError,
    TooShortError,
    WrongSignError,
)

if TYPE_CHECKING:
    from eightpost.errors import DataError


@dataclass(frozen=True, slots=True, eq=False)
class Origin:
    """File of a record and line number of each sample."""

    path: Path | None = None  #: Path of the file, or None for a record created in memory.
    #: One-based line number (N,) of each sample in a text file; None in other files and in memory.
    lines: NDArray[np.int64] | None = None
    header_line: int | None = None  #: Number of the line with the channel names and units, None for binary files.

    def at(self, samples: NDArray[np.intp]) -> Origin:
        """Return the origin of a record of some samples (K,) of this one, in any order."""
        return replace(self, lines=None if self.lines is None else self.lines[samples])

    def fault(self, kind: type[DataError], what: str, *, channel: str, sample: int) -> DataError:
        """Return an exception of the class `kind` about a zero-based sample."""
        if self.lines is None:
            return kind(what, path=self.path, sample=sample + 1, channel=channel)
        return kind(what, path=self.path, line=int(self.lines[sample]), channel=channel)

    def header_fault(self, kind: type[DataError], what: str, *, channel: str | None = None) -> DataError:
        """Return an exception of the class `kind` about a whole column."""
        return kind(what, path=self.path, line=self.header_line, channel=channel)


WEAK_SIGN = 0.3  #: A correlation above minus this is not one of a wrong sign.
IN_MEMORY = Origin()  #: Origin of a record created in memory.


# ---- Checks for faults in measured records; each fault has its own exception, which says where and ------------------

GAP_FACTOR = 1.5  #: A step longer than this many median steps is a gap.
#: A channel is clipped if sequences of at least this many samples are equal to its maximum or minimum, ...
CLIP_RUN = 5
CLIP_SHARE = 0.005  #: ... if these samples are at least this share of the record, ...
#: ... and if they exceed this multiple of the samples at the next level (a rounded sine reaches 2.5).
CLIP_CROWDING = 5.0
_LARGEST = 1e100  #: No sensor measures that (SI); its square is still a number.


def check_finite(values: Array, *, channel: str, origin: Origin = IN_MEMORY) -> None:
    """Raise NotANumberError at the first NaN or infinite sample of `values` (N,)."""
    with np.errstate(over="ignore", invalid="ignore"):
        total = values.sum()  # not finite if a sample is not finite; faster than checking each sample
    if np.isfinite(total):
        return
    bad = np.flatnonzero(~np.isfinite(values))
    if bad.size:
        value = values[bad[0]]
        what = "NaN, or the cell is empty" if np.isnan(value) else str(value)
        raise origin.fault(
            NotANumberError,
            f"the value is {what} ({bad.size} of {values.size} samples); repair the record, cut "
            "these samples out, or bridge short gaps by straight lines: --channel bridge=20 (samples in a row)",
            channel=channel,
            sample=int(bad[0]),
        )


def check_time(time: Array, *, origin: Origin = IN_MEMORY) -> None:
    """Raise BackwardTimeError or DuplicateTimeError where `time` (N,) [s] does not increase."""
    bad = np.flatnonzero(np.diff(time) <= 0.0)
    if not bad.size:
        return
    sample = int(bad[0]) + 1
    before, after = time[sample - 1], time[sample]
    if after < before:
        raise origin.fault(
            BackwardTimeError,
            f"time decreases from {before:.9g} s to {after:.9g} s ({bad.size} such places); "
            "sort the record, or split it where two runs were joined",
            channel="time",
            sample=sample,
        )
    raise origin.fault(
        DuplicateTimeError,
        f"the time {after:.9g} s is repeated ({bad.size} such places); "
        "remove the repeated samples, or export time with more digits",
        channel="time",
        sample=sample,
    )


def check_gaps(time: Array, *, origin: Origin = IN_MEMORY) -> None:
    """Raise TimeGapError where a step of `time` (N,) [s] exceeds 1.5 median steps."""
    steps = np.diff(time)
    median = float(np.median(steps)) if steps.size else 0.0
    bad = np.flatnonzero(steps > GAP_FACTOR * median)
    if bad.size:
        sample = int(bad[0])
        raise origin.fault(
            TimeGapError,
            f"there is a gap of {steps[sample]:.6g} s between {time[sample]:.9g} s and {time[sample + 1]:.9g} s, "
            f"while the median step is {median:.6g} s (number of gaps: {bad.size}); "
            "use a part without gaps, or fill the gaps",
            channel="time",
            sample=sample + 1,
        )


def check_length(time: Array, *, shortest: float, fewest: int, origin: Origin = IN_MEMORY) -> None:
    """Raise TooShortError if `time` (N,) [s] spans less than `shortest` [s] or has fewer than `fewest` samples."""
    span = float(time[-1] - time[0])
    if span < shortest or time.size < fewest:
        raise origin.fault(
            TooShortError,
            f"the record has {time.size} samples over {span:.4g} s; at least {fewest} samples over "
            f"{shortest:g} s are needed: record longer or export at a higher sample rate",
            channel="time",
            sample=time.size - 1,
        )


def check_moves(values: Array, *, channel: str, origin: Origin = IN_MEMORY) -> None:
    """Raise ConstantChannelError if `values` (N,) are constant except for rounding, NotANumberError if one is huge."""
    sizes = np.abs(values)
    sample = int(np.argmax(sizes))
    if sizes[sample] >= _LARGEST:
        what = f"the value is {values[sample]:g} (SI); repair the record, or cut this sample out"
        raise origin.fault(NotANumberError, what, channel=channel, sample=sample)
    if float(np.ptp(values)) <= 1e-12 * float(sizes[sample]):
        raise origin.fault(
            ConstantChannelError,
            f"the channel is constant at {values[0]:.6g} (SI); "
            "check the sensor's cable and the column that the channel is read from",
            channel=channel,
            sample=0,
        )


def clipped_samples(values: Array, moving: NDArray[np.bool_]) -> NDArray[np.intp]:
    """Return the indices (K,) of the samples that are clipped at the maximum; empty without clipping.

    Args:
        values: Samples of the channel (N,).
        moving: Whether each sample (N,) can be clipped; false while the channel that drives it is constant.
    """
    tolerance = 1e-9 * float(np.ptp(values))
    top = float(values.max())
    at_top = values >= top - tolerance
    none = np.empty(0, dtype=np.intp)
    long = [np.arange(start, stop) for start, stop in runs(at_top) if stop - start >= CLIP_RUN]
    samples = np.concatenate([np.empty(0, dtype=np.intp), *long])
    samples = samples[moving[samples]]
    if samples.size < CLIP_SHARE * values.size or at_top.all():
        return none
    next_level = float(values[~at_top].max())
    crowd = np.count_nonzero((values >= next_level - tolerance) & ~at_top)
    return samples if samples.size > CLIP_CROWDING * crowd else none


def runs(flags: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Return the first sample and the sample after the last of each run of true flags (N,)."""
    edges = np.flatnonzero(np.diff(flags.astype(np.int8), prepend=0, append=0))
    return list(zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True))


#: Smallest mean force at low speed that shows the sign of the gas force, as a share of the force's range.
GAS_SHARE = 0.015


def _likely_reversed(force: Array, motion: Array, channel: str, against: str) -> tuple[str, str]:
    """Return which of two channels that contradict each other is to be reversed, and the condition in words.

    A gas force, which is left at low speed, is positive.
    """
    level = float(np.mean(force[np.abs(motion) <= np.quantile(np.abs(motion), 0.1)]))
    if channel != "force" or abs(level) < GAS_SHARE * float(np.ptp(force)):
        return channel, f"{against} is right"
    other = against.rpartition("derived from ")[2]
    reversed_, sign = (other, "positive") if level > 0.0 else (channel, "negative")
    return reversed_, f"the force at low speed, which is {sign}, is that of the gas"


def check_sign(
    values: Array, reference: Array, *, channel: str, against: str, origin: Origin = IN_MEMORY, stated: str = ""
) -> None:
    """Raise WrongSignError if `values` (N,) correlate negatively with `reference` (N,).

    A damper's force opposes its motion, so with the project's signs (both positive in compression) force and velocity
    correlate positively.

    Args:
        values: Samples of the channel (N,).
        reference: Samples of the other channel (N,).
        channel: Name of the channel.
        against: Name of the other channel.
        origin: Origin of the record.
        stated: Statement of the file on its signs, according to which the channels were read; empty without one.
    """
    correlation = float(np.corrcoef(values, reference)[0, 1])
    if correlation < 0.0:
        other = against.rpartition("derived from ")[2]
        likely, why = _likely_reversed(values, reference, channel, against)
        rest = other if likely == channel else channel
        advice = (
            f"so one of the two has the wrong sign (both must be positive in compression): `--channel {likely}=-` if "
            f"{why}, otherwise `--channel {rest}=-`, or gain = -1 in the channel map. A wrong choice "
            "swaps compression and rebound; check that the gas force is positive"
        )
        if correlation > -WEAK_SIGN:
            advice = "so it does not follow it; check the column, its delay, and its sign (--channel)"
        raise origin.header_fault(
            WrongSignError,
            (f"the file states {stated!r} (--channel replaces it), but " if stated else "")
            + f"its correlation with {against} is {correlation:.3f}, {advice}",
            channel=channel,
        )
