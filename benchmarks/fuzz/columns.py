"""Changes of files with columns that keep them well-formed: unexpected types, shapes and headers."""

from __future__ import annotations

import io
import struct
from random import Random
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet
import scipy.io

from benchmarks.fuzz import archives, documents
from benchmarks.fuzz.mutations import TEXTS

#: Replacement for the header text of a MATLAB file, into which scipy writes today's date.
_HEAD = b"MATLAB 5.0 MAT-file".ljust(116)


def change_parquet(rng: Random, content: bytes) -> bytes:
    """Change a column's type or name, remove or repeat it, remove the rows, or change a header in the metadata."""
    table = pa.parquet.read_table(io.BytesIO(content))
    metadata = dict(table.schema.metadata or {})
    for _ in range(rng.randint(1, 2)):
        kind, column = rng.randrange(6), rng.randrange(max(1, table.num_columns))
        if kind < 2 and metadata:
            key = rng.choice(list(metadata))
            metadata[key] = documents.change_json(rng, metadata[key])
        elif kind == 2:
            table = _with_column(rng, table, column)
        elif kind == 3 and table.num_columns:
            table = table.remove_column(column)
        elif kind == 4:
            names = list(table.column_names)
            names[column : column + 1] = [rng.choice((*TEXTS, *names))]
            table = table.rename_columns(names)
        else:
            table = table.slice(0, rng.choice((0, 1, 2)))
    stream = io.BytesIO()
    pa.parquet.write_table(table.replace_schema_metadata(metadata or None), stream)
    return stream.getvalue()


def _with_column(rng: Random, table: pa.Table, column: int) -> pa.Table:
    rows = table.num_rows
    made = (
        lambda: pa.array([None] * rows),
        lambda: pa.array([None] * rows, pa.float64()),
        lambda: pa.array([rng.choice(TEXTS) for _ in range(rows)]),
        lambda: pa.array([b"\xff\xfe"] * rows, pa.binary()),
        lambda: pa.array([[1.0, 2.0]] * rows),
        lambda: pa.array([{"a": 1}] * rows),
        lambda: pa.array([True] * rows),
        lambda: pa.array(range(rows), pa.timestamp("ns")),
        lambda: pa.array([2**63 - 1 - k for k in range(rows)], pa.int64()),
        lambda: pa.array([-k for k in range(rows)], pa.int64()),
        lambda: pa.array(np.full(rows, np.inf)),
        lambda: pa.array(np.full(rows, 1e308)),
        lambda: pa.array(["a"] * rows).dictionary_encode(),
        lambda: pa.array(np.zeros(rows, np.float16)),
    )
    return table.set_column(column, table.column_names[column], rng.choice(made)())


def change_mat(rng: Random, content: bytes) -> bytes:
    """Change a variable's type or shape: texts, cells, structs, complex, sparse or empty ones, units as numbers."""
    variables = {k: v for k, v in scipy.io.loadmat(io.BytesIO(content)).items() if not k.startswith("__")}
    values: tuple[Any, ...] = (
        1.0, "x", "", np.array([]), np.zeros((0, 3)), np.ones((3, 2, 2)), np.array([1, "a", [2.0]], dtype=object),
        {"a": 1.0}, {"velocity": 1.0, "time": "s"}, {"velocity": {"deep": "m"}}, np.ones(500) * 1j, np.ones(500) > 0,
        scipy.sparse.csc_matrix(np.eye(5)), np.zeros(500, dtype=[("a", float), ("b", int)]), np.full((500, 1), np.nan),
        np.array(["m/s", "N"], dtype=object), np.array([1.0, 2.0]), [{"a": 1}, {"a": 2}], np.uint8(200),
    )  # fmt: skip
    for _ in range(rng.randint(1, 2)):
        name = rng.choice((*variables, "units", "channel_names", "eightpost", "time"))
        if rng.random() < 0.15 and name in variables and len(variables) > 1:
            del variables[name]
        else:
            variables[name] = rng.choice(values)
    if rng.random() < 0.2:
        variables = {"data": dict(variables)}
    stream = io.BytesIO()
    scipy.io.savemat(stream, variables, long_field_names=True, do_compression=rng.random() < 0.5)
    return _HEAD + stream.getvalue()[len(_HEAD) :]


def change_npz(rng: Random, content: bytes) -> bytes:
    """Change the header's JSON, or an array's type, shape or header."""
    members = archives.members_of(content)
    name = rng.choice(list(members))
    if name == "header.npy" or rng.random() < 0.3:
        header = str(np.load(io.BytesIO(members["header.npy"])))
        text = documents.change_json(rng, header.encode()).decode("utf-8", "replace")
        members["header.npy"] = _npy(np.array(text))
    elif rng.random() < 0.5:
        array = np.load(io.BytesIO(members[name]))
        ways = (array[..., :1], array.T, array.astype(complex), array.astype(str), array * np.nan, array[:0],
                array[None], np.array(1.0), array.astype(np.int64), array > 0, np.array([None, 1], dtype=object),
                -array, np.zeros(3, dtype=[("a", float)]))  # fmt: skip
        members[name] = _npy(rng.choice(ways))
    else:
        shape = rng.choice(
            ("(1000000000000,)", "(-1,)", "()", "(9" * 50 + ",)", "((((1,),),),)", "(True,)", "1", "([],)")
        )
        kind = rng.choice(("'<f8'", "'|O'", "'<c16'", "'<U999999999'", "'x'", "[('a', '<f8')]", "1", "'<M8[ns]'", "()"))
        head = (
            f"{{'descr': {kind}, 'fortran_order': {rng.choice(('False', 'True', '3'))}, 'shape': {shape}, }}\n".encode()
        )
        members[name] = b"\x93NUMPY" + bytes((rng.choice((1, 1, 1, 2, 3, 9)), 0)) + struct.pack("<H", len(head)) + head
        members[name] += bytes(80)
    return archives.packed(members)


def _npy(array: np.ndarray[Any, Any]) -> bytes:
    stream = io.BytesIO()
    np.save(stream, array, allow_pickle=True)
    return stream.getvalue()


def overwrite_links(rng: Random, content: bytes) -> bytes:
    """Overwrite 64-bit words (links and lengths of an MDF 4 file) with limits, other links or small numbers."""
    changed = bytearray(content)
    for _ in range(rng.randint(1, 3)):
        at = 8 * rng.randrange(8, max(9, min(len(content), 6000) // 8))
        value = rng.choice((0, 1, 2**63 - 1, 2**64 - 1, 2**32, 64, 8 * rng.randrange(len(content) // 8 + 1), 10**12))
        changed[at : at + 8] = struct.pack("<Q", value)
    return bytes(changed)
