"""Folder of an iteration: settings, target, response, and a folder for each pass with its drive and its record."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields
from functools import cached_property
from pathlib import Path
from typing import Any, Literal

import numpy as np
from scipy.signal import correlate, correlation_lags

import eightpost
from eightpost.array_types import Array, Complex
from eightpost.drivefile.iteration import (
    Outcome,
    Pass,
    Problem,
    Settings,
    StartResponse,
    Status,
    advance,
)
from eightpost.drivefile.target import LARGEST, LimitHit, Target, at_rate, read_channels
from eightpost.errors import DataError, FileFormatError, InputError, TooShortError, WrongSignError
from eightpost.files import atomic_path, check_schema, json_content, sha256_of
from eightpost.ident.vehicle.frequency_response import read_response, write_response
from eightpost.outputs import check_folder
from eightpost.schema import checked
from eightpost.signals import ChannelMap, Drivefile, TimeSeries
from eightpost.signals.formats import read_series, write_series
from eightpost.verdict import Verdict, edited, is_intact, sealed
from eightpost.virtual.program import Bench

# ==== Records of the rig: synchronisation with the drive file, and checks ============================================

#: Minimum correlation of a record's commands, or of its wheelloader positions, with the drive file [1].
_SAME_DRIVE = 0.9
_FOLLOWING = 0.02  #: Lag of positions that is attributed to the wheelloaders, not to the logger [s].
#: Correlation of the measured and the predicted channel below which the sign is wrong, and below which it is noted [1].
_OPPOSITE, _UNLIKE = -0.3, 0.3


def _synchronised(series: TimeSeries, problem: Problem, drive: Array, path: Path) -> tuple[Array, tuple[str, ...]]:
    """Return the target channels (p, N) of a record, SI, on the time axis of its drive file (m, N), and notes.

    The record is shifted so that its commands (`lf.road_command`), or otherwise its wheelloader positions (`lf.road`),
    agree with the drive. The logger may have started earlier; the rests at both ends may be shorter.
    """
    target, count = problem.target, problem.target.lines.samples

    def check_length(covered: int) -> None:
        if covered < count - 2 * (target.rest // 2):  # half of each rest may be missing
            raise TooShortError(
                f"it covers {series.duration:.2f} s, but the drive file has {count / target.rate:.2f} s; record the "
                "whole drive file",
                path=path,
            )

    if series.sample_rate < 0.999 * min(target.rate, 2.5 * target.high):
        raise DataError(
            f"the record has {series.sample_rate:g} Hz, but errors are evaluated up to {target.high:g} Hz; record at "
            f"{target.rate:g} Hz",
            path=path,
        )
    series = at_rate(series, target.rate)
    check_length(len(series))
    start, notes = _start(series, problem, drive, path)
    rows = np.stack([series[name] for name in target.names])
    before, after = max(-start, 0), max(start + count - rows.shape[1], 0)
    check_length(count - 2 * max(before, after))
    return np.pad(rows[:, max(start, 0) : start + count], ((0, 0), (before, after)), mode="edge"), notes


def _start(series: TimeSeries, problem: Problem, drive: Array, path: Path) -> tuple[int, tuple[str, ...]]:
    """Return the sample of the record at which the drive starts, and notes."""
    roads = [name for name, unit in zip(problem.inputs, problem.units, strict=True) if unit == "m"]
    by_command = all(f"{name}_command" in series for name in roads)
    if not by_command and not all(name in series for name in roads):
        return 0, (f"{path.name} has neither commands nor positions of the wheelloaders; it was taken to start with "
                   "the drive file.",)  # fmt: skip
    played = drive[[problem.inputs.index(name) for name in roads]]
    measured = np.stack([series[f"{name}_command" if by_command else name] for name in roads])
    played, measured = (rows - rows.mean(axis=1, keepdims=True) for rows in (played, measured))
    if not np.any(played):
        return 0, ()
    likeness = np.sum([correlate(m, p, method="fft") for m, p in zip(measured, played, strict=True)], axis=0)
    size = float(np.linalg.norm(measured) * np.linalg.norm(played))
    share = float(likeness.max()) / max(size, 1e-300)
    if share < _SAME_DRIVE:
        what = "commands" if by_command else "wheelloader positions"
        raise DataError(
            f"its {what} do not agree with the drive file (correlation {share:.2f}); give the record of the last drive "
            "file that was written",
            path=path,
        )
    lag = int(correlation_lags(measured.shape[1], played.shape[1])[int(np.argmax(likeness))])
    if lag == 0 or (not by_command and abs(lag) <= _FOLLOWING * problem.target.rate):
        return 0, ()
    order = "before" if lag > 0 else "after"
    return lag, (f"{path.name} starts {abs(lag) / problem.target.rate:.3f} s {order} the drive file.",)


def _check_signs(problem: Problem, H: Complex, drive: Array, rows: Array, path: Path) -> tuple[str, ...]:
    """Return notes on channels (p, N) of a record that do not agree with the prediction.

    The prediction is that of the response H (K, p, m) before the pass for the commands (m, N) that were played.
    """
    target = problem.target
    predicted = np.einsum("kij,kj->ki", H, target.lines.spectrum(drive - drive[:, :1]))
    measured = target.lines.spectrum(target.without_means(rows)[0])
    product = np.real(np.sum(measured * np.conj(predicted), axis=0))
    size = np.linalg.norm(measured, axis=0) * np.linalg.norm(predicted, axis=0)
    notes = []
    for name, value in zip(target.names, product / np.maximum(size, 1e-300), strict=True):
        if value < _OPPOSITE:
            raise WrongSignError(
                f"its correlation with the prediction is {value:.2f}, so its sign is reversed; reverse it "
                f"(--channel {name}=-) if it also was in the track record",
                path=path,
                channel=name,
            )
        if value < _UNLIKE:
            notes.append(f"{name} barely agrees with the prediction (correlation {value:.2f}); check sensor and car.")
    return tuple(notes)


# ==== The folder =====================================================================================================

SCHEMA = 1  #: Newest schema of iteration.json that can be read; it is also the one that is written.

Format = Literal["parquet", "csv", "mat", "drv"]  #: File formats in which drive files are written.

_STATE = "iteration.json"


@dataclass(frozen=True)
class _State:
    """Entries of iteration.json that are read, as `IterationFolder.start` writes them."""

    high: float
    settings: Settings
    static: tuple[tuple[float, ...], ...]
    notes: tuple[str, ...]
    sources: dict[str, str]
    format: Format


_AGAIN = "start the iteration again"
_ENTRIES = tuple(entry.name for entry in fields(_State))


@dataclass(frozen=True)
class IterationFolder:
    """An iteration in a folder. Every result is computed from its files, so it can resume at any point."""

    path: Path  #: Folder.
    problem: Problem  #: Target, response and settings.
    sources: Mapping[str, str]  #: SHA-256 digests of the files of track record and car, by name.
    suffix: str  #: Format of the drive files for the rig, one of `Format`.
    edits: Verdict = field(default_factory=Verdict)  #: Reason if iteration.json was edited.

    @classmethod
    def start(
        cls, path: str | Path, problem: Problem, *, sources: Mapping[str, str] | None = None, suffix: str = "parquet"
    ) -> IterationFolder:
        """Create the folder, which must not contain an iteration, and write the first drive file.

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
        content = {
            "kind": "drivefile_iteration",
            "schema": SCHEMA,
            "tool": f"eightpost {eightpost.__version__}",
            "high": problem.target.high,
            "settings": asdict(problem.settings),
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
        """Read a folder; FileFormatError: the folder does not contain an iteration of this version."""
        path = Path(path)
        content = json_content(path / _STATE, advice="start an iteration with eightpost drivefile start")
        if not isinstance(content, dict) or content.get("kind") != "drivefile_iteration":
            raise FileFormatError("is not the state of a drive file iteration", path=path / _STATE)
        check_schema(content, SCHEMA, path / _STATE)
        state = checked(_State, {name: content[name] for name in _ENTRIES if name in content}, path=path / _STATE)
        track = read_series(path / "target.parquet")
        try:
            target = Target(track, state.high)
        except InputError as error:
            raise FileFormatError(f"{error}: {_AGAIN}", path=path / "target.parquet") from error
        response = read_response(path / "response.npz")
        static = np.array(state.static) if len({len(row) for row in state.static}) == 1 else np.zeros((0, 0))
        if response.output_names != target.names or not np.array_equal(response.frequency, target.lines.frequency):
            what = f"does not belong to {_STATE} and target.parquet"
            raise FileFormatError(f"{what}: {_AGAIN}", path=path / "response.npz")
        p, m = response.H.shape[:2]
        if static.shape != (p, m) or not np.abs(static).max() < LARGEST:
            what = f"static must be {p} rows of {m} numbers below {LARGEST:g}"
            raise FileFormatError(f"{what}: {_AGAIN}", path=path / _STATE)
        problem = Problem(target, StartResponse(response, static, state.notes), state.settings)
        return cls(path, problem, state.sources, state.format, Verdict() if is_intact(content) else edited(_STATE))

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
    def _computed(self) -> dict[int, Outcome]:
        """Outcome after the number of passes that was asked for last."""
        return {}

    @cached_property
    def _passes(self) -> list[Pass]:
        return []

    def passes(self) -> list[Pass]:
        """Return all passes with a record."""
        for number in range(len(self._passes) + 1, self.played + 1):
            record = read_series(self.pass_path(number) / "record.parquet")
            self._passes.append(Pass(self.drive(number), record.select(self.problem.target.names).values))
        return list(self._passes)

    def drive(self, number: int) -> Array:
        """Return the commands (m, N) of a pass."""
        return read_series(self.pass_path(number) / "drive.parquet").select(self.problem.inputs).values

    def outcome(self) -> Outcome:
        """Return the state after all passes with a record."""
        number = self.played
        if number not in self._computed:
            self._computed.clear()
            self._computed[number] = advance(self.problem, self.passes())
        return self._computed[number]

    def is_added(self, record: Path) -> bool:
        """Return whether a file is the record of the last pass with one, as in a call that is repeated.

        Raises:
            DataError: It is the record of an earlier pass.
        """
        digest, played = sha256_of(record), self.played
        for number in range(played, 0, -1):
            source = self.pass_path(number) / "source.json"
            if source.is_file() and digest in source.read_text(encoding="utf-8"):
                if number == played:
                    return True
                what = f"it is the record of pass {number}; give the record of the last drive file that was written"
                raise DataError(what, path=record)
        return False

    def add_record(
        self,
        source: str | Path,
        *,
        channel_map: ChannelMap | None = None,
        units: Mapping[str, str] | None = None,
        flip: Iterable[str] = (),
    ) -> tuple[str, ...]:
        """Add the rig's record of the last drive file, and return notes for the user; see `read_channels`.

        Raises:
            InputError: No drive file waits for a record.
            DataError: The record has a fault, or is not a record of the drive file.
        """
        number, source = self.waiting, Path(source)
        if number is None:
            raise InputError(
                f"{self.path}: no drive file waits for a record; write the next one with next, no --record"
            )
        target, drive = self.problem.target, self.drive(number)
        roads = [name for name, unit in zip(self.problem.inputs, self.problem.units, strict=True) if unit == "m"]
        optional = (*(f"{name}_command" for name in roads), *roads)
        record = read_channels(source, target.names, optional=optional, channel_map=channel_map, units=units, flip=flip)
        rows, notes = _synchronised(record, self.problem, drive, source)
        notes = (*notes, *_check_signs(self.problem, self.outcome().H, drive, rows, source))
        _write_json(self.pass_path(number) / "source.json",
                    {"record": source.name, "sha256": sha256_of(source), "notes": list(notes)})  # fmt: skip
        series = TimeSeries(target.time, rows, target.names, target.units)
        write_series(series, self.pass_path(number) / "record.parquet")
        return notes

    def write_next(self) -> Outcome:
        """Write the errors of the last pass, the best drive, and the next drive file unless the iteration diverged.

        Files that exist are computed again and replaced, so an interrupted call can be repeated.
        """
        outcome, number = self.outcome(), self.played
        if number:
            errors = outcome.errors[-1]
            state = {"pass": number, "status": outcome.status.value, "best": outcome.best + 1,
                     "rejections": outcome.rejections, "total": errors.total}  # fmt: skip
            _write_json(self.pass_path(number) / "errors.json", state | asdict(errors))
        if outcome.best >= 0:
            self._write_drive(self.path / "best_drive", self.drive(outcome.best + 1))
        if outcome.status is not Status.DIVERGED:
            self._write_drive(self.pass_path(number + 1) / "drive", outcome.drive)
            _write_json(self.pass_path(number + 1) / "limits.json", [asdict(hit) for hit in outcome.hits])
        return outcome

    def _write_drive(self, stem: Path, commands: Array) -> None:
        """Write commands as Parquet, which later passes read, and in the format for the rig."""
        stem.parent.mkdir(parents=True, exist_ok=True)
        series = TimeSeries(self.problem.target.time, commands, self.problem.inputs, self.problem.units)
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
        return tuple(map(str, checked(list[LimitHit], json_content(path), path=path)))


def _write_json(path: Path, content: Any) -> None:
    with atomic_path(path) as temporary:
        temporary.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")


# ==== Passes on the virtual rig ======================================================================================

RECORD = "rig.parquet"  #: Name of the rig's record in the folder of a pass.


def iterate(
    folder: IterationFolder,
    bench: Bench,
    shocks: Sequence[str],
    passes: int,
    report: Callable[[Outcome], None] | None = None,
) -> Outcome:
    """Play drive files on the virtual rig until there are `passes`, those before included, or it diverged.

    Each pass is another run with its own noise and drift. `shocks` are the names of the shocks at the corners, and
    `report` receives the state after each pass.
    """
    outcome = folder.write_next()
    while folder.played < passes and outcome.status is not Status.DIVERGED:
        number = folder.played + 1
        place = folder.pass_path(number)
        drive = Drivefile(read_series(place / "drive.parquet"))
        bench.record(drive, shocks, f"drive file, pass {number}", number).write(place / RECORD)
        folder.add_record(place / RECORD)
        outcome = folder.write_next()
        if report is not None:
            report(outcome)
    return outcome
