"""Seeded defects for tests of `check`: changes of the members of a native FMU of FMI 2.0 or 3.0, and their compilation.

Defects are entries of check_defects*.toml.
"""

import functools
import hashlib
import importlib.util
import platform
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

import fmpy
import pytest

from builder.check import CATALOGUE, check
from eightpost.archive import read_archive

XML = "modelDescription.xml"
RULES = {rule.identifier for rule in CATALOGUE}
STATIC = ("static",)

Members = dict[str, bytes]
Change = Callable[[Members], None]
PLATFORMS = ("binaries/linux64/", "binaries/x86_64-linux/")  # of FMI 2.0 and 3.0


@dataclass(frozen=True)
class Defect:
    """A change of an FMU's members, the rule that must find it, and the groups of checks to run.

    Attributes:
        rule: Identifier of the rule.
        change: Change of the members.
        groups: Groups of checks to run.
        fmu: Name of the FMU.
        message: Regular expression for the message of the finding.
        bundle: Name of the defects of code that are compiled together; empty if this one is compiled alone.
        is_nightly: Whether only the nightly run tries it.
    """

    rule: str
    change: Change
    groups: tuple[str, ...] = STATIC
    fmu: str = "lpnl2"
    message: str = ""
    bundle: str = ""
    is_nightly: bool = False


def read_tables(*names: str) -> dict[str, dict[str, Any]]:
    """Return the entries of tables in this folder: those on file and those in code."""
    tables: dict[str, dict[str, Any]] = {"on_file": {}, "in_code": {}}
    for name in names:
        for kind, entries in tomllib.loads(Path(__file__).with_name(name).read_text(encoding="utf-8")).items():
            assert tables[kind].keys().isdisjoint(entries), name
            tables[kind] |= entries
    return tables


def tabled(entry: Mapping[str, Any], change: Callable[[Mapping[str, str]], Change]) -> Defect:
    """Return the defect for an entry of the table; `change` converts a description of a change to the change."""

    def apply(members: Members) -> None:
        for one in entry.get("changes", [entry]):
            change(one)(members)

    return Defect(
        entry["rule"],
        apply,
        tuple(entry.get("groups", STATIC)),
        entry.get("fmu", "lpnl2"),
        entry.get("message", ""),
        entry.get("bundle", ""),
        entry.get("nightly", False),
    )


# ---- Changes --------------------------------------------------------------------------------------------------------


def on_file(entry: Mapping[str, Any]) -> Change:
    """Return a change of the archive, or a replacement of a regular expression in an XML file or a part of it."""

    def change(members: Members) -> None:
        name = entry.get("member", XML)
        match entry:
            case {"removed": begin}:
                gone = [member for member in members if member.startswith(begin)]
                assert gone
                for member in gone:
                    del members[member]
            case {"moved": new}:
                members[new] = members.pop(name)
            case {"copied": source}:
                members[name] = members[source]
            case {"swapped": other}:
                members[name], members[other] = members[other], members[name]
            case {"content": text}:
                members[name] = text.encode("latin-1")
            case {"first": count}:
                members[name] = members[name][:count] + bytes(entry.get("zeros", 0))
            case {"cut": True}:
                members[name] = members[name][: len(members[name]) * 2 // 3]
            case {"bytes": [old, new]}:
                assert old.encode() in members[name], f"there is no {old!r} in {name}"
                members[name] = members[name].replace(old.encode(), new.encode())
            case {"encoding": encoding}:
                members[name] = members[name].decode().encode(encoding)
            case _:
                text = members[name].decode()
                begin, end = _range(text, entry)
                inside, changed = re.subn(entry["old"], entry["new"], text[begin:end], count=1, flags=re.DOTALL)
                assert changed, f"there is no {entry['old']!r} to change"
                members[name] = (text[:begin] + inside + text[end:]).encode()

    return change


def _range(text: str, entry: Mapping[str, str]) -> tuple[int, int]:
    if "variable" in entry:
        found = re.search(rf'<(\w+) name="{re.escape(entry["variable"])}"', text)
        assert found, f"there is no variable {entry['variable']}"
        end = "</ScalarVariable>" if found[1] == "ScalarVariable" else "\n"  # in FMI 3.0 each has a line of its own
        return found.start(), text.index(end, found.start())
    if "section" in entry:
        return text.index(f"<{entry['section']}>"), text.index(f"</{entry['section']}>")
    return 0, len(text)


def bundles(in_code: Mapping[str, Defect]) -> dict[str, list[str]]:
    """Return the names of the defects of code by bundle; a defect without one is a bundle of its own."""
    found: dict[str, list[str]] = {}
    for name, defect in in_code.items():
        found.setdefault(defect.bundle or name, []).append(name)
    return found


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
    return in_source(entry) if entry.keys() & {"file", "after_step"} else on_file(entry)


def after_step(code: str, declare: str) -> Change:
    """Return an addition of C to the end of every successful step; `declare` goes to the top of the file."""
    header, stepped = b'#include "calls.h"', b"c->memory.time = time + h;"

    def change(members: Members) -> None:
        text = members["sources/step.c"]
        assert header in text and stepped in text
        text = text.replace(header, header + f"\n#include <stdlib.h>\n{declare}".encode())
        members["sources/step.c"] = text.replace(stepped, stepped + f" {code}".encode())

    return change


# ---- Defective FMUs -------------------------------------------------------------------------------------------------


def found(path: Path, defect: Defect) -> set[str]:
    """Return the rules that the check finds broken, with the message of the defect."""
    findings = check(path, groups=defect.groups).findings
    return {finding.rule.identifier for finding in findings if re.search(defect.message, finding.message)}


_members = functools.cache(read_archive)


def defective(fmu: Path, folder: Path, defect: Defect, *more: Change) -> Path:
    """Write a copy of an FMU with a defect and further changes."""
    members = dict(_members(fmu))
    for change in (defect.change, *more):
        change(members)
    target = folder / fmu.name
    with zipfile.ZipFile(target, "w") as archive:  # compression takes longer than the check
        for name, content in members.items():
            archive.writestr(zipfile.ZipInfo(name), content)
    return target


FOREIGN = Path(__file__).with_name("foreign")


def c_compiler() -> list[str]:
    """Return the command of the system's compiler or of zig."""
    if found := next(filter(None, map(shutil.which, ("cc", "gcc", "clang"))), None):
        return [found]
    if importlib.util.find_spec("ziglang") is None:
        pytest.skip("there is no C compiler on this machine")
    return [sys.executable, "-m", "ziglang", "cc"]


def foreign_fmu(name: str, folder: Path, *options: str) -> Path:
    """Compile and zip an FMU of tests/builder/foreign, with the headers of FMI only."""
    if sys.platform != "linux" or platform.machine() != "x86_64":
        pytest.skip("it is compiled for Linux on x86-64 only")
    headers = Path(fmpy.__file__).with_name("c-code")
    source, library, description = FOREIGN / name / f"{name}.c", folder / f"{name}.so", FOREIGN / name / XML
    is_version_3 = 'fmiVersion="3.0"' in description.read_text(encoding="utf-8")
    line = [*c_compiler(), "-shared", "-fPIC", "-O2", f"-std={'c11' if is_version_3 else 'c99'}", *options]
    line += ["-I", str(headers), str(source), "-o", str(library), "-lm"]
    subprocess.run(line, check=True, capture_output=True)
    place = "x86_64-linux" if is_version_3 else "linux64"
    with zipfile.ZipFile(folder / f"{name}.fmu", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.write(description, XML)
        archive.write(library, f"binaries/{place}/{name}.so")
    return folder / f"{name}.fmu"


def recompiler(folders: pytest.TempPathFactory) -> Change:
    """Return a change that recompiles an FMU for this machine; equal files with equal headers are compiled once."""
    command = next((path for name in ("gcc", "clang", "cc") if (path := shutil.which(name))), None)
    spec = importlib.util.find_spec("fmpy")
    if command is None or spec is None or spec.origin is None or sys.platform != "linux":
        pytest.skip("it needs a C compiler on Linux")
    line = [command, "-fPIC", "-O1", "-w", "-ffp-contract=off", f"-I{Path(spec.origin).with_name('c-code')}"]
    objects = folders.mktemp("objects")

    def run(*arguments: str | Path) -> None:
        subprocess.run([*line, *map(str, arguments)], check=True, capture_output=True)

    def compile_file(sources: Members, name: str) -> Path:
        headers = b"".join(sources[other] for other in sorted(sources) if other.endswith(".h"))
        made = objects / f"{hashlib.sha256(headers + sources[name]).hexdigest()}.o"
        if not made.exists():
            folder = folders.mktemp("sources")
            for other, content in sources.items():
                (folder / other).write_bytes(content)
            run("-c", folder / name, "-o", made)
        return made

    def build(members: Members) -> None:
        sources = {name.removeprefix("sources/"): members[name] for name in members if name.startswith("sources/")}
        (binary,) = (name for name in members if name.startswith(PLATFORMS))
        library = folders.mktemp("library") / "x.so"
        run("-shared", *(compile_file(sources, name) for name in sources if name.endswith(".c")), "-o", library, "-lm")
        members[binary] = library.read_bytes()

    return build
