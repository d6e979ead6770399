"""`eightpost doctor`: its checks of the installation."""

from __future__ import annotations

import importlib.metadata
import json
import platform
import re
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from enum import Enum
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from rich.console import Console

from eightpost import __version__
from eightpost.app.options import option, verb
from eightpost.errors import EightpostError
from eightpost.extras import EXTRAS, REQUIRED, install_command, is_installed, missing, packages
from eightpost.workers.process import ROOT, usable_processors

if TYPE_CHECKING:
    from collections.abc import Sequence

    from builder.toolchain import Toolchain

# ==== Checks =========================================================================================================


class State(Enum):
    """Outcome of a check; only `failed` means that the installation does not work."""

    OK = "ok"
    NOTE = "note"
    ABSENT = "absent"
    FAILED = "failed"


@dataclass(frozen=True, slots=True)
class Finding:
    """Outcome of one check."""

    group: str  #: Subject, e.g. `versions`.
    name: str  #: Name of what was checked.
    state: State  #: Outcome.
    statement: str  #: Sentence or value that was found.
    remedy: str = ""  #: Action to take; may be empty.


#: Oldest and newest version of Python with which `eightpost demo` passed (docs/development/platforms.md).
TESTED = ((3, 11), (3, 14))
#: Largest error of the coupled run, in percent of the standard deviation of the exact solution.
TOLERANCE = 0.01


def findings() -> Iterator[Finding]:
    """Yield the findings of all checks, the quick ones first."""
    checks: tuple[Callable[[], Iterator[Finding]], ...] = (_versions, _extras, _platform, _caches, _run, _compiler)
    for check in checks:
        yield from check()


# ---- Versions and extras --------------------------------------------------------------------------------------------


def _versions() -> Iterator[Finding]:
    """Check this program, Python, and the packages that every installation needs."""
    yield Finding("versions", "eightpost", State.OK, f"{__version__} in {ROOT}")
    version, (first, last) = sys.version_info[:2], TESTED
    known = first <= version <= last
    yield Finding(
        "versions",
        "Python",
        State.OK if known else State.NOTE,
        f"{platform.python_version()} in {sys.prefix}",
        "" if known else f"tested with {first[0]}.{first[1]} to {last[0]}.{last[1]}",
    )
    minimum = _minimum_versions()
    for distribution in REQUIRED.values():
        yield _version(distribution, minimum.get(distribution, ""))


def _version(distribution: str, minimum: str) -> Finding:
    try:
        version = importlib.metadata.version(distribution)
    except importlib.metadata.PackageNotFoundError:
        remedy = f'pip install --force-reinstall "eightpost=={__version__}"'
        return Finding("versions", distribution, State.FAILED, "not installed", remedy)
    if _numbers(version) < _numbers(minimum):
        remedy = f'pip install --upgrade "{distribution}>={minimum}"'
        return Finding("versions", distribution, State.FAILED, f"{version} is older than {minimum}", remedy)
    return Finding("versions", distribution, State.OK, version)


def _minimum_versions() -> dict[str, str]:
    """Return the minimum versions of the required packages; empty if this is not an installed distribution."""
    try:
        required = importlib.metadata.requires("eightpost") or []
    except importlib.metadata.PackageNotFoundError:
        return {}
    found = (re.fullmatch(r"([\w.-]+)\s*>=\s*([\d.]+)", text) for text in required)
    return {match[1].lower(): match[2] for match in found if match}


def _numbers(version: str) -> tuple[int, ...]:
    return tuple(int(number) for number in re.findall(r"\d+", version)[:3])


def _extras() -> Iterator[Finding]:
    """List the extras: what each is for, and how to get those that are not complete."""
    for name, extra in EXTRAS.items():
        absent = missing(name)
        if not absent:
            yield Finding("extras", name, State.OK, extra.purpose)
            continue
        without = "not installed" if len(absent) == len(packages(name)) else f"without {', '.join(absent)}"
        yield Finding("extras", name, State.ABSENT, f"{extra.purpose}: {without}", install_command(name))


# ---- Platform and caches --------------------------------------------------------------------------------------------

#: What does not work, or was not tried, on a system other than Linux.
_LIMITS = {
    "win32": (
        "damaged .mat and .mdf files are read without a memory limit",
        "native FMUs were run under Wine only (docs/development/platforms.md)",
    ),
    "darwin": ("native FMUs were built but not run on macOS (docs/development/platforms.md)",),
}


def _platform() -> Iterator[Finding]:
    """Describe the machine, and what does not work on it."""
    about = f"{platform.system()} {platform.release()}, {platform.machine()}, {usable_processors()} processors"
    yield Finding("platform", "system", State.OK, about)
    for number, limit in enumerate(_LIMITS.get(sys.platform, ()), start=1):
        yield Finding("platform", f"limit {number}", State.NOTE, limit)
    folder = Path(tempfile.gettempdir())
    if _is_writable(folder):
        yield Finding("platform", "temporary files", State.OK, str(folder))
    else:
        remedy = "free some space there, or set TMPDIR to another folder"
        yield Finding("platform", "temporary files", State.FAILED, f"{folder} cannot be written", remedy)


def _caches() -> Iterator[Finding]:
    """Describe the cache of compiled code; without it, everything works but is compiled every time."""
    from eightpost.cache import cache_folder

    folder = cache_folder()
    sizes = [path.stat().st_size for path in folder.rglob("*") if path.is_file()] if folder.is_dir() else []
    statement = f"{folder}: {len(sizes)} files, {sum(sizes) / 1e6:.1f} MB"
    nearest = next(path for path in (folder, *folder.absolute().parents) if path.is_dir())
    if _is_writable(nearest):
        yield Finding("caches", "compiled code", State.OK, statement)
    else:
        remedy = "set EIGHTPOST_CACHE to a folder that can be written, or code is compiled in every run"
        yield Finding("caches", "compiled code", State.NOTE, f"{statement}, cannot be written", remedy)


def _is_writable(folder: Path) -> bool:
    try:
        with tempfile.TemporaryFile(dir=folder):
            return True
    except OSError:
        return False


# ---- A coupled run, and the compiler --------------------------------------------------------------------------------


def _run() -> Iterator[Finding]:
    """Compare a coupled run with its exact solution, in the loop, compiled if numba is installed, and interpreted."""
    started = time.perf_counter()
    try:
        statement, state = _coupled()
    except Exception as error:  # whatever it is, it is the finding
        statement, state = f"{type(error).__name__}: {error}", State.FAILED
    seconds = time.perf_counter() - started
    remedy = "" if state is State.OK else "reinstall numba and llvmlite, and delete the cache folder above"
    yield Finding("coupled run", "mass and damper", state, f"{statement}, {seconds:.1f} s", remedy)


def _coupled() -> tuple[str, State]:
    import numpy as np

    from eightpost.app.doctor_run import coupled_run, solution

    engines = ("compiled" if is_installed("numba") else "python", "python")
    compiled, interpreted = (coupled_run(engine).series for engine in engines)
    exact = solution(compiled.time)
    velocity = compiled["wheel.velocity"]
    error = 100.0 * float(np.sqrt(np.mean((velocity - exact) ** 2)) / np.std(exact))
    if not np.array_equal(velocity, interpreted["wheel.velocity"]):
        return "the compiled loop and the same loop interpreted differ", State.FAILED
    close = error < TOLERANCE
    return f"{error:.2g} % from the exact solution, limit {TOLERANCE:g} %", State.OK if close else State.FAILED


def _compiler() -> Iterator[Finding]:
    """Build an FMU, load it and advance it by a step."""
    group, name = "compiler", "FMU of a shock"
    if missing("build-local"):
        yield Finding(group, name, State.ABSENT, "FMUs cannot be built", install_command("build"))
        return
    from builder.toolchain import find_toolchain

    try:
        toolchain = find_toolchain()
    except EightpostError as error:
        yield Finding(group, name, State.ABSENT, "there is no C compiler", str(error))
        return
    platforms = ", ".join(found.name for found in toolchain.platforms)
    yield Finding(group, toolchain.name, State.OK, f"{toolchain.path}: builds for {platforms}", toolchain.limits)
    started = time.perf_counter()
    try:
        statement, state = _built(toolchain), State.OK
    except Exception as error:  # whatever it is, it is the finding
        statement, state = f"{type(error).__name__}: {error}", State.FAILED
    yield Finding(group, name, state, f"{statement}, {time.perf_counter() - started:.1f} s")


def _built(toolchain: Toolchain) -> str:
    from builder.build import build
    from cosim import FmuComponent
    from eightpost.examples_folder import examples_folder

    with tempfile.TemporaryDirectory() as folder:
        (item,) = build([examples_folder() / "bank" / "B_B.json"], folder)
        size = item.path.stat().st_size
        shock = FmuComponent(item.path, "shock")
        try:
            shock.begin(0.0, 1.0, {})
            shock.set(["velocity"], [0.1])
            shock.end_initialization()
            shock.step(0.0, 1e-3)
            (force,) = shock.get(["force"])
        finally:
            shock.finish()
    if not force > 0.0:
        raise EightpostError(f"a shock that is compressed at 0.1 m/s has the force {force} N, which must be positive")
    return f"built for {len(toolchain.platforms)} platforms ({size / 1e6:.1f} MB), {force:.0f} N at 0.1 m/s"


# ==== Verb ===========================================================================================================

#: Version of the JSON document.
SCHEMA = 1

_COLORS = {"ok": "green", "note": "yellow", "absent": "cyan", "failed": "red"}


@verb
def doctor(
    ctx: click.Context,
    as_json: bool = option("Print one JSON document, e.g. for a report of a fault.", "--json"),
) -> None:  # fmt: skip
    """Check the installation: versions, extras, caches, a coupled run, the compiler.

    A coupled run is compared with its exact solution, and if the packages and a C compiler for it are installed, an FMU
    is built, loaded and stepped. Extras that are not installed are listed with the command that installs them; they are
    no fault. Nothing is sent anywhere. The first check on a machine compiles the loop, which takes about 20 s.

    The exit code is 0 if the installation works, 1 if a check failed.

    \b
    Examples:
      eightpost doctor
      eightpost doctor --json > doctor.json
    """

    with Console(stderr=True).status("checking the installation"):
        found = list(findings())
    works = all(finding.state is not State.FAILED for finding in found)
    if as_json:
        click.echo(json.dumps(_document(found, works), indent=1))  # ASCII, because a terminal may support nothing else
    else:
        _show(Console(), found, works)
    ctx.exit(0 if works else 1)


def _document(found: Sequence[Finding], works: bool) -> dict[str, Any]:
    return {
        "kind": "doctor",
        "schema": SCHEMA,
        "tool": f"eightpost {__version__}",
        "works": works,
        "findings": [asdict(finding) | {"state": finding.state.value} for finding in found],
    }


def _show(console: Console, found: Sequence[Finding], works: bool) -> None:
    from eightpost.app.show import is_detailed, show_text

    fine = [finding for finding in found if finding.state is State.OK and not is_detailed()]
    for finding in found:
        if finding not in fine:
            state = "" if finding.state is State.OK else f"{finding.state.value} "
            remedy = f" -> {finding.remedy}" if finding.remedy else ""
            show_text(console, f"{finding.group}, {finding.name}: {state}{finding.statement}{remedy}", hanging="  ")
    if fine:
        show_text(console, f"{len(fine)} checks found nothing wrong; -v lists them")
    verdict = "[green]The installation works.[/]" if works else "[red]The installation does not work: see `failed`.[/]"
    console.print(verdict, highlight=False)
