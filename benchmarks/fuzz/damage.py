"""Damages to files: bits and texts, JSON, TOML and XML documents, columns of tables, archives."""

from __future__ import annotations

import io
import json
import re
import stat
import struct
import warnings
import zipfile
from collections.abc import Callable, Mapping, Sequence
from copy import deepcopy
from functools import partial
from random import Random
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet
import scipy.io

Change = Callable[[Random, bytes], bytes]

# ==== Bits and texts ==================================================================================================

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
_NUMBER = rb"-?\d+(?:\.\d+)?(?:[eE][+-]?\d+)?"
_WORDS = (0, 0xFFFFFFFF, 0x7FFFFFFF, 0x80000000, 1, 0x1000)
_LINKS = (0, 1, 2**63 - 1, 2**64 - 1, 2**32, 64, 10**12, 8 * 37, 8 * 500)
_MARKS = ",;\t\"'[](){}=:.#\n <>/&"


def flip_bits(rng: Random, content: bytes) -> bytes:
    """Flip one to eight bits."""
    changed = bytearray(content)
    for _ in range(rng.randint(1, 8) if content else 0):
        changed[rng.randrange(len(changed))] ^= 1 << rng.randrange(8)
    return bytes(changed)


def truncate(rng: Random, content: bytes) -> bytes:
    """Cut off the end, or leave nothing but white space or a byte order mark."""
    rest = content[: rng.randint(0, len(content))]
    return rng.choice((rest, rest, rest, b"", b"\n", b"\0", b"\xef\xbb\xbf", b"\xff\xfe"))


def insert(rng: Random, content: bytes) -> bytes:
    """Insert random bytes, NULs or a long run of one byte."""
    at = rng.randint(0, len(content))
    added = rng.choice((rng.randbytes(20), bytes(rng.randint(1, 40)), rng.randbytes(1) * 100_000))
    return content[:at] + added + content[at:]


def rearrange(rng: Random, content: bytes) -> bytes:
    """Remove or repeat a piece, or swap two."""
    a, b, c = sorted(rng.randint(0, len(content)) for _ in range(3))
    first, second = content[a:b], content[b:c]
    return content[:a] + rng.choice((second, first * rng.choice((2, 3, 50)) + second, second + first)) + content[c:]


def overwrite(
    rng: Random, content: bytes, within: int | None = None, words: Sequence[int] = _WORDS, form: str = "<I"
) -> bytes:
    """Overwrite one to four words of 32 bits, or those of the first bytes, with limits of integers."""
    changed, size = bytearray(content), struct.calcsize(form)
    for _ in range(rng.randint(1, 4)):
        at = size * rng.randrange(max(1, len(content[:within]) // size))
        changed[at : at + size] = struct.pack(form, rng.choice(words))
    return bytes(changed)


def recode(rng: Random, content: bytes) -> bytes:
    """Save in another encoding, with a byte order mark, or with bytes that are not valid UTF-8."""
    text = content.decode("utf-8", "replace")
    ways = (
        lambda: text.encode("utf-16"),
        lambda: text.encode("utf-16-le"),
        lambda: text.encode("utf-32"),
        lambda: b"\xef\xbb\xbf" * rng.choice((1, 3)) + content,
        lambda: content.replace(b"\n", b"\r"),
        lambda: content.replace(b"e", b"\xe9", 1),
        lambda: text.translate({ord(c): 0xFF00 + ord(c) - 0x20 for c in "0123456789,"}).encode(),
    )
    return rng.choice(ways)()


def replace(rng: Random, content: bytes, pattern: bytes, texts: Sequence[str]) -> bytes:
    """Replace one match of a pattern with one of some texts."""
    found = list(re.finditer(pattern, content[:200_000]))
    start, end = rng.choice(found).span() if found else (len(content), len(content))
    return content[:start] + rng.choice(texts).encode() + content[end:]


def change_lines(rng: Random, content: bytes) -> bytes:
    """Remove, repeat, swap, join or cut a line."""
    lines = content.split(b"\n")
    at, other = rng.randrange(len(lines)), rng.randrange(len(lines))
    line = lines.pop(at)
    kind = rng.randrange(5)
    if kind == 1:
        lines[at:at] = [line, line]
    elif kind == 2:
        lines.insert(other, line)
    elif kind == 3:
        lines[at : at + 1] = [b",".join([line, *lines[at : at + 1]])]
    elif kind == 4:
        lines.insert(at, line[: rng.randint(0, len(line))])
    return b"\n".join(lines)


def long_field(rng: Random, content: bytes) -> bytes:
    """Insert 10 MB at one place."""
    at = rng.randint(0, len(content))
    return content[:at] + rng.choice((b"7", b"x", b'"', b" ", b"\xc3\xa9", b"[", b",")) * 10_000_000 + content[at:]


overwrite_head = partial(overwrite, within=1024)
#: Links and lengths of an MDF 4 file become limits, other links or small numbers.
overwrite_links = partial(overwrite, within=6000, words=_LINKS, form="<Q")
BINARY: tuple[Change, ...] = (*(flip_bits,) * 2, truncate, insert, *(rearrange,) * 3, overwrite, overwrite_head)
TEXT: tuple[Change, ...] = (
    flip_bits, truncate, insert, *(rearrange,) * 3, recode, *(change_lines,) * 2,
    *(partial(replace, pattern=_NUMBER, texts=NUMBERS),) * 2,
    *(partial(replace, pattern=rb"[A-Za-z_][\w.]*", texts=TEXTS),) * 2,
    *(partial(replace, pattern=rb"[" + re.escape(_MARKS).encode() + rb"]", texts=_MARKS),) * 2,
)  # fmt: skip

# ==== Documents =======================================================================================================

#: Mark of a text that is written into a JSON document without quotes.
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
    '<!DOCTYPE d [<!ENTITY a "aaaaaaaaaa">'
    + "".join(f'<!ENTITY {chr(98 + i)} "{f"&{chr(97 + i)};" * 10}">' for i in range(9))
    + "]>",
    '<!DOCTYPE d [<!ENTITY a SYSTEM "file:///etc/passwd">]>',
    "<!DOCTYPE d>",
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
    mark = f"(?:{re.escape(_RAW)}|{re.escape(json.dumps(_RAW)[1:-1])})"
    raw = re.sub(rf'"{mark}((?:[^"\\]|\\.)*)"', lambda found: json.loads(f'"{found[1]}"'), text)
    return raw.encode("utf-8", "surrogatepass")


def _changed(rng: Random, document: Any) -> Any:
    """Change one place, found by a random walk from the root."""
    children: list[Any] = list(document) if isinstance(document, dict) else []
    children = list(range(len(document))) if isinstance(document, list) else children
    if not children or rng.random() < 0.15:
        return deepcopy(rng.choice(_VALUES))  # later changes are made in place
    key = rng.choice(children)
    kind = rng.random()
    if kind < 0.1:
        del document[key]
    elif kind < 0.2 and isinstance(document, dict):
        document[rng.choice((*TEXTS[:12], *map(str, children)))] = document.pop(key)
    elif kind < 0.25 and isinstance(document, list):
        document.extend(document[:1] * rng.choice((1, 1000)))
    else:
        document[key] = _changed(rng, document[key])
    return document


def change_toml(rng: Random, content: bytes) -> bytes:
    """Change one to three lines of a TOML document: value, key, table."""
    lines = content.decode().splitlines()
    for _ in range(rng.randint(1, 3)):
        at, value, kind = rng.randrange(len(lines) + 1), rng.choice(_TOML), rng.randrange(6)
        settable = [i for i, line in enumerate(lines) if re.match(r"\s*[\w\"'.]+\s*=", line)]
        if kind < 3 and settable:
            at = rng.choice(settable)
            lines[at] = f"{lines[at].partition('=')[0]}= {value}"
        elif kind == 3:
            del lines[at : at + 1]
        elif kind == 4:
            key = rng.choice(("x", "schema", "a.b.c", '"é"', "name", "bond", "fmu"))
            lines.insert(at, f"{key} = {value}")
        else:
            table = rng.choice(("x", "bond", "scenario", "components.lf", "parameters", "drive", "a." * 300 + "b"))
            lines.insert(at, rng.choice((f"[{table}]", f"[[{table}]]")))
    return "\n".join(lines).encode()


def change_xml(rng: Random, content: bytes) -> bytes:
    """Change attributes or elements of an XML document, nest deeply, declare entities, or state another encoding."""
    for _ in range(rng.randint(1, 3)):
        body = re.sub(rb"^\s*<\?xml[^>]*\?>", b"", content)
        element = rng.choice(re.findall(rb"<[^<>?]*/>", content) or [b"<a/>"]).decode("utf-8", "replace")
        depth, encoding = rng.choice((300, 20_000)), rng.choice(("utf-16", "nonsense", "ascii", "cp037"))
        elements = ("", "", element * 2, element * 300, "<x>" * depth + "</x>" * depth)
        content = rng.choice((
            *(partial(replace, rng, content, rb'"[^"<>]*"', [f'"{text}"' for text in _XML]),) * 6,
            *(partial(replace, rng, content, rb"<[^<>?]*/>", elements),) * 4,
            partial(replace, rng, content, rb'\s[\w:]+="[^"<>]*"', [""]),
            lambda body=body: b"<a>" * 100_000 + body,
            lambda body=body: rng.choice(_ENTITIES).encode() + re.sub(rb'"[^"<>]*"', b'"&a;&i;"', body, count=3),
            lambda body=body, encoding=encoding: f'<?xml version="1.0" encoding="{encoding}"?>'.encode() + body,
        ))()  # fmt: skip
    return content


# ==== Archives ========================================================================================================

_NAMES = (
    "/etc/evil", "../evil", "a/../../evil", "C:/evil", "a\\b", ".", "..", "./x", "a//b", "x" * 300, "x/" * 500 + "y",
    "\x01", "é", "con", "resources", "modelDescription.xml", "modelDescription.xml/x", "binaries", "header.npy",
    "SystemStructure.ssd", "x:y", " ", "nul.txt ",
)  # fmt: skip
_METHODS = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED, zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA)
_MODES = (stat.S_IFLNK, stat.S_IFIFO, stat.S_IFCHR, stat.S_IFDIR)
#: Signatures of headers of an archive, and offsets of their fields.
_HEADERS = (
    (b"PK\x03\x04", (4, 6, 8, 14, 18, 22, 26, 28)),
    (b"PK\x01\x02", (4, 6, 8, 10, 16, 20, 24, 28, 30, 32, 38, 42)),
    (b"PK\x05\x06", (4, 8, 10, 12, 16, 20)),
)


def members_of(content: bytes) -> dict[str, bytes]:
    """Return the members of a valid archive."""
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        return {name: archive.read(name) for name in archive.namelist()}


def packed(
    members: Mapping[str, bytes], method: int = zipfile.ZIP_DEFLATED, more: Mapping[str, Any] | None = None
) -> bytes:
    """Return an archive with reproducible bytes; compression level 1 for speed.

    Members of `more`, the content or the Unix mode of a special file, are added even if their names occur twice.
    """
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", method, compresslevel=1) as archive, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for name, content in (*members.items(), *(more or {}).items()):
            entry = zipfile.ZipInfo(name)
            if isinstance(content, int):
                entry.external_attr = (content | 0o777) << 16
            archive.writestr(entry, b"/etc/passwd" if isinstance(content, int) else content, method, 1)
    return stream.getvalue()


def change_member(
    rng: Random, content: bytes, change: Callable[[Random, str, bytes], bytes], likely: tuple[str, ...]
) -> bytes:
    """Change one member, preferably one of the likely ones, and its checksum."""
    members = members_of(content)
    wanted = [name for name in members if name.endswith(likely)]
    name = rng.choice(wanted if wanted and rng.random() < 0.85 else list(members))
    return packed({**members, name: change(rng, name, members[name])})


def change_entries(rng: Random, content: bytes) -> bytes:
    """Add, remove, rename or repeat an entry, or change its attributes."""
    members = members_of(content)
    name, other = rng.choice(list(members)), rng.choice(_NAMES)
    rest = {key: value for key, value in members.items() if key != name}
    ways = (
        *(lambda: packed({**members, other: rng.randbytes(10)}),) * 2,
        lambda: packed({**rest, other: members[name]}),
        lambda: packed(rest),
        lambda: packed(members, more={name: rng.randbytes(20)}),
        lambda: packed(rest, more={name: rng.choice(_MODES)}),
        lambda: packed(members, rng.choice(_METHODS)),
        lambda: packed({**members, **{f"extra/{k}": b"" for k in range(rng.choice((1000, 1000, 1000, 21_000)))}}),
        lambda: packed({**members, f"{name}/": b"", f"{name}/inside": b"x"}),
    )
    return rng.choice(ways)()


def change_heads(rng: Random, content: bytes) -> bytes:
    """Change a field of a local or a central header: flags (encrypted), method, checksum, sizes, offsets, names."""
    changed = bytearray(content)
    for _ in range(rng.randint(1, 3)):
        signature, fields = rng.choice(_HEADERS)
        if places := [found.start() for found in re.finditer(re.escape(signature), content[:-22])]:
            at, width = rng.choice(places) + rng.choice(fields), rng.choice((2, 4))
            value = rng.choice((0, 1, 0xFFFFFFFF, 0x7FFFFFFF, 0xFFFF, 8, 12, 14, 99, rng.getrandbits(32)))
            changed[at : at + width] = struct.pack("<I", value)[:width]
    return bytes(changed)


def change_around(rng: Random, content: bytes) -> bytes:
    """Add bytes before or after the archive, or nest it."""
    around = (b"#!/bin/sh\n" * 100 + content, content + b"x" * 100, content + content, b"", packed({}))
    return rng.choice((*around, packed({"inner.zip": content})))


def bomb(rng: Random, content: bytes) -> bytes:
    """Add 400 MB of zeros to the archive, in one entry or in many."""
    stream, count = io.BytesIO(packed(members_of(content))), rng.choice((1, 40))
    with zipfile.ZipFile(stream, "a", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
        for k in range(count):
            zeros = zipfile.ZipInfo(f"resources/zeros{k}")
            zeros.compress_type = zipfile.ZIP_DEFLATED
            with archive.open(zeros, "w", force_zip64=True) as entry:
                for _ in range(400 // count):
                    entry.write(bytes(1_000_000))
    return stream.getvalue()


# ==== Tables ==========================================================================================================


def change_parquet(rng: Random, content: bytes) -> bytes:
    """Change a column's type or name, remove or repeat it, remove the rows, or change a header in the metadata."""
    table = pa.parquet.read_table(io.BytesIO(content))
    metadata = dict(table.schema.metadata or {})
    for _ in range(rng.randint(1, 2)):
        kind, column = rng.randrange(6), rng.randrange(max(1, table.num_columns))
        if kind < 2 and metadata:
            key = rng.choice(list(metadata))
            metadata[key] = change_json(rng, metadata[key])
        elif kind == 2 and table.num_columns:
            table = table.set_column(column, table.column_names[column], _column(rng, table.num_rows))
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


def _column(rng: Random, rows: int) -> pa.Array:
    kinds = (
        ([None], None), ([None], pa.float64()), (["=cmd|' /C calc'!A0"], None), ([b"\xff\xfe"], pa.binary()),
        ([[1.0, 2.0]], None), ([{"a": 1}], None), ([True], None), ([1], pa.timestamp("ns")), ([2**63 - 1], None),
        ([-1], None), ([np.inf], None), ([1e308], None), (["a"], pa.dictionary(pa.int32(), pa.string())),
        ([np.float16(0.0)], pa.float16()),
    )  # fmt: skip
    values, kind = rng.choice(kinds)
    return pa.array(values * rows, kind)


#: Replacement for the header text of a MATLAB file, into which scipy writes today's date.
_HEAD = b"MATLAB 5.0 MAT-file".ljust(116)


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
        if rng.random() < 0.15 and len(variables) > 1:
            variables.pop(name, None)
        else:
            variables[name] = rng.choice(values)
    if rng.random() < 0.2:
        variables = {"data": dict(variables)}
    stream = io.BytesIO()
    scipy.io.savemat(stream, variables, long_field_names=True, do_compression=rng.random() < 0.5)
    return _HEAD + stream.getvalue()[len(_HEAD) :]


_SHAPES = ("(1000000000000,)", "(-1,)", "()", "(9" * 50 + ",)", "((((1,),),),)", "(True,)", "1", "([],)")
_KINDS = ("'<f8'", "'|O'", "'<c16'", "'<U999999999'", "'x'", "[('a', '<f8')]", "1", "'<M8[ns]'", "()")


def change_npz(rng: Random, content: bytes) -> bytes:
    """Change the header's JSON, or an array's type, shape or header."""
    members = members_of(content)
    name = rng.choice(list(members))
    if name == "header.npy" or rng.random() < 0.3:
        header = str(np.load(io.BytesIO(members["header.npy"])))
        members["header.npy"] = _npy(np.array(change_json(rng, header.encode()).decode("utf-8", "replace")))
    elif rng.random() < 0.5:
        array = np.load(io.BytesIO(members[name]))
        ways = (array[..., :1], array.T, array.astype(complex), array.astype(str), array * np.nan, array[:0],
                array[None], np.array(1.0), array.astype(np.int64), array > 0, np.array([None, 1], dtype=object),
                -array, np.zeros(3, dtype=[("a", float)]))  # fmt: skip
        members[name] = _npy(rng.choice(ways))
    else:
        fields = f"'descr': {rng.choice(_KINDS)}, 'fortran_order': {rng.choice(('False', 'True', '3'))}"
        head = f"{{{fields}, 'shape': {rng.choice(_SHAPES)}, }}\n".encode()
        magic = b"\x93NUMPY" + bytes((rng.choice((1, 1, 1, 2, 3, 9)), 0))
        members[name] = magic + struct.pack("<H", len(head)) + head + bytes(80)
    return packed(members)


def _npy(array: np.ndarray[Any, Any]) -> bytes:
    stream = io.BytesIO()
    np.save(stream, array, allow_pickle=True)
    return stream.getvalue()
