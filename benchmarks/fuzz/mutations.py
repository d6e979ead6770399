"""Changes of a file's bytes and texts, chosen by a given random generator."""

from __future__ import annotations

import re
from collections.abc import Callable
from random import Random

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
