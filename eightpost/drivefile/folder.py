"""Folder of an iteration: settings, target, response, and a folder for each pass with its drive and its record."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.signal import correlate, correlation_lags

import eightpost
from eightpost.array_types import Array, Complex
from eightpost.drivefile.iteration import Outcome, Pass, Problem, Settings, StartResponse, Status, advance
from eightpost.drivefile.target import LimitHit, Limits, Target, at_rate, read_channels
from eightpost.errors import DataError, FileFormatError, InputError, TooShortError, WrongSignError
from eightpost.files import MALFORMED, atomic_path, check_schema, json_content, sha256_of
from eightpost.ident.response import read_response, write_response
from eightpost.outputs import check_folder
from eightpost.signals import ChannelMap, Drivefile, TimeSeries
from eightpost.signals.formats import read_series, write_series
from eightpost.verdict import Verdict, edited, is_intact, sealed
from eightpost.virtual.program import Bench

# ---- Records of the rig: synchronisation with the drive file, and checks --------------------------------------------

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


# ---- The folder -----------------------------------------------------------------------------------------------------

#: Newest schema of iteration.json that can be read; it is also the one that is written.
SCHEMA = 1

#: File formats in which drive files are written beside Parquet.
FORMATS = ("parquet", "csv", "mat", "drv")

_STATE = "iteration.json"


@dataclass(frozen=True)
class IterationFolder:
    """An iteration in a folder. Every result is computed from its files, so it can resume at any point."""

    path: Path  #: Folder.
    problem: Problem  #: Target, response and settings.
    sources: Mapping[str, str]  #: SHA-256 digests of the files of track record and car, by name.
    suffix: str  #: Format of the drive files for the rig, one of `FORMATS`.
    edits: Verdict = field(default_factory=Verdict)  #: Reason if iteration.json was edited.

    @classmethod
    def start(
        cls, path: str | Path, problem: Problem, *, sources: Mapping[str, str] | None = None, suffix: str = "parquet"
    ) -> IterationFolder:
        """Create the folder and write the first drive file.

        Args:
            path: Folder, which must not contain an iteration.
            problem: Target, response and settings.
            sources: SHA-256 digests of the files of track record and car, by name.
            suffix: Format of the drive files for the rig.

        Raises:
            InputError: The folder contains an iteration, or is a file.
        """
        path = Path(path)
        check_folder(path)
        if (path / _STATE).exists():
            raise InputError(f"{path} contains an iteration; choose another folder with -o, or continue it with next")
        path.mkdir(parents=True, exist_ok=True)
        write_series(problem.target.series, path / "target.parquet")
        write_response(path / "response.npz", problem.start.response, sources=sources)
        settings = asdict(problem.settings)
        content = {
            "kind": "drivefile_iteration",
            "schema": SCHEMA,
            "tool": f"eightpost {eightpost.__version__}",
            "high": problem.target.high,
            "settings": settings,
            "static": problem.start.static.tolist(),
            "notes": list(problem.start.notes),
            "sources": dict(sources or {}),
            "format": suffix,
        }
        _write_json(path / _STATE, sealed(content))
        folder = cls.read(path)
        folder.write_next()
        return folder

    @classmethod
    def read(cls, path: str | Path) -> IterationFolder:
        """Read a folder.

        Raises:
            FileFormatError: The folder does not contain an iteration of this version.
        """
        path = Path(path)
        content = json_content(path / _STATE, advice="start an iteration with eightpost drivefile start")
        if not isinstance(content, dict) or content.get("kind") != "drivefile_iteration":
            raise FileFormatError("is not the state of a drive file iteration", path=path / _STATE)
        check_schema(content, SCHEMA, path / _STATE)
        try:
            settings = Settings(**{**content["settings"], "limits": Limits(**content["settings"]["limits"])})
            start = StartResponse(
                read_response(path / "response.npz"),
                np.asarray(content["static"], dtype=np.float64),
                tuple(content["notes"]),
            )
            target = Target(read_series(path / "target.parquet"), float(content["high"]))
            edits = Verdict() if is_intact(content) else edited(_STATE)
            return cls(path, Problem(target, start, settings), dict(content["sources"]), str(content["format"]), edits)
        except InputError:
            raise
        except MALFORMED as error:
            what = f"does not contain the state of an iteration in the format of this version ({error})"
            raise FileFormatError(what, path=path / _STATE) from error

    def pass_path(self, number: int) -> Path:
        """Return the folder of a pass, counted from 1."""
        return self.path / f"pass_{number:02d}"

    def drive_path(self, number: int) -> Path:
        """Return the drive file of a pass in the format for the rig."""
        return self.pass_path(number) / f"drive.{self.suffix}"

    @property
    def played(self) -> int:
        """Number of passes with a record."""
        number = 0
        while (self.pass_path(number + 1) / "record.parquet").is_file():
            number += 1
        return number

    @property
    def waiting(self) -> int | None:
        """Number of the pass whose drive file waits for its record; None after divergence."""
        number = self.played + 1
        return number if (self.pass_path(number) / "drive.parquet").is_file() else None

    @cached_property
    def _read_passes(self) -> dict[int, Pass]:
        return {}

    def passes(self) -> list[Pass]:
        """Return all passes with a record."""
        known = self._read_passes
        for number in range(1, self.played + 1):
            if number not in known:
                record = read_series(self.pass_path(number) / "record.parquet")
                known[number] = Pass(self.drive(number), record.select(self.problem.target.names).values)
        return [known[number] for number in range(1, self.played + 1)]

    def drive(self, number: int) -> Array:
        """Return the commands (m, N) of a pass."""
        return read_series(self.pass_path(number) / "drive.parquet").select(self.problem.inputs).values

    @cached_property
    def _outcomes(self) -> dict[int, Outcome]:
        return {}

    def outcome(self) -> Outcome:
        """Return the state after all passes with a record."""
        number = self.played
        if number not in self._outcomes:
            self._outcomes.clear()
            self._outcomes[number] = advance(self.problem, self.passes())
        return self._outcomes[number]

    def add_record(
        self,
        source: str | Path,
        *,
        channel_map: ChannelMap | None = None,
        units: Mapping[str, str] | None = None,
        flip: Iterable[str] = (),
    ) -> tuple[str, ...]:
        """Add the rig's record of the last drive file; see `read_rig_record`.

        Returns:
            Notes for the user, one sentence each.

        Raises:
            InputError: No drive file waits for a record.
            DataError: The record has a fault, or is not a record of the drive file.
        """
        number = self.waiting
        if number is None:
            raise InputError(
                f"{self.path}: no drive file waits for a record; write the next one with next, no --record"
            )
        before, drive = self.outcome(), self.drive(number)
        record = read_rig_record(source, self.problem, drive, channel_map=channel_map, units=units, flip=flip)
        notes = (*record.notes, *check_signs(self.problem, before.H, drive, record, Path(source)))
        target = self.problem.target
        series = TimeSeries(target.time, record.rows, target.names, target.units)
        _write_json(self.pass_path(number) / "source.json",
                    {"record": Path(source).name, "sha256": sha256_of(source), "notes": list(notes)})  # fmt: skip
        write_series(series, self.pass_path(number) / "record.parquet")
        return notes

    def write_next(self) -> Outcome:
        """Write the errors of the last pass, the best drive, and the next drive file unless the iteration diverged.

        Files that exist are computed again and replaced, so an interrupted call can be repeated.
        """
        outcome, number = self.outcome(), self.played
        if number:
            _write_json(self.pass_path(number) / "errors.json", self._pass_content(outcome))
        if outcome.best >= 0:
            self._write_drive(self.path / "best_drive", self.drive(outcome.best + 1))
        if outcome.status is not Status.DIVERGED:
            self._write_drive(self.pass_path(number + 1) / "drive", outcome.drive)
            _write_json(self.pass_path(number + 1) / "limits.json", [hit.to_json() for hit in outcome.hits])
        return outcome

    def _pass_content(self, outcome: Outcome) -> dict[str, Any]:
        return {
            "pass": len(outcome.errors),
            "status": outcome.status.value,
            "best": outcome.best + 1,
            "rejections": outcome.rejections,
            **outcome.errors[-1].to_json(),
        }

    def _write_drive(self, stem: Path, commands: Array) -> None:
        """Write commands as Parquet, which later passes read, and in the format for the rig."""
        stem.parent.mkdir(parents=True, exist_ok=True)
        series = self.problem.series(commands)
        if self.suffix != "parquet":
            write_series(series, stem.with_suffix(f".{self.suffix}"))
        write_series(series, stem.with_suffix(".parquet"))

    def limit_hits(self, number: int) -> tuple[str, ...]:
        """Return sentences on the limits that changed the drive of a pass.

        Raises:
            FileFormatError: The file of the limits is damaged.
        """
        path = self.pass_path(number) / "limits.json"
        if not path.is_file():
            return ()
        try:
            return tuple(str(LimitHit(**hit)) for hit in json_content(path))
        except MALFORMED as error:
            raise FileFormatError(f"does not contain limits of a drive file ({error})", path=path) from error


def _write_json(path: Path, content: Any) -> None:
    with atomic_path(path) as temporary:
        temporary.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")


# ---- Passes on the virtual rig --------------------------------------------------------------------------------------

#: Name of the rig's record in the folder of a pass.
RECORD = "rig.parquet"


def play(folder: IterationFolder, bench: Bench, shocks: Sequence[str]) -> Path:
    """Play the waiting drive file on the virtual rig, and return the file of the rig's record.

    Each pass is another run with its own noise and drift.

    Args:
        folder: Iteration with a waiting drive file.
        bench: Car on the virtual rig.
        shocks: Name of the shock at each corner.
    """
    number = folder.waiting or folder.played + 1
    place = folder.pass_path(number)
    test = bench.record(Drivefile(read_series(place / "drive.parquet")), shocks, f"drive file, pass {number}", number)
    test.write(place / RECORD)
    return place / RECORD


def iterate(
    folder: IterationFolder,
    bench: Bench,
    shocks: Sequence[str],
    passes: int,
    report: Callable[[Outcome], None] | None = None,
) -> Outcome:
    """Run passes on the virtual rig until there are `passes`, or until the iteration diverged.

    Args:
        folder: Iteration, which may have passes.
        bench: Car on the virtual rig.
        shocks: Name of the shock at each corner.
        passes: Number of passes at the end, including those before.
        report: Function that receives the state after each pass; default none.
    """
    outcome = folder.write_next()
    while folder.played < passes and outcome.status is not Status.DIVERGED:
        folder.add_record(play(folder, bench, shocks))
        outcome = folder.write_next()
        if report is not None:
            report(outcome)
    return outcome
