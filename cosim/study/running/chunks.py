"""What a study has done so far: a file per chunk, each whole or not there."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet
from pydantic import TypeAdapter

from cosim.study.running.evaluator import Coupling, Row
from cosim.study.running.workers import Chunk
from cosim.study.study import Study
from eightpost.errors import FileFormatError, InputError
from eightpost.files import atomic_path, json_content
from eightpost.signals.parquet_table import read_table

#: A study is cut into about so many chunks, of at most so many setups: a kill loses what runs in one, which is little.
_CHUNKS, _LARGEST = 200, 64

_COUPLING: TypeAdapter[Coupling] = TypeAdapter(Coupling)
_NAME = re.compile(r"chunk_(\d+)\.parquet")


def cut(study: Study) -> tuple[Chunk, ...]:
    """Return all setups of a study in chunks, which hang on nothing but the study."""
    indices = study.space.indices.tolist()
    size = min(_LARGEST, max(1, -(-len(indices) // _CHUNKS)))
    return tuple(Chunk(k, tuple(indices[first : first + size])) for k, first in enumerate(range(0, len(indices), size)))


class ChunkFolder:
    """The chunks of one study that are done, and its coupling.

    Args:
        folder: Of the study's output.
        digest: Of the study: what is done is kept apart by it.
        schema: Columns of the table.
    """

    def __init__(self, folder: Path, digest: str, schema: pa.Schema) -> None:
        self._folder, self._schema = folder / "chunks" / digest[:16], schema

    @property
    def numbers(self) -> frozenset[int]:
        """Numbers of the chunks that are done."""
        if not self._folder.is_dir():
            return frozenset()
        return frozenset(int(found[1]) for path in self._folder.iterdir() if (found := _NAME.fullmatch(path.name)))

    def write(self, chunk: Chunk, rows: Sequence[Row]) -> None:
        """Keep the rows of a chunk."""
        with atomic_path(self._folder / _name(chunk.number)) as temporary:
            pyarrow.parquet.write_table(pa.Table.from_pylist(list(rows), schema=self._schema), temporary)

    def table(self) -> pa.Table:
        """Return all rows that are done, as they were kept.

        Raises:
            FileFormatError: A file was damaged.
        """
        return pa.concat_tables([self._schema.empty_table(), *map(self._read, sorted(self.numbers))])

    def rows(self) -> list[Row]:
        """Return all rows that are done, by column name.

        Raises:
            FileFormatError: A file was damaged.
        """
        rows: list[Row] = self.table().to_pylist()
        return rows

    def _read(self, number: int) -> pa.Table:
        path = self._folder / _name(number)
        try:
            return read_table(path, schema=self._schema).replace_schema_metadata()
        except FileFormatError as error:
            raise FileFormatError(f"{error}; remove it, and its setups are run again") from error

    def coupling(self) -> Coupling | None:
        """Return the coupling that was chosen; None where none was yet."""
        path = self._folder / "coupling.json"
        if not os.path.lexists(path):
            return None
        try:
            return _COUPLING.validate_python(json_content(path, finite=False))
        except ValueError as error:
            what = "it is not the coupling that a study chose; remove it, and it is chosen again"
            raise FileFormatError(f"{error}: {what}" if isinstance(error, InputError) else what, path=path) from error

    def keep_coupling(self, coupling: Coupling) -> None:
        """Keep the coupling for all later runs of the study."""
        with atomic_path(self._folder / "coupling.json") as temporary:
            temporary.write_text(json.dumps(asdict(coupling), indent=2) + "\n", encoding="utf-8")


def _name(number: int) -> str:
    return f"chunk_{number:06d}.parquet"
