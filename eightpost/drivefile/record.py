"""Records of the rig: synchronisation with the drive file, and checks."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.signal import correlate, correlation_lags

from eightpost.array_types import Array, Complex
from eightpost.drivefile.iteration import Problem
from eightpost.drivefile.target import at_rate, read_channels
from eightpost.errors import DataError, TooShortError, WrongSignError
from eightpost.signals import ChannelMap, TimeSeries

#: Minimum correlation of a record's commands, or of its wheelloader positions, with the drive file [1].
_SAME_DRIVE = 0.9

#: Lag of positions that is attributed to the wheelloaders, not to the logger [s].
_FOLLOWING = 0.02

#: Correlation of the measured and the predicted channel below which the sign is wrong, and below which it is noted [1].
_OPPOSITE, _UNLIKE = -0.3, 0.3


class RigRecord(NamedTuple):
    """Record of a pass on the time axis of the drive file."""

    rows: Array  #: Target channels (p, N), SI, with their means.
    notes: tuple[str, ...]  #: Notes for the user, one sentence each.


def read_rig_record(
    path: str | Path,
    problem: Problem,
    drive: Array,
    *,
    channel_map: ChannelMap | None = None,
    units: Mapping[str, str] | None = None,
    flip: Iterable[str] = (),
) -> RigRecord:
    """Read the record of a drive, and synchronise it with the drive.

    The record is shifted so that its commands (`lf.road_command`), or otherwise its wheelloader positions (`lf.road`),
    agree with the drive. The logger may have started earlier.

    Args:
        path: Path of the record, in any format of `read_series`.
        problem: Target, response and settings.
        drive: Commands (m, N) that were played.
        channel_map: Columns by channel (docs/explanation/rig.md).
        units: Units by channel, for columns without a unit in the header.
        flip: Names of the channels whose sign is changed.

    Raises:
        DataError: The record has a fault, or is not a record of this drive.
    """
    roads = [name for name, unit in zip(problem.inputs, problem.units, strict=True) if unit == "m"]
    optional = (*(f"{name}_command" for name in roads), *roads)
    series = read_channels(
        path, problem.target.names, optional=optional, channel_map=channel_map, units=units, flip=flip
    )
    if series.sample_rate < 0.999 * min(problem.target.rate, 2.5 * problem.target.high):
        raise DataError(
            f"the record has {series.sample_rate:g} Hz, but errors are evaluated up to {problem.target.high:g} Hz; "
            f"record at {problem.target.rate:g} Hz",
            path=path,
        )
    series = at_rate(series, problem.target.rate)
    _check_length(series, problem, len(series), Path(path))
    start, notes = _start(series, problem, drive, roads, Path(path))
    return RigRecord(_cut(series, problem, start, Path(path)), notes)


def _start(
    series: TimeSeries, problem: Problem, drive: Array, roads: list[str], path: Path
) -> tuple[int, tuple[str, ...]]:
    """Return the sample of the record at which the drive starts, and notes."""
    by_command = all(f"{name}_command" in series for name in roads)
    if not by_command and not all(name in series for name in roads):
        return 0, (f"{path.name} has neither commands nor positions of the wheelloaders; it was taken to start with "
                   "the drive file.",)  # fmt: skip
    rows = [problem.inputs.index(name) for name in roads]
    played = drive[rows] - drive[rows].mean(axis=1, keepdims=True)
    measured = np.stack([series[f"{name}_command" if by_command else name] for name in roads])
    measured = measured - measured.mean(axis=1, keepdims=True)
    if not np.any(played):
        return 0, ()
    likeness = sum(correlate(m, p, method="fft") for m, p in zip(measured, played, strict=True))
    lags = correlation_lags(measured.shape[1], played.shape[1])
    found = int(np.argmax(likeness))
    size = float(np.linalg.norm(measured) * np.linalg.norm(played))
    share = float(np.asarray(likeness)[found]) / max(size, 1e-300)
    if share < _SAME_DRIVE:
        what = "commands" if by_command else "wheelloader positions"
        raise DataError(
            f"its {what} do not agree with the drive file (correlation {share:.2f}); give the record of the last drive "
            "file that was written",
            path=path,
        )
    lag = int(lags[found])
    if not by_command and abs(lag) <= _FOLLOWING * problem.target.rate:
        return 0, ()
    if lag == 0:
        return 0, ()
    order = "before" if lag > 0 else "after"
    return lag, (f"{path.name} starts {abs(lag) / problem.target.rate:.3f} s {order} the drive file.",)


def _cut(series: TimeSeries, problem: Problem, start: int, path: Path) -> Array:
    """Return the target channels (p, N) from a sample on; the rests at both ends may be shorter."""
    target, count = problem.target, problem.target.lines.samples
    rows = np.stack([series[name] for name in target.names])
    before, after = max(-start, 0), max(start + count - rows.shape[1], 0)
    _check_length(series, problem, count - 2 * max(before, after), path)
    return np.pad(rows[:, max(start, 0) : start + count], ((0, 0), (before, after)), mode="edge")


def _check_length(series: TimeSeries, problem: Problem, covered: int, path: Path) -> None:
    """Refuse a record that covers too few samples of the drive file; half of each rest may be missing."""
    target, count = problem.target, problem.target.lines.samples
    if covered < count - 2 * (target.rest // 2):
        raise TooShortError(
            f"it covers {series.duration:.2f} s, but the drive file has {count / target.rate:.2f} s; record the whole "
            "drive file",
            path=path,
        )


def check_signs(problem: Problem, H: Complex, drive: Array, record: RigRecord, path: Path) -> tuple[str, ...]:
    """Return notes on channels that do not agree with the prediction.

    Args:
        problem: Target, response and settings.
        H: Response (K, p, m) before the pass.
        drive: Commands (m, N) that were played.
        record: Record of the pass.
        path: File of the record, for messages.

    Raises:
        WrongSignError: A channel has the opposite sign of its prediction.
    """
    target = problem.target
    X = target.lines.spectrum(drive - drive[:, :1])
    predicted = np.einsum("kij,kj->ki", H, X)
    measured = target.lines.spectrum(target.without_means(record.rows)[0])
    product = np.real(np.sum(measured * np.conj(predicted), axis=0))
    size = np.linalg.norm(measured, axis=0) * np.linalg.norm(predicted, axis=0)
    notes = []
    for name, value in zip(target.names, product / np.maximum(size, 1e-300), strict=True):
        if value < _OPPOSITE:
            raise WrongSignError(
                f"its correlation with the prediction is {value:.2f}, so its sign is reversed; reverse it (--flip "
                f"{name}) if it also was in the track record",
                path=path,
                channel=name,
            )
        if value < _UNLIKE:
            notes.append(f"{name} barely agrees with the prediction (correlation {value:.2f}); check sensor and car.")
    return tuple(notes)
