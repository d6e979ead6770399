"""Chunks of setups and their files, under digests of what they depend on."""

from __future__ import annotations

import hashlib
import json
import math
import os
import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet

from cosim.study.running.evaluator import Coupling, Row
from cosim.study.running.workers import Chunk
from cosim.study.study import Study
from eightpost import __version__
from eightpost.array_types import Integers
from eightpost.errors import FileFormatError, InputError
from eightpost.files import atomic_path, json_content, sha256_of
from eightpost.signals.parquet_file import read_columns, read_table

# ---- Digest of a study ----------------------------------------------------------------------------------------------

#: Entries that do not affect the results: they are applied to the table afterwards.
_AFTER = ("name", "objective", "constraints")


def file_digests(study: Study) -> dict[str, str]:
    """Return SHA-256 of every file that a study reads, by its path."""
    return {str(path): sha256_of(path) for path in file_paths(study)}


def file_paths(study: Study) -> list[Path]:
    """Return every file that a study reads: FMUs, drive files, channel maps, user-defined measures."""
    files = [study.vehicle.fmu, *(build.fmu for build in study.bank.values())]
    for drive in study.drives:
        files += [drive.file, *([drive.channel_map] if drive.channel_map else [])]
    own = [Path(measure.function.rpartition(":")[0]) for measure in study.measures if measure.function]
    return list(dict.fromkeys([*files, *own]))


def study_digest(study: Study, digests: dict[str, str]) -> str:
    """Return the digest of a study; it depends on the contents of files, not on their paths."""
    document = json.loads(study.to_json())
    for name in _AFTER:
        del document[name]
    document = _without_paths(document, digests)
    text = json.dumps({"study": document, "tool": __version__, "batch": BATCH}, sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()


def _without_paths(value: Any, digests: dict[str, str]) -> Any:
    """Return a value with the digest in place of every path, also in the functions of user-defined measures."""
    if isinstance(value, dict):
        return {key: _without_paths(one, digests) for key, one in value.items()}
    if isinstance(value, list):
        return [_without_paths(one, digests) for one in value]
    if isinstance(value, str):
        file, colon, name = value.rpartition(":")
        return digests.get(value) or (f"{digests[file]}{colon}{name}" if file in digests else value)
    return value


# ---- Chunks of the setups that are left -----------------------------------------------------------------------------

#: Number of setups in a full batch: a chunk has a whole number of them.
BATCH = 8

#: Worker time that a chunk should take [s], and largest number of setups in it: few are lost if a process is killed.
_SECONDS, _LARGEST = 2.0, 1024

#: Number of chunks that every worker should still get, so that all workers end together, and largest growth of a chunk.
_SHARE, _GROWTH = 4, 4


class Cutter:
    """Iterator that cuts the setups that are left into chunks, each when a worker is free for it.

    The first chunks are one batch each. Later ones grow until they take some seconds of worker time, and shrink again
    towards the end. The values of a setup do not depend on its chunk.

    Args:
        indices: Numbers of all setups of the study (S,).
        done: Positions of the completed setups among them.
        workers: Function that returns the number of workers.
    """

    def __init__(self, indices: Integers, done: Sequence[range], workers: Callable[[], int]) -> None:
        self._indices, self._workers = indices, workers
        self._parts = gaps(done, indices.size)
        self._size, self._cost = BATCH, math.inf
        self.left = sum(map(len, self._parts))
        self._uncut = self.left

    def __iter__(self) -> Iterator[Chunk]:
        return self

    def __next__(self) -> Chunk:
        """Return the next chunk; its number is the position of its first setup."""
        if not self._parts:
            raise StopIteration
        part, size = self._parts[0], self._next_size()
        self._parts[:1] = [part[size:]] if len(part) > size else []
        self._uncut -= len(part[:size])
        return Chunk(part[0], tuple(self._indices[part[0] : part[:size].stop].tolist()))

    def learn(self, rows: Sequence[Row]) -> None:
        """Learn from the rows of a completed chunk how long a setup takes."""
        cost = sum(row["seconds"] for row in rows) / len(rows)
        self._cost = cost if math.isinf(self._cost) else 0.5 * (self._cost + cost)
        self.left -= len(rows)

    def _next_size(self) -> int:
        fair = self._uncut / (_SHARE * max(1, self._workers()))
        wanted = min(_SECONDS / max(self._cost, 1e-9), fair, _GROWTH * self._size, _LARGEST)
        self._size = BATCH * max(1, int(wanted) // BATCH)
        return self._size


def gaps(done: Sequence[range], count: int) -> list[range]:
    """Return the positions below `count` that are in none of the ranges, as ranges in increasing order."""
    found, first = list[range](), 0
    for part in (*sorted(done, key=lambda one: one.start), range(count, count)):
        if min(part.start, count) > first:
            found.append(range(first, min(part.start, count)))
        first = max(first, part.stop)
    return found


# ---- Files of a study's completed chunks; each is complete or does not exist ----------------------------------------

#: Number of rows that are held in memory while the chunks are joined: a row group of the result.
_ROWS = 8192

_NAME = re.compile(r"chunk_(\d+)_(\d+)\.parquet")


class ChunkFolder:
    """Folder of the completed chunks of one study, and of its coupling.

    The name of a file states the number of the chunk and its number of setups.

    Args:
        folder: Output folder of the study.
        digest: Digest of the study; each digest has a folder of its own.
        schema: Schema of the table.
    """

    def __init__(self, folder: Path, digest: str, schema: pa.Schema) -> None:
        self._folder, self._schema = folder / "chunks" / digest[:16], schema

    @property
    def completed(self) -> tuple[range, ...]:
        """Completed chunks, each from its number on as many as it has setups, in increasing order."""
        if not self._folder.is_dir():
            return ()
        found = (_NAME.fullmatch(path.name) for path in self._folder.iterdir())
        pairs = sorted((int(one[1]), int(one[2])) for one in found if one)
        return tuple(range(first, first + count) for first, count in pairs)

    def write(self, chunk: Chunk, rows: Sequence[Row]) -> None:
        """Write the rows of a chunk."""
        with atomic_path(self._folder / _name(chunk.number, len(rows))) as temporary:
            pyarrow.parquet.write_table(pa.Table.from_pylist(list(rows), schema=self._schema), temporary)

    def clear(self) -> None:
        """Delete the completed chunks."""
        for chunk in self.completed:
            (self._folder / _name(chunk.start, len(chunk))).unlink(missing_ok=True)

    def tables(self) -> Iterator[pa.Table]:
        """Yield the rows of the completed chunks in the order of the chunks, some thousands at a time.

        Only these are in memory. A setup of two chunks, which two processes ran at the same time, is yielded once.

        Raises:
            FileFormatError: A file is damaged.
        """
        held, last = list[pa.Table](), -1
        for chunk in self.completed:
            table = self._read(chunk)
            numbers = table["setup"].to_numpy()
            held.append(table if numbers.size and numbers[0] > last else table.filter(pa.array(numbers > last)))
            last = max(last, int(numbers.max(initial=-1)))
            if sum(map(len, held)) >= _ROWS:
                yield pa.concat_tables(held)
                held = []
        if held:
            yield pa.concat_tables(held)

    def table(self) -> pa.Table:
        """Return all rows of the completed chunks as a table.

        Raises:
            FileFormatError: A file is damaged.
        """
        return pa.concat_tables([self._schema.empty_table(), *map(self._read, self.completed)])

    def numbers(self) -> Iterator[tuple[range, Integers]]:
        """Yield each completed chunk with the numbers of its setups.

        Raises:
            FileFormatError: A file is damaged.
        """
        for chunk in self.completed:
            table = self._checked(chunk, lambda path: read_columns(path, ["setup"]))
            yield chunk, table["setup"].to_numpy()

    def rows(self, chunk: range) -> list[Row]:
        """Return the rows of a completed chunk, each by column name.

        Raises:
            FileFormatError: The file is damaged.
        """
        rows: list[Row] = self._read(chunk).to_pylist()
        return rows

    def _read(self, chunk: range) -> pa.Table:
        return self._checked(chunk, lambda path: read_table(path, schema=self._schema).replace_schema_metadata())

    def _checked(self, chunk: range, read: Callable[[Path], pa.Table]) -> pa.Table:
        """Return what is read from the file of a chunk, which must have as many rows as its name states."""
        path = self._folder / _name(chunk.start, len(chunk))
        try:
            table = read(path)
            if len(table) != len(chunk):
                raise FileFormatError(f"has {len(table)} rows, not {len(chunk)} as its name states", path=path)
        except FileFormatError as error:
            raise FileFormatError(f"{error}; delete the file to run its setups again") from error
        return table

    def coupling(self) -> Coupling | None:
        """Return the coupling that was chosen, or None if it was not chosen yet.

        Raises:
            FileFormatError: The file of the coupling is damaged.
        """
        path = self._folder / "coupling.json"
        if not os.path.lexists(path):
            return None
        try:
            return Coupling.from_json(json_content(path, finite=False))
        except ValueError as error:
            what = "is not the coupling of a study; delete the file to choose the coupling again"
            raise FileFormatError(f"{error}: {what}" if isinstance(error, InputError) else what, path=path) from error

    def keep_coupling(self, coupling: Coupling) -> None:
        """Write the coupling for all later runs of the study."""
        with atomic_path(self._folder / "coupling.json") as temporary:
            temporary.write_text(json.dumps(asdict(coupling), indent=2) + "\n", encoding="utf-8")


def _name(number: int, count: int) -> str:
    return f"chunk_{number:07d}_{count}.parquet"
