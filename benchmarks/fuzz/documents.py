"""Changes of JSON, TOML and XML documents that keep them well-formed: unexpected types, sizes and names."""

from __future__ import annotations

import json
import re
from random import Random
from typing import Any

from benchmarks.fuzz.mutations import NUMBERS, TEXTS

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
