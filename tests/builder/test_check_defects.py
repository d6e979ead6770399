"""Seeded defects: each is added to a copy of a native FMU, and `check` must find it with the right rule.

Defects of modelDescription.xml and of the C code are in check_defects.toml, those of the archive in
check_defects_archive.toml.
"""

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
from .check_defects import STATIC, XML, Defect, defective, found

TABLES = defects.read_tables("check_defects.toml", "check_defects_archive.toml")

ON_FILE = {name: defects.tabled(entry, defects.on_file) for name, entry in TABLES["on_file"].items()}
IN_CODE = {name: defects.tabled(entry, defects.in_either) for name, entry in TABLES["in_code"].items()}
BUNDLES = defects.bundles(IN_CODE)
#: Defects for which the check compiles the sources.
COMPILED = ("sources of something else", "sources of another version")


def test_the_table_has_enough_defects():
    assert len(ON_FILE) + len(IN_CODE) >= 40
    assert {defect.rule for defect in (*ON_FILE.values(), *IN_CODE.values())} <= defects.RULES


@pytest.mark.slow
def test_a_defect_in_the_files_is_found_by_its_rule(universal_fmus, tmp_path, unchanged):
    found = {}
    for name in (name for name, defect in ON_FILE.items() if defect.groups == STATIC):
        subject = read_subject(defective(universal_fmus[ON_FILE[name].fmu], tmp_path, ON_FILE[name]))
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
def test_a_defect_in_the_files_is_found_by_a_run(name, universal_fmus, tmp_path):
    defect = ON_FILE[name]
    assert defect.rule in found(defective(universal_fmus[defect.fmu], tmp_path, defect), defect)


@pytest.fixture(scope="module")
def compiled(tmp_path_factory):
    """Return a change that recompiles an FMU for this machine."""
    return defects.recompiler(tmp_path_factory)


@pytest.mark.repeated(5)
@pytest.mark.slow
@pytest.mark.parametrize("bundle", BUNDLES)
def test_defects_in_the_code_are_found_by_their_rules(bundle, universal_fmus, tmp_path, compiled):
    first, *others = (IN_CODE[name] for name in BUNDLES[bundle])
    path = defective(universal_fmus[first.fmu], tmp_path, first, *(other.change for other in others), compiled)
    groups = tuple({group for defect in (first, *others) for group in defect.groups})
    broken = {finding.rule.identifier for finding in check(path, groups=groups).findings}
    assert {defect.rule for defect in (first, *others)} <= broken


@pytest.mark.nightly
@pytest.mark.parametrize("name", sorted({defect.fmu for defect in IN_CODE.values()}))
def test_an_fmu_without_a_defect_is_clean(name, universal_fmus, tmp_path, compiled):
    groups = tuple({group for defect in IN_CODE.values() for group in defect.groups} - {"static"})
    sound = Defect("crash", compiled, groups, name)
    assert found(defective(universal_fmus[name], tmp_path, sound), sound) == set()


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
def test_a_defect_of_the_zip_is_found_by_its_rule(edit, rule, universal_fmus, tmp_path):
    path = rewritten(universal_fmus["lpnl2"], tmp_path / "lpnl2.fmu", edit)
    assert rule in {finding.rule.identifier for finding in check(path, groups=STATIC).findings}


@pytest.mark.filterwarnings("ignore:Duplicate name")
def test_a_duplicate_entry_is_found(universal_fmus, tmp_path):
    path = shutil.copy(universal_fmus["lpnl2"], tmp_path / "lpnl2.fmu")
    with zipfile.ZipFile(path, "a") as archive:
        archive.writestr("documentation/index.html", b"another")
    assert "archive-duplicate" in {finding.rule.identifier for finding in check(path, groups=STATIC).findings}


def test_a_file_with_another_name_gives_a_hint(universal_fmus, tmp_path):
    path = shutil.copy(universal_fmus["lpnl2"], tmp_path / "other.fmu")
    assert [finding.rule.identifier for finding in check(path, groups=STATIC).findings] == ["file-name"]
