"""Rules for binaries/: present, complete, for the right processor, with the required exports, and self-contained."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import PurePosixPath

from builder.check.catalogue import static as rules
from builder.check.description import Description
from builder.check.rules import Finding, Rule, listed
from builder.check.static import functions3
from builder.check.subject import Binary, Subject

# ---- Functions of FMI 2.0 that a co-simulation FMU exports, and those that its flags require ------------------------

_COMMON = """GetTypesPlatform GetVersion SetDebugLogging Instantiate FreeInstance SetupExperiment
EnterInitializationMode ExitInitializationMode Terminate Reset GetReal GetInteger GetBoolean GetString SetReal
SetInteger SetBoolean SetString DoStep"""
_STATE = "GetFMUstate SetFMUstate FreeFMUstate"
_SERIAL = "SerializedFMUstateSize SerializeFMUstate DeSerializeFMUstate"
_STATUS = "CancelStep GetStatus GetRealStatus GetIntegerStatus GetBooleanStatus GetStringStatus"
_OPTIONAL = f"{_STATE} {_SERIAL} {_STATUS} GetDirectionalDerivative SetRealInputDerivatives GetRealOutputDerivatives"
_MODEL_EXCHANGE = """EnterEventMode NewDiscreteStates EnterContinuousTimeMode CompletedIntegratorStep SetTime
SetContinuousStates GetDerivatives GetEventIndicators GetContinuousStates GetNominalsOfContinuousStates"""


def _full_names(words: str) -> frozenset[str]:
    return frozenset(f"fmi2{word}" for word in words.split())


#: All functions of co-simulation, and all functions that an FMU may export.
CO_SIMULATION = _full_names(f"{_COMMON} {_OPTIONAL}")
EXPORTABLE = CO_SIMULATION | _full_names(_MODEL_EXCHANGE)


def exportable(description: Description) -> frozenset[str]:
    """Return all functions that a binary of the FMI version may export."""
    return functions3.EXPORTABLE if description.fmi == 3 else EXPORTABLE


def of_co_simulation(description: Description) -> frozenset[str]:
    """Return all functions of co-simulation of the FMI version."""
    return functions3.CO_SIMULATION if description.fmi == 3 else CO_SIMULATION


def required(description: Description) -> frozenset[str]:
    """Return the functions that the binary must export: those of every FMU, and those that the flags require."""
    if description.fmi == 3:
        return functions3.required(description)
    promised = {
        "canGetAndSetFMUstate": _STATE,
        "canSerializeFMUstate": _SERIAL,
        "providesDirectionalDerivative": "GetDirectionalDerivative",
        "canInterpolateInputs": "SetRealInputDerivatives",
        "canRunAsynchronuously": "CancelStep GetStatus",
    }
    words = [words for flag, words in promised.items() if description.can(flag)]
    if description.output_derivative_order:
        words.append("GetRealOutputDerivatives")
    return _full_names(" ".join([_COMMON, *words]))


def required_by_model_exchange(description: Description) -> frozenset[str]:
    """Return the functions that the binary of an FMU with ModelExchange must export."""
    if description.fmi == 3:
        return functions3.MODEL_EXCHANGE
    return _full_names(f"{_COMMON} {_MODEL_EXCHANGE}") - {"fmi2DoStep"}


# ---- Rules ----------------------------------------------------------------------------------------------------------

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
_RUNTIMES = ("python", "jvm", "mono", "coreclr", "mclmcrrt", "octave", "libmx")


def _present(subject: Subject) -> Iterator[Finding]:
    """Check that there is a binary with the right name, or that there are sources."""
    description = subject.description
    if description is None or description.co_simulation is None:
        return
    if not subject.binaries and not description.source_files:
        yield rules.BINARY.finding("there is neither a binary nor a list of sources")
    named = {binary.platform for binary in subject.own_binaries}
    for platform in sorted({binary.platform for binary in subject.binaries} - named):
        found = [PurePosixPath(b.name).name for b in subject.binaries if b.platform == platform]
        yield rules.BINARY_NAME.finding(f"binaries/{platform} has {listed(found)}, not {description.identifier!r}")


def _readable(subject: Subject) -> Iterator[Finding]:
    """Check that binaries are complete and have the right format and processor."""
    version_3 = subject.description is not None and subject.description.fmi == 3
    for binary in subject.own_binaries:
        wanted, machines = _PLATFORMS.get(binary.platform, ("", set()))
        if binary.fault:
            yield rules.BINARY_FORMAT.finding(f"{binary.name}: {binary.fault}")
        elif not wanted or (version_3 and binary.platform in _OLD_PLATFORMS):
            yield rules.PLATFORM_NAME.finding(f"binaries/{binary.platform} is not a standard platform name")
        elif binary.format != wanted:
            yield rules.BINARY_FORMAT.finding(f"{binary.name} is {binary.format}, not {wanted}")
        elif not machines & set(binary.machines):
            yield rules.BINARY_MACHINE.finding(f"{binary.name} is for {listed(list(binary.machines))}")


def _platforms(subject: Subject) -> Iterator[Finding]:
    """Check that there are binaries for all common platforms."""
    available = {binary.platform for binary in subject.own_binaries}
    fmi = subject.description.fmi if subject.description else 2
    missing = [platform for platform in _COMMON_PLATFORMS[fmi] if platform not in available]
    if missing and subject.description and subject.description.co_simulation is not None:
        yield rules.PLATFORMS.finding(f"missing: {listed(missing)}")
    for binary in _sound(subject):
        if binary.platform == "darwin64" and not {"x86_64", "aarch64"} <= set(binary.machines):
            yield rules.UNIVERSAL.finding(f"{binary.name} is for {listed(list(binary.machines))} only")


def _exports(subject: Subject) -> Iterator[Finding]:
    """Check that all required functions and only FMI functions are exported."""
    description = subject.description
    for binary in _sound(subject):
        assert description is not None
        found = _unprefixed(binary, description)
        promised = required(description)
        if missing := sorted(promised - found):
            yield rules.EXPORTS.finding(f"{binary.name} lacks {listed(missing)}")
        if missing := sorted(of_co_simulation(description) - promised - found):
            yield rules.ALL_EXPORTS.finding(f"{binary.name} lacks {listed(missing)}")
        if other := sorted(found - exportable(description) - _LINKER):
            yield rules.OTHER_EXPORTS.finding(f"{binary.name} exports {len(other)} more: {listed(other, most=4)}")


def _model_exchange_exports(subject: Subject) -> Iterator[Finding]:
    """Check that the functions that the element ModelExchange requires are exported."""
    description = subject.description
    if description is None or description.model_exchange is None:
        return
    identifier = description.model_exchange.get("modelIdentifier", "")
    for binary in subject.binaries:
        if binary.fault or PurePosixPath(binary.name).stem != identifier:
            continue
        found = frozenset(name.removeprefix(f"{identifier}_") for name in binary.exports)
        if missing := sorted(required_by_model_exchange(description) - found):
            yield rules.EXPORTS.finding(f"{binary.name} lacks {listed(missing)}, which ModelExchange needs")


def _unprefixed(binary: Binary, description: Description) -> frozenset[str]:
    """Return the exports without the prefix for static linking."""
    return frozenset(name.removeprefix(f"{description.identifier}_") for name in binary.exports)


def _libraries(subject: Subject) -> Iterator[Finding]:
    """Check that only system libraries are needed."""
    for binary in _sound(subject):
        checks: dict[str, tuple[Callable[[str], bool], Rule]] = {
            "ELF": (_is_system_elf, rules.NEEDED),
            "PE": (_is_system_dll, rules.IMPORTS),
            "Mach-O": (_is_system_dylib(binary), rules.NEEDED),
        }
        is_system, rule = checks[binary.format]
        if other := [library for library in binary.libraries if not is_system(library)]:
            yield rule.finding(f"{binary.name} needs {listed(other)}")
        if binary.glibc > _GLIBC:
            yield rules.GLIBC.finding(f"{binary.name} needs GLIBC {binary.glibc[0]}.{binary.glibc[1]}")


def _is_system_elf(library: str) -> bool:
    return library.startswith(_SYSTEM_ELF)


def _is_system_dll(library: str) -> bool:
    return library.lower().startswith(_SYSTEM_DLL)


def _is_system_dylib(binary: Binary) -> Callable[[str], bool]:
    own = PurePosixPath(binary.name).name
    return lambda library: library.startswith("/usr/lib/libSystem") or PurePosixPath(library).name == own


def _runtimes(subject: Subject) -> Iterator[Finding]:
    """Check that no language runtime is needed without being declared."""
    for binary in _sound(subject):
        python = sorted(name for name in binary.undefined if name.startswith(("Py", "_Py")))
        needed = [library for library in binary.libraries if any(r in library.lower() for r in _RUNTIMES)]
        if python and binary.format != "PE":
            yield rules.UNDEFINED_PYTHON.finding(f"{binary.name}: {len(python)} symbols, e.g. {listed(python, most=2)}")
        if (python or needed) and subject.description and not subject.description.can("needsExecutionTool"):
            yield rules.TOOL_HONEST.finding(f"{binary.name} needs {listed(needed or ['Python'])}")


def _sound(subject: Subject) -> list[Binary]:
    return [binary for binary in subject.own_binaries if not binary.fault]


RULES = (_present, _readable, _platforms, _exports, _model_exchange_exports, _libraries, _runtimes)
