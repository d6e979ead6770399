"""Chunks of setups and their files, under digests of what they depend on."""

from __future__ import annotations

import hashlib
import json
import os
import re
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet

from cosim.study.running.evaluator import Coupling, Row
from cosim.study.running.workers import Chunk
from cosim.study.study import Study
from eightpost import __version__
from eightpost.errors import FileFormatError, InputError
from eightpost.files import atomic_path, json_content, sha256_of
from eightpost.signals.parquet_file import read_table

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


# ---- Files of a study's completed chunks; each is complete or does not exist ----------------------------------------

#: Approximate number of chunks of a study, and largest number of setups in one: few are lost if a process is killed.
_CHUNKS, _LARGEST = 200, 64

#: Number of setups in a full batch: a chunk has a whole number of them.
BATCH = 8

_NAME = re.compile(r"chunk_(\d+)\.parquet")


def cut(study: Study) -> tuple[Chunk, ...]:
    """Return all setups of a study in chunks; the chunks depend on the study only."""
    indices = study.space.indices.tolist()
    size = min(_LARGEST, max(1, -(-len(indices) // (_CHUNKS * BATCH))) * BATCH)
    return tuple(Chunk(k, tuple(indices[first : first + size])) for k, first in enumerate(range(0, len(indices), size)))


class ChunkFolder:
    """Folder of the completed chunks of one study, and of its coupling.

    Args:
        folder: Output folder of the study.
        digest: Digest of the study; each digest has a folder of its own.
        schema: Schema of the table.
    """

    def __init__(self, folder: Path, digest: str, schema: pa.Schema) -> None:
        self._folder, self._schema = folder / "chunks" / digest[:16], schema

    @property
    def numbers(self) -> frozenset[int]:
        """Numbers of the completed chunks."""
        if not self._folder.is_dir():
            return frozenset()
        return frozenset(int(found[1]) for path in self._folder.iterdir() if (found := _NAME.fullmatch(path.name)))

    def write(self, chunk: Chunk, rows: Sequence[Row]) -> None:
        """Write the rows of a chunk."""
        with atomic_path(self._folder / _name(chunk.number)) as temporary:
            pyarrow.parquet.write_table(pa.Table.from_pylist(list(rows), schema=self._schema), temporary)

    def table(self) -> pa.Table:
        """Return all rows of the completed chunks as a table.

        Raises:
            FileFormatError: A file is damaged.
        """
        return pa.concat_tables([self._schema.empty_table(), *map(self._read, sorted(self.numbers))])

    def rows(self) -> list[Row]:
        """Return all rows of the completed chunks, each by column name.

        Raises:
            FileFormatError: A file is damaged.
        """
        rows: list[Row] = self.table().to_pylist()
        return rows

    def _read(self, number: int) -> pa.Table:
        path = self._folder / _name(number)
        try:
            return read_table(path, schema=self._schema).replace_schema_metadata()
        except FileFormatError as error:
            raise FileFormatError(f"{error}; delete the file to run its setups again") from error

    def coupling(self) -> Coupling | None:
        """Return the coupling that was chosen, or None if it was not chosen yet."""
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


def _name(number: int) -> str:
    return f"chunk_{number:06d}.parquet"
