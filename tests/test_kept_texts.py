"""Messages about files, names and units, digests, and reports of progress: no word and no limit changes unseen."""

from __future__ import annotations

import sys
import zipfile
from collections.abc import Callable
from io import StringIO
from pathlib import Path

import pytest
from pydantic import BaseModel

from eightpost import progress, units
from eightpost.archive import extract_archive, read_archive, write_archive
from eightpost.display import Summary, some
from eightpost.errors import DataError, EightpostError, check_number, choice_of, missing_file, suggestion
from eightpost.files import (
    LARGEST_TEXT,
    check_schema,
    parse_json,
    parse_toml,
    plain_cell,
    quoted_cell,
    read_bytes,
    read_text,
    safe_cell,
    safe_line,
    write_rows,
)
from eightpost.toml_document import line_with, parse_model
from eightpost.verdict import Grade, Reason, Verdict, listed


def _told(call: Callable[[], object]) -> str:
    """Return what a call returns, or the message of its error without the folder of the test."""
    try:
        return repr(call())
    except EightpostError as error:
        return f"{type(error).__name__}: {error}"


DEEP = {depth: "[" * depth + "]" * depth for depth in (63, 64, 65, 66)}
TEXTS = {
    "empty": "", "blank": " \n", "cut off": '{"a": [1, 2', "not a value": '{"a": x}',
    "twice": '{"a": 1, "b": {"c": 1, "c": 2}}',
    "nan": '{"a": NaN}', "infinity": '{"a": -Infinity}', "huge": '{"a": 1e400}',
    "largest": '{"a": 9223372036854775807}',
    "larger": '{"a": 9223372036854775808}', "lowest": '{"a": -9223372036854775808}',
    "lower": '{"a": -9223372036854775809}',
    "long": '{"a": 123456789012345678901234567890}', "20 digits": '{"a": 12345678901234567890}',
    "5000 digits": '{"a": ' + "9" * 5000 + "}", "100000 deep": "[" * 100_000, "second line": '{"a": 1,\n "b"}',
    "surrogate": '{"a": "\\ud800"}', "pair": '{"a": "\\ud83d\\ude00"}', "list": "[1, 2.5, true, null]",
    **{f"{depth} deep": text for depth, text in DEEP.items()},
}  # fmt: skip
TOML = {
    "empty": "", "comment": "# nothing\n", "largest": "a = 9223372036854775807",
    "larger": "a = 9223372036854775808", "lower": "a = -9223372036854775809", "nan": "a = nan",
    "5000 digits": "a = " + "9" * 5000, "deep keys": ".".join("a" * 300) + " = 1", "no value": "a = \nb = 2",
    **{f"{depth} deep": f"a = {text}" for depth, text in DEEP.items()},
}  # fmt: skip


def test_texts_that_are_no_documents_are_refused_with_the_same_message(unchanged: Callable[..., None]) -> None:
    found = {
        f"JSON, {name}": _told(lambda text=text: parse_json(text, "x.json", finite=True))
        for name, text in TEXTS.items()
    }
    found |= {f"JSON of any number, {name}": _told(lambda text=text: parse_json(text, "x.json", finite=False))
              for name, text in TEXTS.items() if name in ("nan", "infinity", "huge")}  # fmt: skip
    found |= {f"TOML, {name}": _told(lambda text=text: parse_toml(text, "x.toml")) for name, text in TOML.items()}
    numbers = [{"schema": number} for number in (0, 1, 2, True, "1", 3)]
    others = [{}, {"a": 1, "b": 2}, dict.fromkeys("abcdef", 1), {"name": 1}]
    for content in (*numbers, *others, {"schema": 3, "tool": "a b"}, {"schema": 3, "tool_version": "9"}):
        found[f"schema of {content}"] = _told(lambda content=content: check_schema(content, 2, "x.json"))
    unchanged({name: text[:300] for name, text in found.items()})


@pytest.mark.skipif(sys.platform == "win32", reason="a link needs a permission there")
def test_files_that_cannot_be_read_are_refused_with_the_same_message(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, unchanged: Callable[..., None]
) -> None:
    monkeypatch.chdir(tmp_path)
    for name, content in {"dyno_A.csv": b"1234", "notes.txt": b"a\nb\n\xff", "bom.txt": b"\xef\xbb\xbfx"}.items():
        Path(name).write_bytes(content)
    Path("folder").mkdir()
    Path("link").symlink_to("nowhere")
    names = ["dyno_a.csv", "dyno_B.csv", "dino_A.cvs", "else", "link", "no/dyno_A.csv", "folder", "\x00", "notes.txt",
             "bom.txt"]  # fmt: skip
    found = {f"reading {name!r}": _told(lambda name=name: read_text(name, advice="look elsewhere")) for name in names}
    found |= {f"missing {name!r}": missing_file(name) for name in names[:5]}
    found |= {f"{limit} bytes": _told(lambda limit=limit: read_bytes("dyno_A.csv", limit=limit)) for limit in (3, 4, 5)}
    unchanged(found | {"largest": LARGEST_TEXT})


def test_cells_of_a_table_are_written_in_the_same_way(unchanged: Callable[..., None]) -> None:
    cells = ("=1+1", "-1.5", "-x", "+2", "@a", "1e-3", "-1e5", "-.5", "-5.", "'=a", "''=a", "'tis", "a,b", 'a"b', "a;b",
             "", "\t=1", "＝1")  # fmt: skip
    stream = StringIO()
    write_rows(stream, [["a", "b,c", "=d"], ["1", "-2.5", 'e"f']])
    unchanged({
        "safe": [safe_cell(cell) for cell in cells], "plain": [plain_cell(cell) for cell in cells],
        "quoted": [quoted_cell(cell) for cell in cells],
        "lines": [safe_line(line) for line in ("a,=b;-c\t@d", "-1.5,+2,=3", "x,'=y", ",,=")],
        "rows": repr(stream.getvalue()),
    })  # fmt: skip


class _Part(BaseModel, extra="forbid", strict=True):
    name: str
    size: float
    tags: list[str] = []


class _Whole(BaseModel, strict=True):
    parts: list[_Part]


DOCUMENT = """schema = 1
[[parts]]
name = "first"
size = 2.5
[[parts]]
name = "second"
size = {size}
tags = {tags}
"""


def test_a_wrong_entry_is_named_with_its_line(unchanged: Callable[..., None]) -> None:
    cases = [
        ("2", "[]"), ('"a"', "[]"), ("true", "[]"), ("1.5", "[1]"), ("1.5", '["a", 2]'), ("1.5", '"a"'),
        ("1\nother = 3", "[]"), ("1\nother = 3\nmore = 4", "[1, 2, 3, 4, 5, 6, 7]"),
    ]  # fmt: skip
    texts = {str(case): DOCUMENT.format(size=case[0], tags=case[1]) for case in cases}
    found = {case: _told(lambda text=text: parse_model(_Whole, text, Path("x.toml"), 1))
             for case, text in texts.items()}  # fmt: skip
    for message in ("no 'first' here", "'second' and 'first'; 'tags'", "'size'", "'schema'", "'none'", "nothing"):
        found[f"line with {message}"] = line_with(DOCUMENT.format(size=1, tags=[]), message)
    unchanged(found)


def test_names_and_numbers_are_told_in_the_same_way(unchanged: Callable[..., None]) -> None:
    words = ["compression", "rebound", "displacement", "velocity", "force"]
    found: dict[str, object] = {
        f"suggestion of {name}": suggestion(name, words) for name in ("compresion", "rebond", "Force", "xyz", "vel", "")
    }
    found |= {f"choice of {name}": _told(lambda name=name: choice_of("word", name, ["us", "si", "2"]))
              for name in ("us", " SI ", "2.0", "sj", "else", 2)}  # fmt: skip
    found |= {
        f"number {value!r}": _told(lambda value=value: check_number("step", value, "s"))
        for value in (1, 1.5, True, "1", None)
    }
    for most in (1, 3, 4, 5):
        found[f"{most} of four"] = [some("abcd", most), listed("abcd", most), listed("aabbccdd", most)]
    found["default"] = [some("abcdefgh"[:k]) for k in (4, 5, 6)] + [listed("abcdefgh"[:k]) for k in (3, 4, 5)]
    summary = Summary.of("Title", ("a", "x" * 96), ("long label", "y" * 97), ("none", ""), ("b", "<z>"))
    found |= {"summary": summary.text(), "html": summary.html()}
    for places in ({}, {"path": "a.csv"}, {"path": "a.csv", "line": 3}, {"line": 3, "channel": "force"},
                   {"channel": "force"}):  # fmt: skip
        found[f"at {places}"] = str(DataError("it is wrong", **places))
    unchanged(found)


def _reason(rule: str, about: str, grade: Grade, origin: str = "a.csv") -> Reason:
    return Reason(rule, about, grade, f"{about} is {rule}", "1 N", origin, "nothing")


def test_a_verdict_is_summed_up_in_the_same_way(unchanged: Callable[..., None]) -> None:
    grades, found = list(Grade), {}
    for count in range(5):
        reasons = [_reason(f"rule {k}", f"part {k % 2}", grades[k % len(grades)], f"{k}.csv") for k in range(count)]
        reasons += [_reason("rule x", "part 0", grades[-1], f"{k}.csv") for k in range(3 * count)]
        verdict = Verdict(reasons)
        found[f"{count} reasons"] = {
            "summary": verdict.summary(),
            "acceptable": verdict.is_acceptable,
            **verdict.to_json(),
        }
    for document in ({}, [], {"reasons": "x"}, {"reasons": [1]}, {"reasons": [{"rule": "a"}]}, "x" * 78, "x" * 79,
                     {"reasons": [{**verdict.to_json()["reasons"][0], "grade": "poor"}]}):  # fmt: skip
        found[f"document {str(document)[:30]}"] = _told(lambda document=document: Verdict.from_json(document))
    unchanged({name: str(one) for name, one in found.items()})


# ---- Progress -------------------------------------------------------------------------------------------------------


def test_shares_of_nested_parts_are_reported_once_a_percent_or_after_a_while(
    monkeypatch: pytest.MonkeyPatch, unchanged: Callable[..., None]
) -> None:
    told: list[tuple[float, float]] = []
    clock = iter(range(100_000))
    monkeypatch.setattr(progress.time, "monotonic", lambda: 0.011 * next(clock))
    with progress.reported_to(lambda done, total: told.append((done, total))):
        for part in progress.parts("abc"):
            with progress.portion(0.2, 0.6):
                for k in range(40):
                    progress.advance(k, 39)
            if part == "b":
                progress.beat()
                progress.advance(5, 0)
            for _ in progress.beats(range(20)):
                pass
        progress.advance(2.0, 1.0)
    unchanged({"reports": " ".join(f"{done:.6f}/{total:g}" for done, total in told), "count": len(told)})


def test_amounts_that_begin_again_are_added() -> None:
    told: list[tuple[float, float]] = []
    tell = progress.continued(lambda done, total: told.append((done, total)))
    for done, total in ((1, 4), (4, 4), (0, 3), (2, 3), (1, 2)):
        tell(done, total)
    assert told == [(1, 4), (4, 4), (4, 7), (6, 7), (7, 8)]


# ---- Archives -------------------------------------------------------------------------------------------------------


def test_an_archive_is_written_in_the_same_way_and_its_unsafe_entries_are_named(
    tmp_path: Path, unchanged: Callable[..., None]
) -> None:
    write_archive(
        tmp_path / "x.fmu", {"b/c.txt": b"content " * 99, "a.xml": b"<a/>", "binaries/linux64/x.so": bytes(1000)}
    )
    with zipfile.ZipFile(tmp_path / "x.fmu") as archive:
        entries = [
            f"{e.filename} {e.date_time} {e.compress_type} {e.external_attr:o} {e.file_size}"
            for e in archive.infolist()
        ]
    found: dict[str, object] = {
        "entries": entries,
        "read": {name: len(one) for name, one in read_archive(tmp_path / "x.fmu").items()},
    }
    for name in ("../a", "/a", "a/../b", "a//b", "C:/a", "a\\b", "..", "a/", ".", "a/./b", "con/x", "~/a"):
        with zipfile.ZipFile(tmp_path / "y.zip", "w") as archive:
            archive.writestr(zipfile.ZipInfo(name), b"x")
        found[f"entry {name!r}"] = _told(lambda: sorted(read_archive(tmp_path / "y.zip"))).replace(str(tmp_path), "")
        extracted = _told(lambda: extract_archive(tmp_path / "y.zip", tmp_path / "out"))
        found[f"extracted {name!r}"] = extracted.replace(str(tmp_path), "")
    unchanged(found)


# ---- Units ----------------------------------------------------------------------------------------------------------


def test_numbers_are_shown_in_the_same_units(unchanged: Callable[..., None]) -> None:
    found: dict[str, object] = {}
    for unit in ["N", "m", "m/s", "N.s/m", "N/m", "K", "Pa", "kg", "W", "J", "rad", "Hz", "s", "1", "m/s2", "N.m",
                 "kg.m2"]:  # fmt: skip
        with units.stated_by("us"):
            shown = [*units.shown(2.5, unit), units.shown_range(-1.0, 300.0, unit)]
            found[f"us {unit}"] = [units.display_unit(unit), units.us_customary(unit), units.metric(unit), *shown]
        with units.stated_by("si"):
            shown = [*units.shown(2.5, unit), units.shown_range(-1.0, 300.0, unit)]
            found[f"si {unit}"] = [*shown, units.si_exponents(unit), units.si_factor(unit)]
    for text in ("10 lbf", "1.5 in/s", "-3e2 N", "20 degC", "5", "x N", "3 furlongs/fortnight", "1 lbf.s/in", "inf m",
                 "", "7 %", "12 psi"):  # fmt: skip
        found[f"quantity {text!r}"] = _told(lambda text=text: units.quantity(text))
    for pair in (("in", "m"), ("degF", "K"), ("lbf", "N"), ("psi", "Pa"), ("m", "kg"), ("mm/s", "in/s"),
                 ("deg", "rad")):  # fmt: skip
        found[f"conversion {pair}"] = _told(lambda pair=pair: units.conversion(*pair))
    found["difference"] = [units.shown_difference(10.0)]
    unchanged({name: str(one) for name, one in found.items()})
