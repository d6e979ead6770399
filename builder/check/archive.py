"""An FMU's archive: its entries, shared libraries and documents, and the rules for them."""

from __future__ import annotations

import io
import re
import struct
import warnings
import xml.etree.ElementTree as ET
import zipfile
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path, PurePosixPath
from typing import Any

from builder.check.rules import Faults, listed, some
from eightpost.archive import open_archive, unsafe_reason
from eightpost.errors import FmuError
from eightpost.extras import needs
from eightpost.fmi import BUILD, Description, Variable, names, read_description

with needs("check", "checking FMUs"):
    import lief

# ---- A shared library: format, processor, exported symbols, required libraries --------------------------------------

lief.logging.disable()

_UNIVERSAL = 0xCAFEBABE
_GLIBC = re.compile(r"GLIBC_(\d+)\.(\d+)(?:\.\d+)?")


@dataclass(frozen=True)
class Binary:
    """One shared library in binaries/<platform>/; if it cannot be read, `fault` is the reason.

    `machines` are x86_64, x86, aarch64 or lief's names of other processors. `libraries` are the file names of the
    libraries that it needs. `glibc` is the highest version of the GLIBC symbols that it needs, or (0, 0).
    """

    name: str
    platform: str
    fault: str = ""
    format: str = ""
    machines: tuple[str, ...] = ()
    exports: frozenset[str] = frozenset()
    undefined: frozenset[str] = frozenset()
    libraries: tuple[str, ...] = ()
    glibc: tuple[int, int] = (0, 0)
    faults: Mapping[str, str] = field(default_factory=dict)  # by rule; of ELF files

    def exports_without(self, identifier: str) -> frozenset[str]:
        """Return the exports without the prefix for static linking."""
        return frozenset(name.removeprefix(f"{identifier}_") for name in self.exports)


_MACHINES = {"amd64": "x86_64", "i386": "x86", "arm64": "aarch64"}

#: Number of bytes that identify the format of a file.
_HEAD = 4096


def _read_binary(name: str, platform: str, content: bytes) -> Binary:
    """Read a shared library; any error is stored in `fault`."""
    try:
        with warnings.catch_warnings(action="ignore"):  # lief warns about unknown values
            return _read_checked(name, platform, content)
    except Exception as error:  # lief raises any type of exception for damaged files
        return Binary(name, platform, fault=f"{type(error).__name__}: {error}")


def _read_checked(name: str, platform: str, content: bytes) -> Binary:
    # Parse from a stream: a list of the bytes would need eight times the memory.
    if lief.is_macho(list(content[:_HEAD])):
        fat = lief.MachO.parse(io.BytesIO(content))
        if fat is None or fat.size == 0:
            return Binary(name, platform, fault="it starts like a Mach-O file but cannot be read")
        return _mach_o(name, platform, list(fat), content)
    parsed: Any = lief.parse(io.BytesIO(content))
    if isinstance(parsed, lief.ELF.Binary):
        return _elf(name, platform, parsed, len(content))
    if isinstance(parsed, lief.PE.Binary):
        return _pe(name, platform, parsed, len(content))
    return Binary(name, platform, fault="it is not an ELF, PE or Mach-O file")


def _machine(value: Any) -> str:
    text = str(value).rpartition(".")[2].lower()
    return _MACHINES.get(text, text)


def _truncated(end: int, size: int) -> str:
    return f"it is truncated: {size} bytes of {end}" if end > size else ""


def _elf(name: str, platform: str, elf: Any, size: int) -> Binary:
    ends = [s.file_offset + s.physical_size for s in elf.segments]
    table = elf.header.section_header_offset + elf.header.numberof_sections * elf.header.section_header_size
    dynamic = list(elf.dynamic_symbols)
    matches = [_GLIBC.search(str(s.symbol_version)) for s in dynamic if s.symbol_version is not None]
    return Binary(
        name,
        platform,
        fault=_truncated(max([*ends, table], default=0), size),
        format="ELF",
        machines=(_machine(elf.header.machine_type),),
        exports=frozenset(str(s.name) for s in dynamic if s.exported),
        undefined=frozenset(str(s.name) for s in dynamic if s.shndx == 0 and s.name),
        libraries=tuple(str(library) for library in elf.libraries),
        glibc=max(((int(match[1]), int(match[2])) for match in matches if match), default=(0, 0)),
        faults={
            "executable-stack": "" if _has_data_stack(elf) else "its stack is executable",
            "runpath": some(_own_paths(elf), "it searches "),
            "processor": _processor_needed(elf),
        },
    )


def _has_data_stack(elf: Any) -> bool:
    """Return whether the file asks for a stack that is not executable; without a statement it is executable."""
    stacks = [s for s in elf.segments if s.type == lief.ELF.Segment.TYPE.GNU_STACK]
    return bool(stacks) and not any(int(s.flags) & 1 for s in stacks)


def _own_paths(elf: Any) -> list[str]:
    """Return the folders in which the file searches libraries, except those beside it."""
    kinds = (lief.ELF.DynamicEntry.TAG.RUNPATH, lief.ELF.DynamicEntry.TAG.RPATH)
    paths = [path for entry in elf.dynamic_entries if entry.tag in kinds for path in entry.paths]
    return [str(path) for path in paths if not str(path).startswith("$ORIGIN")]


#: Moves and arithmetic of doubles: in AVX, and in SSE2, which each x86-64 processor has; a question for abilities.
_AVX = re.compile(rb"\xc5.[\x10\x11\x28\x29\x58\x59\x5c\x5e\x6f\x7f]|\xc4[\xe2\xc2].[\x98-\xbf]", re.DOTALL)
_SSE = re.compile(rb"[\xf2\x66]\x0f[\x10\x11\x28\x29\x51\x58\x59\x5c\x5e]")
_ASKS = b"\x0f\xa2"
_FEW = 4


def _processor_needed(elf: Any) -> str:
    """Return what the code needs of an x86-64 processor beyond the first ones: AVX only, and no question for it."""
    code = b"".join(bytes(s.content) for s in elf.sections if s.name == ".text")
    if _machine(elf.header.machine_type) != "x86_64" or _ASKS in code:
        return ""
    needs_avx = len(_AVX.findall(code)) >= _FEW and not _SSE.search(code)
    return "its arithmetic needs AVX, and it does not ask whether the processor has it" if needs_avx else ""


def _pe(name: str, platform: str, pe: Any, size: int) -> Binary:
    ends = [s.pointerto_raw_data + s.sizeof_raw_data for s in pe.sections]
    exported = pe.get_export() if pe.has_exports else None
    return Binary(
        name,
        platform,
        fault=_truncated(max(ends, default=0), size),
        format="PE",
        machines=(_machine(pe.header.machine),),
        exports=frozenset(str(e.name) for e in exported.entries) if exported is not None else frozenset(),
        undefined=frozenset(str(e.name) for library in pe.imports for e in library.entries),
        libraries=tuple(str(library.name) for library in pe.imports),
    )


def _mach_o(name: str, platform: str, slices: Iterable[Any], content: bytes) -> Binary:
    parts = list(slices)
    ends = [int(part.fat_offset) + int(s.file_offset + s.file_size) for part in parts for s in part.segments]
    ends += _ends_of_slices(content)
    return Binary(
        name,
        platform,
        fault=_truncated(max(ends, default=0), len(content)),
        format="Mach-O",
        machines=tuple(_machine(part.header.cpu_type) for part in parts),
        exports=frozenset(set.intersection(*({_plain(s.name) for s in part.exported_symbols} for part in parts))),
        undefined=frozenset(_plain(s.name) for part in parts for s in part.imported_symbols),
        libraries=tuple(dict.fromkeys(str(library.name) for part in parts for library in part.libraries)),
    )


def _ends_of_slices(content: bytes) -> list[int]:
    """Return the ends of the slices of a universal file from its header: lief omits slices that it cannot read."""
    magic, count = struct.unpack_from(">II", content)
    if magic != _UNIVERSAL:
        return []
    parts = (struct.unpack_from(">5I", content, 8 + 20 * k) for k in range(min(count, 16)))
    return [offset + size for _, _, offset, size, _ in parts]


def _plain(symbol: Any) -> str:
    return str(symbol).removeprefix("_")


# ---- The archive ----------------------------------------------------------------------------------------------------

XML = "modelDescription.xml"
_BINARY = re.compile(r"binaries/([^/]+)/([^/]+)\.(so|dll|dylib)")


@dataclass(frozen=True)
class CheckedFmu:
    """An FMU file: entries as stored, contents by name (the last of duplicate entries), and the parsed description.

    `description` is None if the XML is missing or not well-formed; in the latter case `xml_error` is the reason.
    """

    path: Path
    entries: tuple[zipfile.ZipInfo, ...]
    members: Mapping[str, bytes]
    xml_error: str
    description: Description | None

    @cached_property
    def binaries(self) -> tuple[Binary, ...]:
        """Shared libraries in binaries/<platform>/."""
        found = ((name, _BINARY.fullmatch(name)) for name in sorted(self.members))
        return tuple(_read_binary(name, match[1], self.members[name]) for name, match in found if match)

    @property
    def own_binaries(self) -> tuple[Binary, ...]:
        """Binaries named after the modelIdentifier."""
        identifier = self.description.identifier if self.description else ""
        return tuple(binary for binary in self.binaries if PurePosixPath(binary.name).stem == identifier)

    @property
    def is_safe(self) -> bool:
        """Whether unpacking writes nothing outside the target folder."""
        return not any(unsafe_reason(entry) for entry in self.entries)


def read_subject(path: str | Path) -> CheckedFmu:
    """Read an FMU.

    Raises:
        FmuError: The file is missing, is a folder, is not a readable zip archive, contains no modelDescription.xml, or
            is an FMU of FMI 1.
    """
    path = Path(path)
    if path.is_dir():
        raise FmuError(f"{path}: is a folder, not an .fmu file; name the files in it (check {path}/*.fmu)")
    with open_archive(path) as archive:
        entries = tuple(archive.infolist())
        members = {e.orig_filename: archive.read(e) for e in entries if not e.is_dir()}
    if not list(_descriptions(members)):
        raise FmuError(f"{path}: is not an FMU: it contains no {XML}")
    if XML not in members:
        return CheckedFmu(path, entries, members, "", None)
    try:
        root = ET.fromstring(members[XML])
    except (ET.ParseError, ValueError, LookupError) as error:
        return CheckedFmu(path, entries, members, f"{type(error).__name__}: {error}", None)
    if root.get("fmiVersion", "2").startswith("1."):
        raise FmuError(f"{path}: is an FMU of FMI {root.get('fmiVersion')}; check supports FMI 2.0 and 3.0")
    return CheckedFmu(path, entries, members, "", read_description(root, _build_description(members)))


def _descriptions(names: Iterable[str]) -> Iterator[str]:
    """Yield the entries named modelDescription.xml in any folder."""
    return (name for name in names if PurePosixPath(name.replace("\\", "/")).name == XML)


def _build_description(members: Mapping[str, bytes]) -> ET.Element | None:
    try:
        return ET.fromstring(members[BUILD])
    except (KeyError, ET.ParseError, ValueError, LookupError):
        return None


# ---- Entries --------------------------------------------------------------------------------------------------------

_TOP = {XML, "model.png", "binaries", "sources", "documentation", "resources", "licenses", "terminalsAndIcons", "extra"}
_DECLARATION = re.compile(rb"""\A\s*<\?xml[^>]*encoding\s*=\s*["']([^"']+)["']""")
_DATE = "{:04}-{:02}-{:02} {:02}:{:02}:{:02}"


def entries(subject: CheckedFmu) -> Faults:
    """Yield faults of the entries of the archive, and of the XML as text."""
    if XML not in subject.members:
        yield "archive-root", f"it is at {next(_descriptions(subject.members))!r}; nothing else could be checked"
    for entry in subject.entries:
        if reason := unsafe_reason(entry):
            yield "archive-path", f"the entry {entry.orig_filename!r} {reason}"
    files = (name for name in ("binaries", "resources", "sources") if name in subject.members)
    yield "archive-path", some(files, "no folder: ")
    counts = Counter(entry.filename for entry in subject.entries)
    for name, count in counts.items():
        if count > 1:
            yield "archive-duplicate", f"{name!r} occurs {count} times"
    folded = Counter(name.casefold() for name in counts)
    alike = sorted(name for name in counts if folded[name.casefold()] > 1)
    yield "archive-case", some(alike, after=" are the same file on some systems")
    yield "archive-windows", some(name for name in counts if _is_refused_by_windows(name))
    plain = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)
    odd = (entry.filename for entry in subject.entries if entry.compress_type not in plain)
    yield "archive-compression", some(odd, "compressed with other methods: ")
    dates = sorted({entry.date_time for entry in subject.entries})
    if len(dates) > 1:
        first, last = _DATE.format(*dates[0]), _DATE.format(*dates[-1])
        yield "archive-dates", f"its entries have {len(dates)} dates, from {first} to {last}"
    if XML in subject.members:
        foreign = {part for name in subject.members for part in PurePosixPath(name).parts[:1]} - _TOP - {"/"}
        yield "archive-stray", some(sorted(foreign), "unknown: ")
    if subject.xml_error:
        yield "xml-wellformed", f"{subject.xml_error}; its content could not be checked"
    head = subject.members.get(XML, b"")[:4]
    if head.startswith((b"\xff\xfe", b"\xfe\xff")) or b"\0" in head:
        yield "xml-encoding", "it is UTF-16 or UTF-32"
    declared = _DECLARATION.match(subject.members.get(XML, b"").removeprefix(b"\xef\xbb\xbf"))
    if declared and declared[1].lower() not in (b"utf-8", b"utf8"):
        yield "xml-encoding", f"it declares {declared[1].decode('latin-1')}"
    if b"<!DOCTYPE" in subject.members.get(XML, b""):
        yield "xml-doctype", "there is one"


#: Names that Windows reserves, characters that it forbids, and the length of an entry that leaves 60 characters of its
#: 260 for the folder of a host.
_RESERVED = re.compile(r"(con|prn|aux|nul|com\d|lpt\d)(\..*)?", re.IGNORECASE)
_FORBIDDEN, _LONGEST = re.compile(r'[<>:"|?*\x00-\x1f]|[ .]$'), 200


def _is_refused_by_windows(name: str) -> bool:
    parts = PurePosixPath(name).parts
    return len(name) > _LONGEST or any(_RESERVED.fullmatch(part) or _FORBIDDEN.search(part) for part in parts)


# ---- Documents, sources, reference results --------------------------------------------------------------------------


def contents(subject: CheckedFmu, fmu: Description) -> Faults:
    """Yield faults of sources, documentation, licences, icon, reference results and the name of the file."""
    members = subject.members
    yield "source-files", _missing_sources(subject, fmu.sources.files)
    if not fmu.sources.files:
        yield "sources", "no sources are listed"
    page = members.get("documentation/index.html")
    if page is None or not page.strip():
        yield "documentation", "it is missing" if page is None else "it is empty"
    licences = [name for name in members if name.startswith(("documentation/licenses/", "licenses/"))]
    if not licences:
        yield "license", "it is missing"
    yield "license", some((name for name in licences if not members[name].strip()), "empty: ")
    icon = members.get("terminalsAndIcons/icon.png" if fmu.fmi == 3 else "model.png")
    yield ("icon", "it is missing") if icon is None else ("icon-format", _fault_of_png(icon))
    if not any(name.startswith("extra/") and name.endswith("_ref.csv") for name in members):
        yield "reference-given", "there is no extra/.../*_ref.csv"
    if fmu.identifier and subject.path.stem != fmu.identifier:
        yield "file-name", f"the file is {subject.path.name}, the modelIdentifier {fmu.identifier}"


def _missing_sources(subject: CheckedFmu, names: tuple[str, ...]) -> str:
    return some((name for name in names if f"sources/{name}" not in subject.members), "missing in sources/: ")


_PNG = b"\x89PNG\r\n\x1a\n"

#: Maximum number of pixels that are decoded: a file of a few kilobytes can decode to gigabytes of one colour.
_MOST_PIXELS = 2**24


def _fault_of_png(content: bytes) -> str:
    if not content.startswith(_PNG):
        return "it does not start with a PNG signature"
    with needs("check", "checking the icon of an FMU"):
        from PIL import Image  # noqa: PLC0415 - only a file with an icon needs it

    try:
        with Image.open(io.BytesIO(content), formats=("PNG",)) as picture:
            if picture.width * picture.height > _MOST_PIXELS:
                return f"it has {picture.width} x {picture.height} pixels, too many to be decoded"
            picture.load()
    except Exception as error:  # an exception of the decoder is a finding
        return f"it cannot be decoded: {str(error).partition(' <')[0]}"
    return ""


def exchange_files(subject: CheckedFmu, fmu: Description) -> Faults:
    """Yield faults of the binaries and sources of model exchange."""
    if fmu.model_exchange is not None:
        name = fmu.model_exchange.get("modelIdentifier", "")
        stems: dict[str, set[str]] = {}
        for binary in subject.binaries:
            stems.setdefault(binary.platform, set()).add(PurePosixPath(binary.name).stem)
        missing = sorted(platform for platform, names in stems.items() if name not in names)
        is_name = re.fullmatch(r"[A-Za-z_]\w*", name, flags=re.ASCII)
        what = some(missing, f"there is no binary {name!r} for ") if is_name else f"it is {name!r}"
        yield "exchange-identifier", what
    if fmu.fmi == 2 or fmu.exchange_sources.files != fmu.sources.files:  # FMI 3.0 may have one list for both
        yield "exchange-sources", _missing_sources(subject, fmu.exchange_sources.files)


# ---- Terminals ------------------------------------------------------------------------------------------------------

_PATH = "terminalsAndIcons/terminalsAndIcons.xml"
_FLOWS = ("inflow", "outflow")

#: Flow of a force by its causality: a force that is positive in compression leaves the shock and enters the vehicle.
_FLOW_OF_FORCE = {"output": "outflow", "input": "inflow"}

#: Kind of connection and variable of a member of a terminal.
_Member = tuple[str, Variable]


def terminals(subject: CheckedFmu, fmu: Description) -> Faults:
    """Yield faults of terminals: they must be readable, refer to existing variables, and fit their causality."""
    if _PATH not in subject.members:
        yield "terminals", f"{_PATH} is missing"
        return
    try:
        root = ET.fromstring(subject.members[_PATH])
    except (ET.ParseError, ValueError, LookupError) as error:
        yield "terminals-valid", f"{_PATH}: {error}"
        return
    named = (e.get("variableName", "") for e in root.iter("TerminalMemberVariable"))
    yield "terminals-valid", some((name for name in named if name not in fmu.by_name), "unknown variables: ")
    if root.find("Terminals/Terminal") is None:
        yield "terminals-valid", "it contains no Terminal"
    icons = (e.get("iconBaseName", "") for e in root.iter("TerminalGraphicalRepresentation"))
    folder = PurePosixPath(_PATH).parent
    missing = (name for name in icons if name and str(folder / f"{name}.png") not in subject.members)
    yield "terminals-valid", some(missing, "missing icons: ")
    for terminal in root.iter("Terminal"):
        for fault in _contradictions(_members(terminal, fmu.by_name)):
            yield "terminals-consistent", f"terminal {terminal.get('name', '')!r}: {fault}"


def _members(terminal: ET.Element, variables: Mapping[str, Variable]) -> dict[str, _Member]:
    """Return the members with existing variables by their names in the terminal."""
    elements = ((e, e.get("variableName", "")) for e in terminal.iterfind("TerminalMemberVariable"))
    known = ((e, name) for e, name in elements if name in variables)
    return {e.get("memberName", name): (e.get("variableKind", ""), variables[name]) for e, name in known}


def _contradictions(members: Mapping[str, _Member]) -> Iterator[str]:
    for kind, variable in members.values():
        if variable.causality in ("local", "independent"):
            yield f"{variable.name} is {variable.causality}; such variables cannot be connected"
        elif kind in _FLOWS and variable.causality not in ("input", "output"):
            yield f"{variable.name} is an {kind} and a {variable.causality}; flows are inputs or outputs"
    if {"velocity", "force"} <= members.keys():
        (_, velocity), (_, force) = members["velocity"], members["force"]
        if (velocity.unit, force.unit) == ("m/s", "N"):
            yield from _port(members, *members["force"])


def _port(members: Mapping[str, _Member], kind: str, force: Variable) -> Iterator[str]:
    """Yield contradictions at a port: motions and force must have opposite causality (docs/reference/ports.md)."""
    causality, flow = force.causality, _FLOW_OF_FORCE.get(force.causality)
    if flow and kind in _FLOWS and kind != flow:
        yield f"{force.name} is an {causality}, and so an {flow}, not an {kind}"
    for motion_kind, motion in (members[name] for name in ("velocity", "displacement") if name in members):
        if motion.causality == causality:
            yield f"{motion.name} and {force.name} are both {causality}s; one must be the opposite"
        if motion_kind in _FLOWS:
            yield f"{motion.name} is equal on both sides, and so a signal, not an {motion_kind}"


# ==== Rules for binaries/: present, complete, for the right processor, with the required exports, and self-contained =

#: Format and processors by folder: names of FMI 2.0, and of FMI 3.0 with their older spellings.
_PLATFORMS = {
    "win32": ("PE", {"x86"}), "win64": ("PE", {"x86_64"}),
    "linux32": ("ELF", {"x86"}), "linux64": ("ELF", {"x86_64"}),
    "darwin64": ("Mach-O", {"x86_64", "aarch64"}), "aarch64-linux": ("ELF", {"aarch64"}),
    "aarch64-darwin": ("Mach-O", {"aarch64"}), "x86_64-linux": ("ELF", {"x86_64"}), "x86-linux": ("ELF", {"x86"}),
    "x86_64-windows": ("PE", {"x86_64"}), "x86-windows": ("PE", {"x86"}), "aarch64-windows": ("PE", {"aarch64"}),
    "x86_64-darwin": ("Mach-O", {"x86_64"}), "darwin32": ("Mach-O", {"x86"}),
}  # fmt: skip
#: Names of FMI 2.0 that FMI 3.0 replaces.
_OLD_PLATFORMS = ("win32", "win64", "linux32", "linux64", "darwin32", "darwin64")
_COMMON_PLATFORMS = {
    2: ("linux64", "win64", "win32", "aarch64-linux", "darwin64", "aarch64-darwin"),
    3: ("x86_64-linux", "x86_64-windows", "x86-windows", "aarch64-linux", "x86_64-darwin", "aarch64-darwin"),
}
_OLDEST_GLIBC = (2, 17)
_SYSTEM_ELF = ("libc.so", "libm.so", "ld-linux")
_SYSTEM_DLL = ("api-ms-win-", "kernel32", "user32", "advapi32", "ntdll", "ucrtbase", "ws2_32", "shell32", "ole32")
#: Symbols that linkers add.
_LINKER = {"__dso_handle", "_mh_dylib_header", "_init", "_fini", "__bss_start", "_edata", "_end", "_DYNAMIC"}
#: Functions that a flag of CoSimulation requires, by version of FMI and the flag's name in FMI 2.0.
_PROMISED = {
    2: {
        "canGetAndSetFMUstate": "GetFMUstate SetFMUstate FreeFMUstate",
        "canSerializeFMUstate": "SerializedFMUstateSize SerializeFMUstate DeSerializeFMUstate",
        "providesDirectionalDerivative": "GetDirectionalDerivative",
        "canInterpolateInputs": "SetRealInputDerivatives",
        "canRunAsynchronuously": "CancelStep GetStatus",
    },
    3: {
        "canGetAndSetFMUstate": "GetFMUState SetFMUState FreeFMUState",
        "canSerializeFMUstate": "SerializedFMUStateSize SerializeFMUState DeserializeFMUState",
        "providesDirectionalDerivative": "GetDirectionalDerivative",
        "providesAdjointDerivatives": "GetAdjointDerivative",
        "hasEventMode": "EnterEventMode EnterStepMode UpdateDiscreteStates",
        "providesPerElementDependencies": "GetNumberOfVariableDependencies GetVariableDependencies",
    },
}
#: Function that an order of output derivatives requires.
_ORDER = {2: "GetRealOutputDerivatives", 3: "GetOutputDerivatives"}
#: Functions by which a library is the binary of an FMU.
_SIGN = {"fmi2Instantiate", "fmi3InstantiateCoSimulation", "fmi3InstantiateModelExchange"}
_RUNTIMES = ("python", "jvm", "mono", "coreclr", "mclmcrrt", "octave", "libmx")


def binaries(subject: CheckedFmu, fmu: Description) -> Faults:
    """Yield faults of the shared libraries."""
    sound = [binary for binary in subject.own_binaries if not binary.fault]
    if fmu.co_simulation is not None:
        yield from _presence(subject, fmu)
    for binary in subject.own_binaries:
        yield _readability(binary, fmu)
    if fmu.co_simulation is not None:
        available = {binary.platform for binary in subject.own_binaries}
        yield "platforms", some((name for name in _COMMON_PLATFORMS[fmu.fmi] if name not in available), "missing: ")
    for binary in sound:
        if binary.platform == "darwin64" and not {"x86_64", "aarch64"} <= set(binary.machines):
            yield "darwin-universal", f"{binary.name} is for {listed(list(binary.machines))} only"
    yield from _exports(subject, fmu, sound)
    for binary in sound:
        rule = "dll-imports" if binary.format == "PE" else "needed-libraries"
        other = (library for library in binary.libraries if not _is_system(library, binary))
        yield rule, some(other, f"{binary.name} needs ")
        if binary.glibc > _OLDEST_GLIBC:
            yield "glibc", f"{binary.name} needs GLIBC {binary.glibc[0]}.{binary.glibc[1]}"
    for binary in sound:
        yield from _runtimes(binary, fmu)
        yield from ((rule, fault and f"{binary.name}: {fault}") for rule, fault in binary.faults.items())


def _presence(subject: CheckedFmu, fmu: Description) -> Faults:
    if not subject.binaries and not fmu.sources.files:
        yield "binary-present", "there is neither a binary nor a list of sources"
    named = {binary.platform for binary in subject.own_binaries}
    for platform in sorted({binary.platform for binary in subject.binaries} - named):
        found = [PurePosixPath(b.name).name for b in subject.binaries if b.platform == platform]
        yield "binary-name", f"binaries/{platform} has {listed(found)}, not {fmu.identifier!r}"
    identifiers = {fmu.identifier, (fmu.model_exchange or {}).get("modelIdentifier")}
    others = (binary for binary in subject.binaries if PurePosixPath(binary.name).stem not in identifiers)
    strange = (binary.name for binary in others if binary.platform in named and _SIGN & binary.exports)
    yield "binary-single", some(strange, "with functions of FMI too: ")


def _readability(binary: Binary, fmu: Description) -> tuple[str, str]:
    wanted, machines = _PLATFORMS.get(binary.platform, ("", set()))
    if binary.fault:
        return "binary-format", f"{binary.name}: {binary.fault}"
    if not wanted or (fmu.fmi == 3 and binary.platform in _OLD_PLATFORMS):
        return "platform-name", f"binaries/{binary.platform} is not a standard platform name"
    if binary.format != wanted:
        return "binary-format", f"{binary.name} is {binary.format}, not {wanted}"
    is_right = machines & set(binary.machines)
    return "binary-machine", "" if is_right else f"{binary.name} is for {listed(list(binary.machines))}"


def _exports(subject: CheckedFmu, fmu: Description, sound: list[Binary]) -> Faults:
    required, co_simulation = _required(fmu), names(fmu.fmi, "all", "cs", "optional")
    for binary in sound:
        found, lacks = binary.exports_without(fmu.identifier), f"{binary.name} lacks "
        yield "exports", some(sorted(required - found), lacks)
        yield "exports-all", some(sorted(co_simulation - required - found), lacks)
        if other := sorted(found - names(fmu.fmi) - _LINKER):
            yield "exports-only", f"{binary.name} exports {len(other)} more: {listed(other, most=4)}"
    identifier = (fmu.model_exchange or {}).get("modelIdentifier", "")
    for binary in subject.binaries if fmu.model_exchange is not None else ():
        if not binary.fault and PurePosixPath(binary.name).stem == identifier:
            missing = sorted(names(fmu.fmi, "all", "me") - binary.exports_without(identifier))
            yield "exports", some(missing, f"{binary.name} lacks ", ", which ModelExchange needs")


def _required(fmu: Description) -> frozenset[str]:
    """Return the functions that the binary must export: those of every FMU, and those of its flags and types."""
    words = [words for flag, words in _PROMISED[fmu.fmi].items() if fmu.can(flag)]
    words += [_ORDER[fmu.fmi]] if fmu.output_derivative_order else []
    natives = {"Int64" if v.native == "Enumeration" else v.native for v in fmu.variables if v.native}
    words += [f"Get{native} Set{native}" for native in natives]
    return names(fmu.fmi, "all", "cs") | {f"fmi{fmu.fmi}{word}" for word in " ".join(words).split()}


def _is_system(library: str, binary: Binary) -> bool:
    if binary.format == "ELF":
        return library.startswith(_SYSTEM_ELF)
    if binary.format == "PE":
        return library.lower().startswith(_SYSTEM_DLL)
    return library.startswith("/usr/lib/libSystem") or PurePosixPath(library).name == PurePosixPath(binary.name).name


def _runtimes(binary: Binary, fmu: Description) -> Faults:
    python = sorted(name for name in binary.undefined if name.startswith(("Py", "_Py")))
    needed = [library for library in binary.libraries if any(r in library.lower() for r in _RUNTIMES)]
    if python and binary.format != "PE":
        yield "undefined-python", f"{binary.name}: {len(python)} symbols, e.g. {listed(python, most=2)}"
    if (python or needed) and not fmu.can("needsExecutionTool"):
        yield "execution-tool-honest", f"{binary.name} needs {listed(needed or ['Python'])}"
