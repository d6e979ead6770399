"""Seeded defects: each is added to a copy of a native FMU, and `check` must find it with the right rule.

Defects of modelDescription.xml and of the C code are in check_defects.toml, defects of the archive in this file.
"""

from __future__ import annotations

import re
import shutil
import zipfile
from collections.abc import Callable
from pathlib import Path

import pytest

from builder.check import check
from builder.check.archive import read_subject
from builder.check.description import static_findings

from . import check_defects as defects
from .check_defects import (
    STATIC,
    XML,
    Defect,
    both,
    copied,
    cut,
    defective,
    edited,
    found,
    in_description,
    member,
    moved,
    swapped,
    without,
)  # fmt: skip

TABLES = defects.read_tables("check_defects.toml")

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


def defects_of_the_archive():
    return {
        "Linux binary cut off": Defect("binary-format", member(LINUX, cut)),
        "Windows binary cut off": Defect("binary-format", member(WINDOWS, cut)),
        "macOS binary cut off": Defect("binary-format", member(MAC, cut)),
        "a macOS binary without content": Defect(
            "binary-format", member(MAC, lambda content: content[:8] + bytes(99)), message="starts like a Mach-O file"
        ),
        "text for a library": Defect("binary-format", member(WIN32, lambda _: b"not a library")),
        "empty library": Defect("binary-format", member(LINUX, lambda _: b"")),
        "processors exchanged": Defect("binary-machine", swapped(ARM, LINUX)),
        "32 bit for 64": Defect("binary-machine", swapped(WIN32, WINDOWS)),
        "Mach-O in a Linux folder": Defect("binary-format", copied(MAC, LINUX)),
        "not universal": Defect("darwin-universal", copied(ARM_MAC, MAC)),
        "a platform missing": Defect("platforms", without("binaries/win32/")),
        "a platform of no name": Defect("platform-name", moved(WIN32, "binaries/windows/lpnl2.dll")),
        "binary of another name": Defect("binary-name", moved(LINUX, "binaries/linux64/liblpnl2.so")),
        "an older binary beside it": Defect("binary-single", copied(LINUX, "binaries/linux64/lpnl2_old.so")),
        "nothing to run": Defect("binary-present", both(without("binaries/"), NO_SOURCES)),
        "a function renamed": Defect("exports", edited(LINUX, b"fmi2SetFMUstate", b"fmi2PutFMUstate")),
        "a function of model exchange renamed": Defect(
            "exports", edited(LINUX, b"fmi2GetDerivatives", b"fmi2PutDerivatives")
        ),
        "a strange export": Defect("exports-only", edited(LINUX, b"fmi2GetString\0", b"get_the_texts\0")),
        "an optional function missing": Defect("exports-all", edited(LINUX, b"fmi2CancelStep", b"fmi2AbandonIt_")),
        "a library too many": Defect("needed-libraries", edited(LINUX, b"libc.so.6", b"libd.so.6")),
        "a Python symbol": Defect("undefined-python", edited(LINUX, b"\0memset\0", b"\0PyMain\0")),
        "a Python symbol, denied": Defect(
            "execution-tool-honest", edited(LINUX, b"\0memset\0", b"\0PyMain\0"), message="lpnl2.so needs Python"
        ),
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
        "a description in UTF-16": Defect("xml-encoding", member(XML, lambda b: b.decode().encode("utf-16"))),
        "a name that Windows reserves": Defect("archive-windows", member("extra/con.txt", lambda _: b"x")),
        "a name that Windows forbids": Defect("archive-windows", member("extra/a:b", lambda _: b"x")),
        "a path that Windows cannot hold": Defect("archive-windows", member(f"extra/{'x' * 201}", lambda _: b"x")),
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


ON_FILE = {
    name: defects.tabled(entry, in_description) for name, entry in TABLES["on_file"].items()
} | defects_of_the_archive()
IN_CODE = {name: defects.tabled(entry, defects.in_either) for name, entry in TABLES["in_code"].items()}
BUNDLES = defects.bundles(IN_CODE)
#: Defects for which the check compiles the sources.
COMPILED = ("sources of something else", "sources of another version")


@pytest.fixture(scope="module")
def fmus(universal_fmus):
    """FMUs as they are shipped: with the binaries of all platforms."""
    return universal_fmus


def test_the_table_has_enough_defects():
    assert len(ON_FILE) + len(IN_CODE) >= 40
    assert {defect.rule for defect in (*ON_FILE.values(), *IN_CODE.values())} <= defects.RULES


@pytest.mark.slow
def test_a_defect_in_the_files_is_found_by_its_rule(fmus, tmp_path, unchanged):
    found = {}
    for name in (name for name, defect in ON_FILE.items() if defect.groups == STATIC):
        subject = read_subject(defective(fmus[ON_FILE[name].fmu], tmp_path, ON_FILE[name]))
        findings = [*static_findings(subject)]
        rules = {one.rule.identifier for one in findings if re.search(ON_FILE[name].message, one.message)}
        assert ON_FILE[name].rule in rules, name
        found[name] = " | ".join(f"{one.rule.identifier}: {one.message}" for one in findings)
    unchanged({name: re.sub(r"\d+ bytes( of \d+)?|line \d+", "", text) for name, text in found.items()})


@pytest.mark.slow
@pytest.mark.parametrize(
    "name",
    [pytest.param(name, marks=pytest.mark.nightly) if name in COMPILED else name
     for name, defect in ON_FILE.items() if defect.groups != STATIC],
)  # fmt: skip
def test_a_defect_in_the_files_is_found_by_a_run(name, fmus, tmp_path):
    defect = ON_FILE[name]
    assert defect.rule in found(defective(fmus[defect.fmu], tmp_path, defect), defect)


@pytest.fixture(scope="module")
def compiled(tmp_path_factory):
    """Return a change that recompiles an FMU for this machine."""
    return defects.recompiler(tmp_path_factory)


@pytest.mark.repeated(5)
@pytest.mark.slow
@pytest.mark.parametrize("bundle", BUNDLES)
def test_defects_in_the_code_are_found_by_their_rules(bundle, fmus, tmp_path, compiled):
    first, *others = (IN_CODE[name] for name in BUNDLES[bundle])
    path = defective(fmus[first.fmu], tmp_path, first, *(other.change for other in others), compiled)
    groups = tuple({group for defect in (first, *others) for group in defect.groups})
    broken = {finding.rule.identifier for finding in check(path, groups=groups).findings}
    assert {defect.rule for defect in (first, *others)} <= broken


@pytest.mark.nightly
@pytest.mark.parametrize("name", sorted({defect.fmu for defect in IN_CODE.values()}))
def test_an_fmu_without_a_defect_is_clean(name, fmus, tmp_path, compiled):
    groups = tuple({group for defect in IN_CODE.values() for group in defect.groups} - {"static"})
    sound = Defect("crash", compiled, groups, name)
    assert found(defective(fmus[name], tmp_path, sound), sound) == set()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("option", "rule"),
    [
        ("-Wl,-z,execstack", "executable-stack"),
        ("-Wl,-rpath,/home/maker/lib", "runpath"),
        ("-Wl,-rpath,$ORIGIN", ""),
        ("-march=x86-64-v3", "processor"),
        ("-O1", ""),
    ],
)
def test_a_defect_of_the_binary_is_found_by_its_rule(option, rule, tmp_path):
    path = defects.foreign_fmu("mass_spring", tmp_path, option)
    broken = {finding.rule.identifier for finding in check(path, groups=STATIC).findings}
    assert broken & {"executable-stack", "runpath", "processor"} == ({rule} if rule else set())


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


@pytest.mark.repeated(2)
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
