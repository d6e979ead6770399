"""FMU file: its description, its binary for this platform, and the folder that it is unpacked into."""

from __future__ import annotations

import hashlib
import os
import shutil
import subprocess
import tempfile
import weakref
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path, PurePosixPath
from threading import Lock

import fmpy

from cosim.components.component import Capabilities, Variable
from cosim.components.fmu_description import Rows, only_step, read_description
from eightpost.archive import extract_archive, open_archive
from eightpost.cache import keep, recall
from eightpost.compilers import find_compiler
from eightpost.errors import FmuError, InputError
from eightpost.files import json_content, sha256_of, writing
from eightpost.fmi import Description
from eightpost.validity import MEMBER, Validity

# ==== FMU file unpacked into a folder, and the contents of its modelDescription.xml ==================================

#: Letter for each type in "#r12#", with which a log message may name a variable (FMI 2.0.4, 2.1.5).
_LETTERS = {"Real": "r", "Integer": "i", "Enumeration": "i", "Boolean": "b", "String": "s"}


@dataclass(frozen=True)
class FmuFile:
    """An FMU of FMI 2.0 or 3.0 for co-simulation in a folder."""

    path: Path  #: FMU file (.fmu).
    folder: Path  #: Folder in which it is unpacked.
    description: Description  #: Content of modelDescription.xml.
    notes: tuple[str, ...] = ()  #: Notes about the archive.

    @classmethod
    def unpack(cls, path: str | Path, folder: str | Path, *, compile_missing: bool = False) -> FmuFile:
        """Unpack a file into a folder, without its documentation and the binaries of other platforms.

        Its sources are unpacked only if it has no binary for this platform.

        Args:
            path: FMU file (.fmu).
            folder: Folder to unpack it into.
            compile_missing: Whether to compile its sources if it has no binary for this platform.

        Raises:
            FmuError: The file is missing, damaged or unsafe, is not an FMU of FMI 2.0 or 3.0 for co-simulation, or has
                no binary for this platform.
        """
        notes = extract_archive(path, folder, _is_needed)
        fmu = cls(Path(path), Path(folder), read_description(Path(path), Path(folder)), notes)
        if not fmu.has_binary:
            extract_archive(path, folder, _is_source)
        if compile_missing and not fmu.has_binary:
            _compile_sources(fmu.path, fmu.library, fmu.sources, fmu.build_options, version=fmu.version)
        fmu._check_platform()
        return fmu

    @classmethod
    def unpacked(cls, path: str | Path, folder: str | Path) -> FmuFile:
        """Read an FMU that `unpack` left in a folder."""
        return cls(Path(path), Path(folder), read_description(Path(path), Path(folder)))

    @property
    def version(self) -> int:
        """Major version of FMI: 2 or 3."""
        return self.description.fmi

    @property
    def library(self) -> Path:
        """Its library for this platform."""
        name = f"{self.identifier}{fmpy.sharedLibraryExtension}"
        return (self.folder / "binaries" / self._platform / name).absolute()

    @cached_property
    def rows(self) -> Rows:
        """Variables with their elements.

        Raises:
            FmuError: The description is not correct.
        """
        try:
            return Rows.of(self.description)
        except ValueError as error:
            raise FmuError(f"{self.path}: its modelDescription.xml: {error}; export the FMU again") from error

    @property
    def identifier(self) -> str:
        """Name of its library (modelIdentifier)."""
        return self.description.identifier

    @property
    def sources(self) -> tuple[str, ...]:
        """C files in sources/: those listed in the description, else all.c if there is one, else all *.c files."""
        if listed := self.description.sources.files:
            return self._inside(*listed)
        present = tuple(sorted(p.name for p in (self.folder / "sources").glob("*.c")))
        return ("all.c",) if "all.c" in present else present

    @property
    def build_options(self) -> tuple[str, ...]:
        """Options for the compiler: definitions and folders of headers in its build description (FMI 3.0)."""
        needed = [d for d in self.description.sources.definitions if d.get("optional") not in ("true", "1")]
        given = ["=".join(("-D" + d.get("name", ""), *([d["value"]] if "value" in d else []))) for d in needed]
        return (*given, *(f"-I{name}" for name in self._inside(*self.description.sources.folders)))

    def _inside(self, *names: str) -> tuple[str, ...]:
        root = self.folder.resolve()
        for name in names:
            if not (root / "sources" / name).resolve().is_relative_to(root):
                raise FmuError(f"{self.path}: its build description names {name!r}, outside the FMU; use another FMU")
        return names

    @property
    def is_ours(self) -> bool:
        """Whether this project built it: tests show that the reset of such an FMU gives the same bits."""
        return self.description.attributes.get("generationTool", "").startswith("eightpost ")

    @property
    def once(self) -> bool:
        """Whether a process may hold only one instance of it."""
        return self.description.can("canBeInstantiatedOnlyOncePerProcess")

    @property
    def needs_tool(self) -> bool:
        """Whether it runs only if the tool that made it is installed."""
        return self.description.can("needsExecutionTool")

    @property
    def conditions(self) -> tuple[str, ...]:
        """Conditions of its results other than the file itself."""
        tool = "it needs the tool that made it (needsExecutionTool): the results depend on the version installed here"
        return (*([tool] if self.needs_tool else []), *self.notes)

    @property
    def log_categories(self) -> frozenset[str]:
        """Log categories that can be switched on."""
        return frozenset(self.description.categories)

    @cached_property
    def names_in_log(self) -> Mapping[str, str]:
        """Variable names by the form used in log messages: "r12", "12" in FMI 3.0; the first of several aliases."""
        letters = _LETTERS if self.version == 2 else {}
        return {f"{letters.get(row.type, '')}{row.reference}": row.names[0] for row in reversed(self.rows.rows)}

    @cached_property
    def variables(self) -> Mapping[str, Variable]:
        """All variables by name.

        Raises:
            FmuError: The model description is not valid.
        """
        try:
            return self.rows.variables(self.description)
        except ValueError as error:
            raise FmuError(f"{self.path}: its modelDescription.xml: {error}") from error

    @cached_property
    def capabilities(self) -> Capabilities:
        """Declared abilities."""
        can = self.description.can
        return Capabilities(
            interpolates_inputs=can("canInterpolateInputs") and (self.version == 2 or self.rows.ramps_all),
            variable_step=can("canHandleVariableCommunicationStepSize"),
            only_step=None if can("canHandleVariableCommunicationStepSize") else only_step(self.description),
            state=can("canGetAndSetFMUstate"),
            derivatives=can("providesDirectionalDerivative") and (self.version == 2 or self.rows.derives_all),
        )

    @cached_property
    def validity(self) -> Validity | None:
        """Range of validity of its model, as eightpost writes it into FMUs; None if the FMU has none."""
        try:
            return Validity.from_json(json_content(self.folder / MEMBER))
        except InputError:  # an FMU of another tool, or a damaged file
            return None

    @property
    def has_binary(self) -> bool:
        """Whether it has a folder of binaries for this platform."""
        return self.library.parent.is_dir()

    @property
    def _platform(self) -> str:
        return str(fmpy.platform_tuple if self.version == 3 else fmpy.platform)

    def _platforms(self) -> list[str]:
        with open_archive(self.path) as archive:
            places = [PurePosixPath(entry.filename).parts for entry in archive.infolist()]
        return sorted({place[1] for place in places if place[0] == "binaries" and len(place) > 1})

    def _check_platform(self) -> None:
        if self.has_binary:
            return
        advice = (
            "it contains its sources: compile them with --set compile=yes or compile_missing=True"
            if self.sources
            else "use an FMU with a binary for this platform, or one with sources"
        )
        has = ", ".join(self._platforms()) or "none"
        raise FmuError(f"{self.path}: has no binary for this platform ({self._platform}), only for: {has}; {advice}")


def _is_needed(name: str) -> bool:
    """Whether a run needs a file of an FMU that has a binary."""
    first, *others = PurePosixPath(name).parts
    if first == "binaries" and len(others) > 1:
        return others[0] in (fmpy.platform, fmpy.platform_tuple)
    return first not in ("documentation", "sources") or name == "sources/buildDescription.xml"


def _is_source(name: str) -> bool:
    return PurePosixPath(name).parts[0] == "sources"


class SharedFmu:
    """An FMU that is unpacked once for all its users in this process; the folder is removed with the last of them.

    Instances of one library share its code, as FMI intends: four shocks then fit in the processor's cache.
    """

    def __init__(self, fmu: FmuFile) -> None:
        self.fmu = fmu
        weakref.finalize(self, _remove_own, fmu.folder, os.getpid())

    @classmethod
    def of(cls, path: str | Path, *, compile_missing: bool = False) -> SharedFmu:
        """Return the FMU if it is unpacked already, else unpack it; a file that has changed since is unpacked again.

        Raises:
            FmuError: The file cannot be used; see `FmuFile.unpack`.
        """
        with _sharing:
            key = _identity(Path(path))
            shared = None if key is None else _shared.get(key)
            if shared is None:
                folder = tempfile.mkdtemp(prefix="fmu_")
                try:
                    shared = cls(FmuFile.unpack(path, folder, compile_missing=compile_missing))
                except BaseException:
                    shutil.rmtree(folder, ignore_errors=True)
                    raise
                if key is not None:
                    _shared[key] = shared
            return shared

    def forget(self) -> None:
        """Make the next user unpack the file again, because no function of this library may be called any more."""
        with _sharing:
            for key in [key for key, shared in _shared.items() if shared is self]:
                del _shared[key]


_shared: weakref.WeakValueDictionary[tuple[str, int, int], SharedFmu] = weakref.WeakValueDictionary()
_sharing = Lock()


def _identity(path: Path) -> tuple[str, int, int] | None:
    """Return the identity of a file; None if it cannot be read, which unpacking reports in more detail."""
    try:
        status = path.stat()
    except (OSError, ValueError):  # a ValueError if the name has a NUL
        return None
    return str(path.resolve()), status.st_mtime_ns, status.st_size


def _remove_own(folder: Path, owner: int) -> None:
    """Remove the folder, except in a process that was forked off the owner, which still needs it."""
    if os.getpid() == owner:
        shutil.rmtree(folder, ignore_errors=True)


# ==== Compilation of an FMU's own sources for a platform that it has no binary for ===================================

#: Strict double arithmetic without fused operations; warnings of foreign sources are suppressed.
_FLAGS = ("-O2", "-w", "-ffp-contract=off", "-shared")
_TIMEOUT = 600.0  # s
#: Cache folder of the libraries.
_KEPT_IN = "rebuilt"
_CPP = {".cc", ".cpp", ".cxx"}


def _compile_sources(
    path: Path, target: Path, files: Sequence[str], options: Sequence[str] = (), *, version: int = 2
) -> None:
    """Compile an FMU's sources into the library for this platform, or read the library from the cache.

    The cache is the folder `rebuilt` in EIGHTPOST_CACHE, or in the user's cache folder; its key is the digest of the
    FMU file, the compiler and its options.
    """
    sources = target.parents[2] / "sources"
    if missing := [name for name in files if not (sources / name).is_file()]:
        raise FmuError(f"{path}: lists the source {missing[0]!r}, which is not in its sources/; use a complete FMU")
    if not files:
        return  # the caller reports that there is neither a binary nor a source
    command = [*find_compiler(), *_options(files, version), *options]
    compiler = subprocess.run([*command[:1], "--version"], capture_output=True, check=False).stdout
    parts = (sha256_of(path).encode(), fmpy.platform.encode(), compiler, "\0".join(command).encode())
    key = hashlib.sha256(b"\0".join(parts)).hexdigest() + fmpy.sharedLibraryExtension
    if (library := recall(_KEPT_IN, key)) is None:
        library = _compile(path, sources, [*command, *files])
        keep(_KEPT_IN, key, library)
    with writing(target):
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_bytes(library)


def _options(files: Sequence[str], version: int) -> list[str]:
    position = [] if os.name == "nt" else ["-fPIC"]
    # The FMU's own headers come first, because it may contain modified ones.
    headers = ["-I.", "-I", str(Path(fmpy.__file__).with_name("c-code"))]
    # The definition keeps the functions' plain names (FMI 2.0.2 and later).
    plain = f"-DFMI{version}_OVERRIDE_FUNCTION_PREFIX"
    libraries = ["-lstdc++"] if _CPP & {Path(name).suffix for name in files} else []
    return [*_FLAGS, plain, *position, *headers, *libraries]


def _compile(path: Path, sources: Path, command: Sequence[str]) -> bytes:
    with tempfile.TemporaryDirectory(prefix="fmu_build_") as build:
        product = Path(build) / f"library{fmpy.sharedLibraryExtension}"
        # The mathematics library comes last, because the linker resolves only symbols needed before it.
        fault = _run([*command, "-o", str(product), *([] if os.name == "nt" else ["-lm"])], sources)
        if fault or not product.is_file():
            raise FmuError(
                f"{path}: its sources do not compile with {Path(command[0]).name}: {fault or 'no library was made'}; "
                f"ask for a binary for this platform ({fmpy.platform})"
            )
        return product.read_bytes()


def _run(command: Sequence[str], folder: Path) -> str:
    """Run a compiler; return its first error message, or an empty string."""
    try:
        ran = subprocess.run(
            command, cwd=folder, capture_output=True, text=True, errors="replace", timeout=_TIMEOUT, check=False
        )
    except (OSError, subprocess.TimeoutExpired) as error:
        return str(error)
    if ran.returncode == 0:
        return ""
    lines = [line.strip() for line in (ran.stderr + ran.stdout).splitlines()]
    return next((line for line in lines if "error" in line.lower()), f"it ended with code {ran.returncode}")
