"""Damages to files: bits and texts, JSON, TOML and XML documents, columns of tables, archives."""

from __future__ import annotations

import io
import json
import re
import stat
import struct
import warnings
import zipfile
from collections.abc import Callable, Mapping
from random import Random
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet
import scipy.io

Change = Callable[[Random, bytes], bytes]

#: Texts of numbers that are difficult for readers.
NUMBERS = (
    "0", "-0.0", "-1", "1e308", "1e999", "-1e999", "NaN", "nan", "Infinity", "-inf", "1e-320", "9" * 25, "9" * 400,
    "9" * 5000, "0x10", "1_000", "1,5", "--1", "", "+", "1e", "٣", "18446744073709551616", "2147483648",
)  # fmt: skip
#: Texts that are difficult for readers.
TEXTS = (
    "", " ", "x", "a\0b", "=cmd|' /C calc'!A0", "../../etc/passwd", "/dev/null", ".", "N", "mm/s", "m**1e9", "%s%n",
    "[red]", "\x1b[31m", "\ufeff", "é", "x" * 5000, "1 m", "nan s", "1e999 s", "-1 s", "lf", "s" * 300 + ".fmu",
)  # fmt: skip
_NUMBER = re.compile(rb"-?\d+(?:\.\d+)?(?:[eE][+-]?\d+)?")
_WORDS = (b"\x00" * 4, b"\xff" * 4, b"\xff\xff\xff\x7f", b"\x00\x00\x00\x80", b"\x01\x00\x00\x00", b"\x00\x10\x00\x00")


def flip_bits(rng: Random, content: bytes) -> bytes:
    """Flip one to eight bits."""
    changed = bytearray(content)
    for _ in range(rng.randint(1, 8) if content else 0):
        changed[rng.randrange(len(changed))] ^= 1 << rng.randrange(8)
    return bytes(changed)


def truncate(rng: Random, content: bytes) -> bytes:
    """Cut off the end."""
    return content[: rng.randint(0, len(content))]


def insert(rng: Random, content: bytes) -> bytes:
    """Insert random bytes, NULs or a long run of one byte."""
    at, kind = rng.randint(0, len(content)), rng.randrange(3)
    added = (rng.randbytes(rng.randint(1, 40)), b"\0" * rng.randint(1, 40), rng.randbytes(1) * 100_000)[kind]
    return content[:at] + added + content[at:]


def remove(rng: Random, content: bytes) -> bytes:
    """Remove a piece."""
    at = rng.randint(0, len(content))
    return content[:at] + content[at + rng.randint(1, max(1, len(content) // 4)) :]


def repeat(rng: Random, content: bytes) -> bytes:
    """Repeat a piece."""
    at = rng.randint(0, len(content))
    piece = content[at : at + rng.randint(1, max(1, len(content) // 2))]
    return content[:at] + piece * rng.choice((2, 3, 50)) + content[at + len(piece) :]


def overwrite(rng: Random, content: bytes) -> bytes:
    """Overwrite words of four bytes with limits of integers."""
    changed = bytearray(content)
    for _ in range(rng.randint(1, 4)):
        at = 4 * rng.randrange(max(1, len(content) // 4))
        changed[at : at + 4] = rng.choice(_WORDS)
    return bytes(changed)


def overwrite_head(rng: Random, content: bytes) -> bytes:
    """Overwrite words in the first kilobyte, where binary formats have their header."""
    return overwrite(rng, content[:1024]) + content[1024:]


def swap_pieces(rng: Random, content: bytes) -> bytes:
    """Swap two pieces of the file."""
    a, b, c = sorted(rng.randint(0, len(content)) for _ in range(3))
    return content[:a] + content[b:c] + content[a:b] + content[c:]


def empty(rng: Random, _: bytes) -> bytes:
    """Return an empty file, or only white space."""
    return rng.choice((b"", b"\n", b" ", b"\0", b"\xef\xbb\xbf", b"\xff\xfe"))


def recode(rng: Random, content: bytes) -> bytes:
    """Save in another encoding, with a byte order mark, or with bytes that are not valid UTF-8."""
    text = content.decode("utf-8", "replace")
    ways = (
        lambda: text.encode("utf-16"),
        lambda: text.encode("utf-16-le"),
        lambda: text.encode("utf-32"),
        lambda: b"\xef\xbb\xbf" + content,
        lambda: b"\xef\xbb\xbf" * 3 + content,
        lambda: content.replace(b"\n", b"\r"),
        lambda: content.replace(b"e", b"\xe9", 1),
        lambda: text.translate({ord(c): 0xFF00 + ord(c) - 0x20 for c in "0123456789,"}).encode(),
    )
    return rng.choice(ways)()


def change_number(rng: Random, content: bytes) -> bytes:
    """Replace a number with something else."""
    return _replaced(rng, content, _NUMBER, rng.choice(NUMBERS).encode())


def change_word(rng: Random, content: bytes) -> bytes:
    """Replace a word with something else."""
    return _replaced(rng, content, re.compile(rb"[A-Za-z_][\w.]*"), rng.choice(TEXTS).encode())


def change_lines(rng: Random, content: bytes) -> bytes:
    """Remove, repeat, swap, join or cut a line."""
    lines = content.split(b"\n")
    at, other = rng.randrange(len(lines)), rng.randrange(len(lines))
    kind = rng.randrange(5)
    if kind == 0:
        del lines[at]
    elif kind == 1:
        lines.insert(other, lines[at])
    elif kind == 2:
        lines[at], lines[other] = lines[other], lines[at]
    elif kind == 3:
        lines[at : at + 2] = [b",".join(lines[at : at + 2])]
    else:
        lines[at] = lines[at][: rng.randint(0, len(lines[at]))]
    return b"\n".join(lines)


def long_field(rng: Random, content: bytes) -> bytes:
    """Insert 10 MB at one place."""
    at = rng.randint(0, len(content))
    return content[:at] + rng.choice((b"7", b"x", b'"', b" ", b"\xc3\xa9", b"[", b",")) * 10_000_000 + content[at:]


def change_marks(rng: Random, content: bytes) -> bytes:
    """Replace a quote, bracket, delimiter or blank with another such character."""
    marks = b",;\t\"'[](){}=:.#\n <>/&"
    return _replaced(rng, content, re.compile(rb"[" + re.escape(marks) + rb"]"), bytes([rng.choice(marks)]))


def _replaced(rng: Random, content: bytes, pattern: re.Pattern[bytes], replacement: bytes) -> bytes:
    found = list(pattern.finditer(content[:200_000]))
    if not found:
        return content + replacement
    place = rng.choice(found)
    return content[: place.start()] + replacement + content[place.end() :]


BINARY: tuple[Change, ...] = (
    flip_bits, flip_bits, truncate, insert, remove, repeat, overwrite, overwrite_head, swap_pieces, empty,
)  # fmt: skip
TEXT: tuple[Change, ...] = (
    flip_bits, truncate, insert, remove, repeat, swap_pieces, empty, recode, change_number, change_number, change_word,
    change_word, change_lines, change_lines, change_marks, change_marks,
)  # fmt: skip
#: Slow changes, of which a campaign makes few.
SLOW: tuple[Change, ...] = (long_field,)


_RAW = "\N{REPLACEMENT CHARACTER}raw:"
_VALUES: tuple[Any, ...] = (
    None, True, False, 0, -1, 1, 2**31, 2**63, 1e308, -0.0, 1e-320, [], {}, [1], [[1]], {"a": 1}, [None], [True, "x"],
    ["lf", 1], {"lf": None}, *(f"{_RAW}{n}" for n in (*NUMBERS[3:16], "1e5000")), *TEXTS, _RAW + '"\\ud800"',
    f"{_RAW}{'[' * 200}{']' * 200}", f"{_RAW}{'[' * 100_000}", _RAW + '{"a":' * 5000 + "1" + "}" * 5000,
)  # fmt: skip
_TOML = (
    "1", "-1", "0", "1.5", "nan", "inf", "-inf", "1e999", "9" * 30, "9" * 5000, "true", '""', '"x"', '"\\u0000"', "[]",
    "{}", "[1, 2]", '["a"]', "[[1]]", '{ a = 1 }', '{ lf = "1 N" }', "1979-05-27", "1979-05-27T07:32:00Z", "07:32:00",
    "[" * 2000 + "]" * 2000, "{a=" * 500 + "1" + "}" * 500, '"1 m"', '"nan N"', '"1e999 s"', '"1 furlong"', '"-5 mm"',
    '"../../x.fmu"', '"."', '"/dev/null"', '"' + "x" * 5000 + '"', "'''\n'''", '["a", "b", "c"]', '"=cmd|x"', "0x7fff",
)  # fmt: skip
_XML = (
    "", "-1", "1e999", "NaN", "9" * 30, "9" * 5000, "x", "true", "&#0;", "&lt;", "..", "/", "m", "1.5", "2.0", "3.0",
    "0", "lf.force", "x" * 5000, "2147483648", "4294967296", " 1 ", "é", "resources/none.fmu", "file:///dev/null",
)  # fmt: skip
_ENTITIES = (
    b'<!DOCTYPE d [<!ENTITY a "aaaaaaaaaa">'
    + b"".join(b'<!ENTITY %c "%s">' % (98 + i, b"&%c;" % (97 + i) * 10) for i in range(9))
    + b"]>",
    b'<!DOCTYPE d [<!ENTITY a SYSTEM "file:///etc/passwd">]>',
    b"<!DOCTYPE d>",
)


def change_json(rng: Random, content: bytes) -> bytes:
    """Change one to three places of a JSON document: value, key, order, type."""
    try:
        document = json.loads(content)
    except (ValueError, RecursionError):  # an earlier change made it malformed
        return content
    for _ in range(rng.randint(1, 3)):
        document = _changed(rng, document)
    text = json.dumps(document, indent=rng.choice((None, 1)), ensure_ascii=rng.random() < 0.5)
    return re.sub(rf'"{_escaped(_RAW)}((?:[^"\\]|\\.)*)"', _raw, text).encode("utf-8", "surrogatepass")


def _escaped(mark: str) -> str:
    return f"(?:{re.escape(mark)}|{re.escape(json.dumps(mark)[1:-1])})"


def _raw(found: re.Match[str]) -> str:
    return str(json.loads(f'"{found[1]}"'))


def _changed(rng: Random, document: Any) -> Any:
    """Change one place, found by a random walk from the root."""
    children = list(
        document if isinstance(document, dict) else range(len(document)) if isinstance(document, list) else ()
    )
    if not children or rng.random() < 0.15:
        return rng.choice(_VALUES)
    key = rng.choice(children)
    kind = rng.random()
    if kind < 0.1:
        del document[key]
    elif kind < 0.2 and isinstance(document, dict):
        document[rng.choice((*TEXTS[:12], *map(str, children)))] = document.pop(key)
    elif kind < 0.25 and isinstance(document, list):
        document.extend(document[:1] * rng.choice((1, 1000)))
    else:
        document[key] = _changed(rng, document[key]) if isinstance(document[key], (dict, list)) else rng.choice(_VALUES)
    return document


def change_toml(rng: Random, content: bytes) -> bytes:
    """Change one to three lines of a TOML document: value, key, table."""
    lines = content.decode().splitlines()
    for _ in range(rng.randint(1, 3)):
        at = rng.randrange(len(lines)) if lines else 0
        kind = rng.randrange(6)
        if kind < 3:
            settable = [i for i, line in enumerate(lines) if re.match(r"\s*[\w\"'.]+\s*=", line)]
            if settable:
                at = rng.choice(settable)
                lines[at] = f"{lines[at].partition('=')[0]}= {rng.choice(_TOML)}"
        elif kind == 3 and lines:
            del lines[at]
        elif kind == 4:
            key = rng.choice(("x", "schema", "a.b.c", '"é"', "name", "bond", "fmu"))
            lines.insert(at, f"{key} = {rng.choice(_TOML)}")
        else:
            table = rng.choice(("x", "bond", "scenario", "components.lf", "parameters", "drive", "a." * 300 + "b"))
            lines.insert(at, rng.choice((f"[{table}]", f"[[{table}]]")))
    return "\n".join(lines).encode()


def change_xml(rng: Random, content: bytes) -> bytes:
    """Change attributes, elements or the document type of an XML document."""
    for _ in range(rng.randint(1, 3)):
        kind = rng.randrange(8)
        if kind < 4:
            content = _substituted(rng, content, rb'"[^"<>]*"', b'"%s"' % rng.choice(_XML).encode())
        elif kind == 4:
            content = _substituted(rng, content, rb"<[^<>?]*/>", b"")
        elif kind == 5:
            content = _substituted(rng, content, rb'\s[\w:]+="[^"<>]*"', b"")
        elif kind == 6:
            found = re.search(rb"<[^<>?]*/>", content[rng.randrange(max(1, len(content))) :])
            content = _substituted(
                rng, content, rb"<[^<>?]*/>", (found[0] if found else b"<a/>") * rng.choice((2, 300))
            )
        else:
            content = _strange(rng, content)
    return content


def _strange(rng: Random, content: bytes) -> bytes:
    """Nest deeply, declare entities, or state another encoding."""
    body = re.sub(rb"^\s*<\?xml[^>]*\?>", b"", content)
    kind = rng.randrange(4)
    if kind == 0:
        return b"<a>" * 100_000 + body
    if kind == 1:
        return rng.choice(_ENTITIES) + re.sub(rb'"[^"<>]*"', b'"&a;&i;"', body, count=3)
    if kind == 2:
        depth = rng.choice((300, 20_000))
        return _substituted(rng, content, rb"<[^<>?]*/>", b"<x>" * depth + b"</x>" * depth)
    return b'<?xml version="1.0" encoding="%s"?>' % rng.choice((b"utf-16", b"nonsense", b"ascii", b"cp037")) + body


def _substituted(rng: Random, content: bytes, pattern: bytes, replacement: bytes) -> bytes:
    found = list(re.finditer(pattern, content))
    if not found:
        return content
    place = rng.choice(found)
    return content[: place.start()] + replacement + content[place.end() :]


_NAMES = (
    "/etc/evil", "../evil", "a/../../evil", "C:/evil", "a\\b", ".", "..", "./x", "a//b", "x" * 300, "x/" * 500 + "y",
    "\x01", "é", "con", "resources", "modelDescription.xml", "modelDescription.xml/x", "binaries", "header.npy",
    "SystemStructure.ssd", "x:y", " ", "nul.txt ",
)  # fmt: skip
_METHODS = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED, zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA)
Members = dict[str, bytes]
Member = Callable[[Random, str, bytes], bytes]


def members_of(content: bytes) -> Members:
    """Return the members of a valid archive."""
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        return {name: archive.read(name) for name in archive.namelist()}


def packed(members: Mapping[str, bytes], method: int = zipfile.ZIP_DEFLATED) -> bytes:
    """Return an archive with reproducible bytes; compression level 1 for speed."""
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", method, compresslevel=1) as archive:
        for name, content in members.items():
            archive.writestr(_entry(name), content, method, 1)
    return stream.getvalue()


def _entry(name: str) -> zipfile.ZipInfo:
    return zipfile.ZipInfo(name, (1980, 1, 1, 0, 0, 0))


def change_member(rng: Random, content: bytes, change: Member, likely: tuple[str, ...]) -> bytes:
    """Change one member, preferably one of the likely ones, and its checksum."""
    members = members_of(content)
    wanted = [name for name in members if name.endswith(likely)]
    name = rng.choice(wanted if wanted and rng.random() < 0.85 else list(members))
    return packed({**members, name: change(rng, name, members[name])})


def change_entries(rng: Random, content: bytes) -> bytes:
    """Add, remove, rename or repeat an entry, or change its attributes."""
    ways = (_add, _add, _rename, _drop, _twice, _link, _method, _many, _folder)
    return rng.choice(ways)(rng, members_of(content))


def change_heads(rng: Random, content: bytes) -> bytes:
    """Change a field of a local or a central header: flags (encrypted), method, checksum, sizes, offsets, names."""
    changed = bytearray(content)
    for _ in range(rng.randint(1, 3)):
        kind, size, fields = rng.choice((
            (b"PK\x03\x04", 4, (4, 6, 8, 14, 18, 22, 26, 28)),
            (b"PK\x01\x02", 4, (4, 6, 8, 10, 16, 20, 24, 28, 30, 32, 38, 42)),
            (b"PK\x05\x06", 4, (4, 8, 10, 12, 16, 20)),
        ))  # fmt: skip
        places = [i for i in range(len(content) - 30) if content[i : i + size] == kind]
        if places:
            at = rng.choice(places) + rng.choice(fields)
            value = rng.choice((0, 1, 0xFFFFFFFF, 0x7FFFFFFF, 0xFFFF, 8, 12, 14, 99, rng.getrandbits(32)))
            width = rng.choice((2, 4))
            changed[at : at + width] = struct.pack("<I", value)[:width]
    return bytes(changed)


def change_around(rng: Random, content: bytes) -> bytes:
    """Add bytes before or after the archive, or nest it."""
    ways = (
        lambda: b"#!/bin/sh\n" * 100 + content,
        lambda: content + b"x" * 100,
        lambda: content + content,
        lambda: packed({"inner.zip": content}),
        lambda: b"",
        lambda: packed({}),
    )
    return rng.choice(ways)()


def bomb(rng: Random, content: bytes) -> bytes:
    """Add 400 MB of zeros to the archive, in one entry or in many."""
    members = members_of(content)
    return _with_zeros(packed(members), rng.choice((1, 40)))


def _with_zeros(content: bytes, count: int) -> bytes:
    stream = io.BytesIO(content)
    with zipfile.ZipFile(stream, "a", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
        for k in range(count):
            zeros = _entry(f"resources/zeros{k}")
            zeros.compress_type = zipfile.ZIP_DEFLATED
            with archive.open(zeros, "w", force_zip64=True) as entry:
                for _ in range(400 // count):
                    entry.write(bytes(1_000_000))
    return stream.getvalue()


def _add(rng: Random, members: Members) -> bytes:
    return packed({**members, rng.choice(_NAMES): rng.randbytes(10)})


def _rename(rng: Random, members: Members) -> bytes:
    name = rng.choice(list(members))
    members[rng.choice(_NAMES)] = members.pop(name)
    return packed(members)


def _drop(rng: Random, members: Members) -> bytes:
    del members[rng.choice(list(members))]
    return packed(members)


def _twice(rng: Random, members: Members) -> bytes:
    stream = io.BytesIO(packed(members))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        with zipfile.ZipFile(stream, "a") as archive:
            archive.writestr(_entry(rng.choice(list(members))), rng.randbytes(20))
    return stream.getvalue()


def _link(rng: Random, members: Members) -> bytes:
    stream = io.BytesIO()
    linked = rng.choice(list(members))
    with zipfile.ZipFile(stream, "w") as archive:
        for name, content in members.items():
            entry = _entry(name)
            mode = (
                rng.choice((stat.S_IFLNK, stat.S_IFIFO, stat.S_IFCHR, stat.S_IFDIR)) if name == linked else stat.S_IFREG
            )
            entry.external_attr = (mode | 0o777) << 16
            archive.writestr(entry, content if mode == stat.S_IFREG else b"/etc/passwd")
    return stream.getvalue()


def _method(rng: Random, members: Members) -> bytes:
    return packed(members, rng.choice(_METHODS))


def _many(rng: Random, members: Members) -> bytes:
    return packed({**members, **{f"extra/{k}": b"" for k in range(rng.choice((1000, 1000, 1000, 21_000)))}})


def _folder(rng: Random, members: Members) -> bytes:
    name = rng.choice(list(members))
    return packed({**members, f"{name}/": b"", f"{name}/inside": b"x"})


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
            metadata[key] = change_json(rng, metadata[key])
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
    members = members_of(content)
    name = rng.choice(list(members))
    if name == "header.npy" or rng.random() < 0.3:
        header = str(np.load(io.BytesIO(members["header.npy"])))
        text = change_json(rng, header.encode()).decode("utf-8", "replace")
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
    return packed(members)


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
