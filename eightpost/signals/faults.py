"""Faults of measured records, each with its own error that says where, what and what to do.

Every check returns nothing and raises on the first fault it meets.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from eightpost.errors import (
    BackwardTimeError,
    ClippedChannelError,
    ConstantChannelError,
    DuplicateTimeError,
    NotANumberError,
    TimeGapError,
    TooShortError,
    WrongSignError,
)
from eightpost.signals.origin import IN_MEMORY, Origin

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]

#: A step longer than this many median steps is a gap.
GAP_FACTOR = 1.5

#: A channel is clipped when runs of at least this many samples sit at its end value ...
CLIP_RUN = 5
#: ... make up at least this share of the record ...
CLIP_SHARE = 0.005
#: ... and outnumber the samples at the next level below this many times (a rounded sine reaches 2.5).
CLIP_CROWDING = 5.0


def check_finite(values: Array, *, channel: str, origin: Origin = IN_MEMORY) -> None:
    """Raise NotANumberError at the first NaN or infinite sample of `values` (N,)."""
    with np.errstate(over="ignore", invalid="ignore"):
        total = values.sum()  # in which stays what is not finite: quicker than to look at each
    if np.isfinite(total):
        return
    bad = np.flatnonzero(~np.isfinite(values))
    if bad.size:
        value = values[bad[0]]
        what = "NaN, or the cell is empty" if np.isnan(value) else str(value)
        raise origin.fault(
            NotANumberError,
            f"the value is {what} ({bad.size} such of {values.size}); repair the record or cut those samples out",
            channel=channel,
            sample=int(bad[0]),
        )


def check_time(time: Array, *, channel: str = "time", origin: Origin = IN_MEMORY) -> None:
    """Raise BackwardTimeError or DuplicateTimeError where `time` (N,) [s] does not increase."""
    bad = np.flatnonzero(np.diff(time) <= 0.0)
    if not bad.size:
        return
    sample = int(bad[0]) + 1
    before, after = time[sample - 1], time[sample]
    if after < before:
        raise origin.fault(
            BackwardTimeError,
            f"time goes back from {before:.9g} s to {after:.9g} s ({bad.size} such places); "
            "sort the record, or split it where two runs were joined",
            channel=channel,
            sample=sample,
        )
    raise origin.fault(
        DuplicateTimeError,
        f"the time {after:.9g} s comes twice ({bad.size} such places); "
        "remove the repeated samples, or export time with more digits",
        channel=channel,
        sample=sample,
    )


def check_gaps(time: Array, *, channel: str = "time", origin: Origin = IN_MEMORY) -> None:
    """Raise TimeGapError where a step of `time` (N,) [s] exceeds 1.5 median steps."""
    steps = np.diff(time)
    median = float(np.median(steps)) if steps.size else 0.0
    bad = np.flatnonzero(steps > GAP_FACTOR * median)
    if bad.size:
        sample = int(bad[0])
        raise origin.fault(
            TimeGapError,
            f"a gap of {steps[sample]:.6g} s between {time[sample]:.9g} s and {time[sample + 1]:.9g} s, "
            f"where the usual step is {median:.6g} s ({bad.size} such gaps); "
            "use a part without a gap, or fill it",
            channel=channel,
            sample=sample + 1,
        )


def check_length(
    time: Array, *, shortest: float, fewest: int, channel: str = "time", origin: Origin = IN_MEMORY
) -> None:
    """Raise TooShortError when `time` (N,) [s] spans under `shortest` [s] or has under `fewest` samples."""
    span = float(time[-1] - time[0])
    if span < shortest or time.size < fewest:
        raise origin.fault(
            TooShortError,
            f"the record has {time.size} samples over {span:.4g} s; at least {fewest} samples over "
            f"{shortest:g} s are needed: record longer or export at a higher rate",
            channel=channel,
            sample=time.size - 1,
        )


def check_moves(values: Array, *, channel: str, origin: Origin = IN_MEMORY) -> None:
    """Raise ConstantChannelError when `values` (N,) never change by more than rounding."""
    if float(np.ptp(values)) <= 1e-12 * float(np.max(np.abs(values))):
        raise origin.fault(
            ConstantChannelError,
            f"the channel is {values[0]:.6g} (SI) from the first sample to the last; "
            "check the sensor's cable and the column that the channel is read from",
            channel=channel,
            sample=0,
        )


def check_not_clipped(values: Array, *, channel: str, origin: Origin = IN_MEMORY, against: Array | None = None) -> None:
    """Raise ClippedChannelError when `values` (N,) sit at their highest or lowest value.

    Clipped means: runs of at least `CLIP_RUN` samples at the end value make up `CLIP_SHARE` of the record
    and outnumber `CLIP_CROWDING` times the samples at the next level below, so that the rounded top of a
    slow sine passes.

    Args:
        values: (N,) the channel.
        channel: Its name.
        origin: Where it came from.
        against: (N,) what drives the channel; samples over which it does not change at all are no evidence
            (a computed constant-speed run has a truly constant force).
    """
    moving = np.ones(values.size, dtype=bool) if against is None else np.gradient(against) != 0.0
    for signed, end in ((values, "highest"), (-values, "lowest")):
        clipped = clipped_samples(signed, moving)
        if clipped.size:
            raise origin.fault(
                ClippedChannelError,
                f"{clipped.size} of {values.size} samples sit at the {end} value "
                f"{values[clipped[0]]:.6g} (SI): the sensor or its amplifier is clipped; "
                "record again with a larger range, or use a part below it",
                channel=channel,
                sample=int(clipped[0]),
            )


def clipped_samples(values: Array, moving: NDArray[np.bool_]) -> NDArray[np.intp]:
    """Return the samples that are clipped at the maximum of `values` (N,), empty when none are."""
    tolerance = 1e-9 * float(np.ptp(values))
    top = float(values.max())
    at_top = values >= top - tolerance
    none = np.empty(0, dtype=np.intp)
    samples = np.flatnonzero(_in_long_runs(at_top) & moving)
    if samples.size < CLIP_SHARE * values.size or at_top.all():
        return none
    next_level = float(values[~at_top].max())
    crowd = np.count_nonzero((values >= next_level - tolerance) & ~at_top)
    return samples if samples.size > CLIP_CROWDING * crowd else none


def _in_long_runs(flags: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Keep the True samples (N,) that belong to runs of at least `CLIP_RUN`."""
    edges = np.diff(np.concatenate(([0], flags.astype(np.int8), [0])))
    starts, stops = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)
    kept = np.zeros(flags.size, dtype=bool)
    for start, stop in zip(starts, stops, strict=True):
        kept[start:stop] = stop - start >= CLIP_RUN
    return kept


def check_sign(values: Array, reference: Array, *, channel: str, against: str, origin: Origin = IN_MEMORY) -> None:
    """Raise WrongSignError when `values` (N,) correlate negatively with `reference` (N,).

    A damper's force opposes its motion, so with the project's signs (both positive in compression) force and
    velocity correlate positively.
    """
    correlation = float(np.corrcoef(values, reference)[0, 1])
    if correlation < 0.0:
        raise origin.header_fault(
            WrongSignError,
            f"it correlates with {against} at {correlation:.3f}, so one of them is positive the other way "
            f"(both must be positive in compression); set gain = -1 in the channel map, or pass --flip, for the one "
            f"that is wrong: `--flip {channel}` if {against} is right, else that of {against}. A wrong choice swaps "
            "compression and rebound; gas force tells: it must come out positive",
            channel=channel,
        )
