"""Install the wheel with several interpreters, and check each installation: `make pythons`, `make bounds`.

For each interpreter of a supported version that uv finds on this machine: a virtual environment outside the checkout,
the wheel with all verbs, `eightpost doctor`, and tests of this checkout against the installed packages. With `--lowest`
every direct dependency has the oldest version that pyproject.toml allows. Interpreters are not downloaded.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
UV = (sys.executable, "-m", "uv")

#: Supported versions of Python.
VERSIONS = ("3.11", "3.12", "3.13", "3.14")
#: Tests that show within minutes whether the packages work together: files, laws, a vehicle, FMUs, a coupled run.
TESTS = (
    "tests/signals", "tests/shock/test_laws.py", "tests/shock/test_file.py", "tests/vehicle/test_statespace.py",
    "tests/test_units.py", "tests/test_extras.py", "tests/commands/test_doctor.py", "tests/commands/test_new.py",
    "tests/cosim/test_master.py",
)  # fmt: skip
#: What these tests need.
TOOLS = ("pytest>=8.4", "hypothesis", "filelock", "openpyxl", "hatchling")


@dataclass(frozen=True)
class Outcome:
    """One interpreter and what happened with it.

    Attributes:
        python: Version of the interpreter.
        installed: Whether the wheel could be installed.
        works: Whether `eightpost doctor` is satisfied.
        tests: Last line of the tests; empty if they were not run.
        passed: Whether everything succeeded.
    """

    python: str
    installed: bool
    works: bool = False
    tests: str = ""
    passed: bool = False


def interpreters() -> list[Path]:
    """Return the newest interpreter of each supported version that uv or pyenv has on this machine."""
    command = [*UV, "python", "list", "--only-installed", "--output-format", "json"]
    listed = json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)
    paths = {entry["path"] for entry in listed if entry["implementation"] == "cpython"}
    home = Path(os.environ.get("PYENV_ROOT") or Path.home() / ".pyenv")
    paths |= {str(path) for path in home.glob("versions/3.*/bin/python3")}
    newest: dict[str, tuple[tuple[int, ...], Path]] = {}
    for path in sorted(paths):
        asked = subprocess.run([path, "-V"], check=False, capture_output=True, text=True).stdout.split()
        numbers = tuple(int(number) for number in re.findall(r"\d+", asked[1])) if len(asked) == 2 else ()
        version = ".".join(map(str, numbers[:2]))
        if version in VERSIONS and (version not in newest or numbers > newest[version][0]):
            newest[version] = (numbers, Path(path))
    return [newest[version][1] for version in VERSIONS if version in newest]


@dataclass(frozen=True)
class Source:
    """What is tried out; later changes of the checkout have no influence on it.

    Attributes:
        wheel: Wheel of this checkout.
        checkout: Copy of the tests and of the files that they read, without the packages.
    """

    wheel: Path
    checkout: Path

    @classmethod
    def of_checkout(cls, folder: Path) -> Source:
        """Build the wheel, and copy the tests, into a folder."""
        command = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(folder)]
        subprocess.run(command, cwd=ROOT, check=True, capture_output=True)
        copied = folder / "checkout"
        copied.mkdir()
        for name in (
            "tests",
            "pyproject.toml",
            "Makefile",
            "examples",
            "fmus",
            "dissertation",
            "benchmarks",
            "docs",
            "release",
        ):
            copy = shutil.copytree if (ROOT / name).is_dir() else shutil.copy
            copy(ROOT / name, copied / name)
        return cls(next(folder.glob("*.whl")), copied)


def try_out(python: Path, source: Source, folder: Path, *, lowest: bool, tests: bool) -> Outcome:
    """Install the wheel with an interpreter and check the installation.

    Args:
        python: Interpreter.
        source: Wheel and tests.
        folder: Folder for the environment and its cache of compiled code.
        lowest: Whether to install the oldest allowed version of every direct dependency.
        tests: Whether to run tests too.
    """
    home = folder / "venv"
    subprocess.run([*UV, "venv", "--quiet", "--python", str(python), str(home)], check=True)
    inside = home / ("Scripts" if sys.platform == "win32" else "bin") / "python"
    version = subprocess.run([inside, "-c", "import platform; print(platform.python_version())"], check=True,
                             capture_output=True, text=True).stdout.strip()  # fmt: skip
    install = [*UV, "pip", "install", "--quiet", "--python", str(inside)]
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    environment |= {"EIGHTPOST_CACHE": str(folder / "cache")}
    # To uv, the dependencies of a wheel are indirect: those of the project file are the ones that it lowers.
    project = source.checkout / "pyproject.toml"
    oldest = ["-r", str(project), "--extra", "all", "--resolution", "lowest-direct"]
    steps = [oldest, ["--no-deps", str(source.wheel)]] if lowest else [[f"{source.wheel}[all]"]]
    if any(subprocess.run([*install, *step], check=False).returncode for step in steps):
        return Outcome(version, installed=False)
    doctor = subprocess.run([inside, "-I", "-m", "eightpost", "doctor"], cwd=folder, env=environment, check=False)
    if doctor.returncode or not tests:
        return Outcome(version, True, doctor.returncode == 0, passed=doctor.returncode == 0)
    subprocess.run([*install, *TOOLS], check=True)
    warnings = ["-o", "filterwarnings=default"] if lowest else []  # old versions warn about each other
    command = [inside, "-m", "pytest", "-q", *warnings, "-m", "not slow", *TESTS]
    ran = subprocess.run(
        command, cwd=source.checkout, env=environment, check=False, capture_output=True, text=True, encoding="utf-8"
    )
    print(ran.stdout[-3000:] if ran.returncode else "", ran.stderr[-3000:], flush=True)
    last = (ran.stdout.strip().splitlines() or ["no output"])[-1]
    return Outcome(version, True, True, last, ran.returncode == 0)


def table(outcomes: list[Outcome], expected: Sequence[str] = VERSIONS) -> str:
    """Return the outcomes as a table, with the expected versions that were not run."""
    lines = ["| Python | wheel with all verbs | `eightpost doctor` | tests |", "|---|---|---|---|"]
    for one in outcomes:
        installed = "installed" if one.installed else "cannot be installed"
        works = "works" if one.works else "-" if not one.installed else "fails"
        lines.append(f"| {one.python} | {installed} | {works} | {one.tests or 'not run'} |")
    missing = [version for version in expected if not any(one.python.startswith(version) for one in outcomes)]
    lines += [f"| {version} | not run: no such interpreter on this machine | - | - |" for version in missing]
    return "\n".join(lines)


def main(arguments: list[str] | None = None) -> int:
    """Try out the interpreters, and print a table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--lowest", action="store_true", help="install the oldest allowed dependencies")
    parser.add_argument("--python", type=Path, action="append", help="interpreter; default: all that uv finds")
    parser.add_argument("--no-tests", action="store_true", help="run eightpost doctor only")
    options = parser.parse_args(arguments)
    pythons = options.python or interpreters()
    if options.lowest:
        pythons = pythons[:1]  # the oldest versions of compiled packages have wheels for the oldest Python only
    outcomes = []
    with tempfile.TemporaryDirectory() as name:
        source = Source.of_checkout(Path(name))
        for number, python in enumerate(pythons):
            folder = Path(name) / str(number)
            folder.mkdir()
            outcomes.append(try_out(python, source, folder, lowest=options.lowest, tests=not options.no_tests))
            shutil.rmtree(folder / "venv")
    print(table(outcomes, () if options.python else VERSIONS))
    return 0 if outcomes and all(one.passed for one in outcomes) else 1


if __name__ == "__main__":
    sys.exit(main())
