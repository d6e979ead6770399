"""Folder of an iteration: settings, target, response, and a folder for each pass with its drive and its record."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

import eightpost
from eightpost.array_types import Array
from eightpost.drivefile.iteration import Outcome, Pass, Problem, Settings, Status, advance
from eightpost.drivefile.limits import LimitHit, Limits
from eightpost.drivefile.record import check_signs, read_rig_record
from eightpost.drivefile.response import StartResponse
from eightpost.drivefile.target import Target
from eightpost.errors import FileFormatError, InputError
from eightpost.files import MALFORMED, atomic_path, check_schema, json_content, sha256_of
from eightpost.ident.response import read_response, write_response
from eightpost.outputs import check_folder
from eightpost.signals import ChannelMap, TimeSeries
from eightpost.signals.formats import read_series, write_series
from eightpost.verdict import Verdict, edited, is_intact, sealed

#: Newest schema of iteration.json that can be read; it is also the one that is written.
SCHEMA = 1

#: File formats in which drive files are written beside Parquet.
FORMATS = ("parquet", "csv", "mat")

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
