"""Rules for binaries/: present, complete, for the right processor, with the required exports, and self-contained."""

from __future__ import annotations

from pathlib import PurePosixPath

from builder.check.rules import Faults, listed, some
from builder.check.subject import Binary, Subject
from eightpost.fmi.description import Description
from eightpost.fmi.functions import names

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
_GLIBC = (2, 17)
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
_RUNTIMES = ("python", "jvm", "mono", "coreclr", "mclmcrrt", "octave", "libmx")


def binaries(subject: Subject, fmu: Description) -> Faults:
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
        if binary.glibc > _GLIBC:
            yield "glibc", f"{binary.name} needs GLIBC {binary.glibc[0]}.{binary.glibc[1]}"
    for binary in sound:
        yield from _runtimes(binary, fmu)


def _presence(subject: Subject, fmu: Description) -> Faults:
    if not subject.binaries and not fmu.sources.files:
        yield "binary-present", "there is neither a binary nor a list of sources"
    named = {binary.platform for binary in subject.own_binaries}
    for platform in sorted({binary.platform for binary in subject.binaries} - named):
        found = [PurePosixPath(b.name).name for b in subject.binaries if b.platform == platform]
        yield "binary-name", f"binaries/{platform} has {listed(found)}, not {fmu.identifier!r}"


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


def _exports(subject: Subject, fmu: Description, sound: list[Binary]) -> Faults:
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
