"""Changes of zip archives: invalid entries, wrong sizes, zip bombs, and changed members."""

from __future__ import annotations

import io
import stat
import struct
import warnings
import zipfile
from collections.abc import Callable, Mapping
from random import Random

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
