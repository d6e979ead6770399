"""Seeded defects: each is added to a copy of a native FMU, and `check` must find it with the right rule.

Defects of modelDescription.xml and of the C code are in check_defects.toml, those of model exchange in
check_defects_exchange.toml; defects of the archive are in this file.
"""

from __future__ import annotations

import hashlib
import importlib.util
import re
import shutil
import subprocess
import sys
import tomllib
import zipfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from builder.check import CATALOGUE, check
from eightpost.archive import read_archive, write_archive

XML = "modelDescription.xml"
RULES = {rule.identifier for rule in CATALOGUE}
STATIC = ("static",)
TABLES: dict[str, dict[str, Any]] = {"on_file": {}, "in_code": {}}
for _name in ("check_defects.toml", "check_defects_exchange.toml"):
    for _kind, _entries in tomllib.loads(Path(__file__).with_name(_name).read_text(encoding="utf-8")).items():
        TABLES[_kind] |= _entries

Members = dict[str, bytes]
Change = Callable[[Members], None]


@dataclass(frozen=True)
class Defect:
    """A change of an FMU's members, the rule that must find it, and the groups of checks to run."""

    rule: str
    change: Change
    groups: tuple[str, ...] = STATIC
    fmu: str = "lpnl2"


def tabled(entry: Mapping[str, Any], change: Callable[[Mapping[str, str]], Change]) -> Defect:
    """Return the defect for an entry of the table; `change` converts a description of a change to the change."""

    def apply(members: Members) -> None:
        for one in entry.get("changes", [entry]):
            change(one)(members)

    return Defect(entry["rule"], apply, tuple(entry.get("groups", STATIC)), entry.get("fmu", "lpnl2"))


def in_description(entry: Mapping[str, str]) -> Change:
    """Return a replacement of a regular expression in modelDescription.xml: in the file, a variable, or a section."""

    def change(members: Members) -> None:
        text = members[XML].decode()
        begin, end = 0, len(text)
        if "variable" in entry:
            begin = text.index(f'<ScalarVariable name="{entry["variable"]}"')
            end = text.index("</ScalarVariable>", begin)
        elif "section" in entry:
            begin, end = text.index(f"<{entry['section']}>"), text.index(f"</{entry['section']}>")
        inside, changed = re.subn(entry["old"], entry["new"], text[begin:end], count=1, flags=re.DOTALL)
        assert changed, f"there is no {entry['old']!r} to change"
        members[XML] = (text[:begin] + inside + text[end:]).encode()

    return change


def in_source(entry: Mapping[str, str]) -> Change:
    """Return a replacement of text everywhere in a C source, or an addition of C after every successful step."""
    if "after_step" in entry:
        return after_step(entry["after_step"], entry.get("declare", ""))

    def change(members: Members) -> None:
        name = f"sources/{entry['file']}"
        assert entry["old"].encode() in members[name], f"there is no {entry['old']!r} in {name}"
        members[name] = members[name].replace(entry["old"].encode(), entry["new"].encode())

    return change


def in_either(entry: Mapping[str, str]) -> Change:
    """Return a change of a C source, or of modelDescription.xml if no source is named."""
    return in_source(entry) if entry.keys() & {"file", "after_step"} else in_description(entry)


def after_step(code: str, declare: str) -> Change:
    """Return an addition of C to the end of every successful step; `declare` goes to the top of the file."""
    header, stepped = b'#include "instance.h"', b"c->memory.time = time + h;"

    def change(members: Members) -> None:
        text = members["sources/step.c"]
        assert header in text and stepped in text
        text = text.replace(header, header + f"\n#include <stdlib.h>\n{declare}".encode())
        members["sources/step.c"] = text.replace(stepped, stepped + f" {code}".encode())

    return change


def edited(name: str, old: bytes, new: bytes) -> Change:
    """Return a replacement of bytes in one member."""

    def change(members: Members) -> None:
        assert old in members[name], f"there is no {old!r} in {name}"
        members[name] = members[name].replace(old, new)

    return change


def without(name: str) -> Change:
    """Return the removal of members whose names start with `name`."""

    def change(members: Members) -> None:
        gone = [member for member in members if member.startswith(name)]
        assert gone
        for member in gone:
            del members[member]

    return change


def member(name: str, alter: Callable[[bytes], bytes]) -> Change:
    """Return a change of one member, which is created if it is missing."""

    def change(members: Members) -> None:
        members[name] = alter(members.get(name, b""))

    return change


def moved(old: str, new: str) -> Change:
    """Return a renaming of one member."""

    def change(members: Members) -> None:
        members[new] = members.pop(old)

    return change


def swapped(first: str, second: str) -> Change:
    """Return an exchange of two members."""

    def change(members: Members) -> None:
        members[first], members[second] = members[second], members[first]

    return change


def copied(source: str, target: str) -> Change:
    """Return the replacement of one member with a copy of another."""

    def change(members: Members) -> None:
        members[target] = members[source]

    return change


def both(*changes: Change) -> Change:
    """Return the combination of several changes."""

    def change(members: Members) -> None:
        for one in changes:
            one(members)

    return change


def cut(content: bytes) -> bytes:
    return content[: len(content) * 2 // 3]


LINUX, WINDOWS, MAC = "binaries/linux64/lpnl2.so", "binaries/win64/lpnl2.dll", "binaries/darwin64/lpnl2.dylib"
WIN32, ARM, ARM_MAC = (
    "binaries/win32/lpnl2.dll",
    "binaries/aarch64-linux/lpnl2.so",
    "binaries/aarch64-darwin/lpnl2.dylib",
)
TERMINALS, STEP = "terminalsAndIcons/terminalsAndIcons.xml", "sources/step.c"
LICENCE = "documentation/licenses/license.txt"
REFERENCE = "extra/eightpost/lpnl2_ref.csv"
NO_SOURCES = in_description({"old": r"<SourceFiles>.*?</SourceFiles>(.*?)<SourceFiles>.*?</SourceFiles>", "new": r"\1"})


def digit_before_the_middle(content: bytes) -> bytes:
    """Insert a digit before the first output at 0.5 s."""
    changed, count = re.subn(rb"(?m)^(0\.5,-?)", rb"\g<1>1", content, count=1)
    assert count
    return changed


def defects_of_the_archive() -> dict[str, Defect]:
    return {
        "Linux binary cut off": Defect("binary-format", member(LINUX, cut)),
        "Windows binary cut off": Defect("binary-format", member(WINDOWS, cut)),
        "macOS binary cut off": Defect("binary-format", member(MAC, cut)),
        "text for a library": Defect("binary-format", member(WIN32, lambda _: b"not a library")),
        "empty library": Defect("binary-format", member(LINUX, lambda _: b"")),
        "processors exchanged": Defect("binary-machine", swapped(ARM, LINUX)),
        "32 bit for 64": Defect("binary-machine", swapped(WIN32, WINDOWS)),
        "Mach-O in a Linux folder": Defect("binary-format", copied(MAC, LINUX)),
        "not universal": Defect("darwin-universal", copied(ARM_MAC, MAC)),
        "a platform missing": Defect("platforms", without("binaries/win32/")),
        "a platform of no name": Defect("platform-name", moved(WIN32, "binaries/windows/lpnl2.dll")),
        "binary of another name": Defect("binary-name", moved(LINUX, "binaries/linux64/liblpnl2.so")),
        "nothing to run": Defect("binary-present", both(without("binaries/"), NO_SOURCES)),
        "a function renamed": Defect("exports", edited(LINUX, b"fmi2SetFMUstate", b"fmi2PutFMUstate")),
        "a function of model exchange renamed": Defect(
            "exports", edited(LINUX, b"fmi2GetDerivatives", b"fmi2PutDerivatives")
        ),
        "a strange export": Defect("exports-only", edited(LINUX, b"fmi2GetString\0", b"get_the_texts\0")),
        "an optional function missing": Defect("exports-all", edited(LINUX, b"fmi2CancelStep", b"fmi2AbandonIt_")),
        "a library too many": Defect("needed-libraries", edited(LINUX, b"libc.so.6", b"libd.so.6")),
        "a Python symbol": Defect("undefined-python", edited(LINUX, b"\0memset\0", b"\0PyMain\0")),
        "a Python symbol, denied": Defect("execution-tool-honest", edited(LINUX, b"\0memset\0", b"\0PyMain\0")),
        "a source missing": Defect("source-files", without(STEP)),
        "no sources": Defect("sources", NO_SOURCES),
        "no documentation": Defect("documentation", without("documentation/index.html")),
        "no licence": Defect("license", without("documentation/licenses/")),
        "empty documentation": Defect("documentation", member("documentation/index.html", lambda _: b"")),
        "empty licence": Defect("license", member(LICENCE, lambda _: b"")),
        "a second licence, empty": Defect("license", member("documentation/licenses/other.txt", lambda _: b"\n")),
        "no icon": Defect("icon", without("model.png")),
        "a JPEG called PNG": Defect("icon-format", member("model.png", lambda _: b"\xff\xd8\xff\xe0")),
        "an icon of a signature only": Defect("icon-format", member("model.png", lambda content: content[:8])),
        "an icon cut off": Defect("icon-format", member("model.png", cut)),
        "an icon of noise": Defect("icon-format", member("model.png", lambda content: content[:8] + bytes(100))),
        "no terminals": Defect("terminals", without("terminalsAndIcons/")),
        "terminal of no variable": Defect(
            "terminals-valid", edited(TERMINALS, b'variableName="force"', b'variableName="Force"')
        ),
        "terminals broken": Defect("terminals-valid", member(TERMINALS, cut)),
        "force into the shock": Defect("terminals-consistent", edited(TERMINALS, b'"outflow"', b'"inflow"')),
        "force out of the car": Defect(
            "terminals-consistent", edited(TERMINALS, b'"inflow"', b'"outflow"'), fmu="quarter_car"
        ),
        "a velocity that flows": Defect("terminals-consistent", edited(TERMINALS, b'"signal"', b'"inflow"')),
        "a local in a terminal": Defect(
            "terminals-consistent", edited(TERMINALS, b'variableName="force"', b'variableName="static_force"')
        ),
        "a parameter that flows": Defect(
            "terminals-consistent", edited(TERMINALS, b'variableName="force"', b'variableName="motion_ratio"')
        ),
        "velocity and force both given": Defect(
            "terminals-consistent",
            in_description({"variable": "velocity", "old": 'causality="input"', "new": 'causality="output"'}),
        ),
        "no reference results": Defect("reference-given", without("extra/")),
        "a stranger at the top": Defect("archive-stray", member(".DS_Store", lambda _: b"x")),
        "two cases of one name": Defect("archive-case", member("documentation/Index.html", lambda _: b"x")),
        "wrong reference": Defect("reference-results", member(REFERENCE, digit_before_the_middle), ("reference",)),
        "text for this machine's library": Defect("loads", member(LINUX, lambda _: b"not a library"), ("simulation",)),
        "sources of something else": Defect(
            "sources-compile", member(STEP, lambda b: b + b"\nthis is not C\n"), ("rebuild",)
        ),
        "sources of another version": Defect(
            "rebuilt-same",
            edited(STEP, b"c->memory.time = time + h;", b"c->memory.time = time + h; c->memory.values.at[2] += 1.0;"),
            ("rebuild",),
        ),
    }


ON_FILE = {name: tabled(entry, in_description) for name, entry in TABLES["on_file"].items()} | defects_of_the_archive()
IN_CODE = {name: tabled(entry, in_either) for name, entry in TABLES["in_code"].items()}


def found(path: Path, defect: Defect) -> set[str]:
    return {finding.rule.identifier for finding in check(path, groups=defect.groups).findings}


def defective(fmu: Path, folder: Path, defect: Defect, *more: Change) -> Path:
    members = read_archive(fmu)
    for change in (defect.change, *more):
        change(members)
    target = folder / fmu.name
    write_archive(target, members)
    return target


def test_the_table_has_enough_defects():
    assert len(ON_FILE) + len(IN_CODE) >= 40
    assert {defect.rule for defect in (*ON_FILE.values(), *IN_CODE.values())} <= RULES


@pytest.mark.parametrize("name", ON_FILE)
def test_a_defect_in_the_files_is_found_by_its_rule(name, fmus, tmp_path):
    defect = ON_FILE[name]
    assert defect.rule in found(defective(fmus[defect.fmu], tmp_path, defect), defect)


@pytest.fixture(scope="module")
def compiled(tmp_path_factory: pytest.TempPathFactory) -> Change:
    """Return a change that recompiles an FMU for this machine; equal files with equal headers are compiled once."""
    command = next((path for name in ("gcc", "clang", "cc") if (path := shutil.which(name))), None)
    spec = importlib.util.find_spec("fmpy")
    if command is None or spec is None or spec.origin is None or sys.platform != "linux":
        pytest.skip("it needs a C compiler on Linux")
    line = [command, "-fPIC", "-O1", "-w", "-ffp-contract=off", f"-I{Path(spec.origin).with_name('c-code')}"]
    objects = tmp_path_factory.mktemp("objects")

    def run(*arguments: str | Path) -> None:
        subprocess.run([*line, *map(str, arguments)], check=True, capture_output=True)

    def compile_file(sources: Members, name: str) -> Path:
        headers = b"".join(sources[other] for other in sorted(sources) if other.endswith(".h"))
        made = objects / f"{hashlib.sha256(headers + sources[name]).hexdigest()}.o"
        if not made.exists():
            folder = tmp_path_factory.mktemp("sources")
            for other, content in sources.items():
                (folder / other).write_bytes(content)
            run("-c", folder / name, "-o", made)
        return made

    def build(members: Members) -> None:
        sources = {name.removeprefix("sources/"): members[name] for name in members if name.startswith("sources/")}
        (binary,) = (name for name in members if name.startswith("binaries/linux64/"))
        library = tmp_path_factory.mktemp("library") / "x.so"
        run("-shared", *(compile_file(sources, name) for name in sources if name.endswith(".c")), "-o", library, "-lm")
        members[binary] = library.read_bytes()

    return build


@pytest.mark.parametrize("name", IN_CODE)
def test_a_defect_in_the_code_is_found_by_its_rule(name, fmus, tmp_path, compiled):
    defect = IN_CODE[name]
    assert defect.rule in found(defective(fmus[defect.fmu], tmp_path, defect, compiled), defect)


@pytest.mark.parametrize("name", sorted({defect.fmu for defect in IN_CODE.values()}))
def test_an_fmu_without_a_defect_is_clean(name, fmus, tmp_path, compiled):
    groups = tuple({group for defect in IN_CODE.values() for group in defect.groups} - {"static"})
    sound = Defect("crash", compiled, groups, name)
    assert found(defective(fmus[name], tmp_path, sound), sound) == set()


def rewritten(fmu: Path, target: Path, edit: Callable[[zipfile.ZipFile, zipfile.ZipInfo, bytes], None]) -> Path:
    """Write an archive entry by entry, with an edit for each entry."""
    with zipfile.ZipFile(fmu) as old, zipfile.ZipFile(target, "w", zipfile.ZIP_DEFLATED) as new:
        for entry in old.infolist():
            edit(new, entry, old.read(entry))
    return target


def now(new: zipfile.ZipFile, entry: zipfile.ZipInfo, content: bytes) -> None:
    day = 1 + len(new.namelist()) % 28
    new.writestr(zipfile.ZipInfo(entry.filename, (2026, 1, day, 0, 0, 0)), content)


def inside_a_folder(new: zipfile.ZipFile, entry: zipfile.ZipInfo, content: bytes) -> None:
    new.writestr(f"lpnl2/{entry.filename}", content)


def with_backslashes(new: zipfile.ZipFile, entry: zipfile.ZipInfo, content: bytes) -> None:
    info = zipfile.ZipInfo("x", entry.date_time)
    info.filename = info.orig_filename = entry.filename.replace("documentation/", "documentation\\")
    new.writestr(info, content)


def with_an_escape(new: zipfile.ZipFile, entry: zipfile.ZipInfo, content: bytes) -> None:
    new.writestr(entry.filename, content)
    if entry.filename == XML:
        new.writestr("../outside.txt", b"x")


def compressed_otherwise(new: zipfile.ZipFile, entry: zipfile.ZipInfo, content: bytes) -> None:
    new.writestr(entry.filename, content, compress_type=zipfile.ZIP_LZMA)


@pytest.mark.parametrize(
    ("edit", "rule"),
    [
        (now, "archive-dates"),
        (inside_a_folder, "archive-root"),
        (with_backslashes, "archive-path"),
        (with_an_escape, "archive-path"),
        (compressed_otherwise, "archive-compression"),
    ],
)
def test_a_defect_of_the_zip_is_found_by_its_rule(edit, rule, fmus, tmp_path):
    path = rewritten(fmus["lpnl2"], tmp_path / "lpnl2.fmu", edit)
    assert rule in {finding.rule.identifier for finding in check(path, groups=STATIC).findings}


@pytest.mark.filterwarnings("ignore:Duplicate name")
def test_a_duplicate_entry_is_found(fmus, tmp_path):
    path = shutil.copy(fmus["lpnl2"], tmp_path / "lpnl2.fmu")
    with zipfile.ZipFile(path, "a") as archive:
        archive.writestr("documentation/index.html", b"another")
    assert "archive-duplicate" in {finding.rule.identifier for finding in check(path, groups=STATIC).findings}


def test_a_file_with_another_name_gives_a_hint(fmus, tmp_path):
    path = shutil.copy(fmus["lpnl2"], tmp_path / "other.fmu")
    assert [finding.rule.identifier for finding in check(path, groups=STATIC).findings] == ["file-name"]
