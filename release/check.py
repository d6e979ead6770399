"""Check that this checkout can be released: `make release`. Nothing is tagged or uploaded.

The checks: no uncommitted change, one version everywhere, a dated entry in the changelog, a new tag, wheel and source
distribution with valid metadata, an installation of the wheel that works, and all tests. If all pass, the distributions
that were checked are in dist/, and the steps that remain are printed.
"""

from __future__ import annotations

import argparse
import re
import shutil
import subprocess
import sys
import tempfile
import venv
from collections.abc import Callable, Iterator
from pathlib import Path

from eightpost import __version__

ROOT = Path(__file__).resolve().parents[1]


class NotReadyError(Exception):
    """The checkout cannot be released; the message says what to do."""


# ---- Checks of the checkout -----------------------------------------------------------------------------------------


def check_tree(root: Path) -> str:
    """Check that everything is committed, so that the tag will contain what was tested."""
    if changed := _output("git", "status", "--porcelain", folder=root):
        raise NotReadyError(f"commit or remove these changes first:\n{changed}")
    return f"no uncommitted change; commit {_output('git', 'rev-parse', '--short', 'HEAD', folder=root)}"


def check_versions(root: Path) -> str:
    """Check that every file that states the version states the same."""
    stated = dict(versions(root))
    if set(stated.values()) != {__version__}:
        listed = "\n".join(f"{place}: {version}" for place, version in stated.items())
        raise NotReadyError(f"the version is {__version__} in eightpost/__init__.py; make these equal:\n{listed}")
    return f"version {__version__} in {', '.join(stated)}"


def versions(root: Path) -> Iterator[tuple[str, str]]:
    """Yield each file that states the version, and the version; an empty text if it states none."""
    for name, pattern in (
        ("CITATION.cff", r"^version: (\S+)$"),
        ("CHANGELOG.md", r"^## (\d+\.\d+\.\d+)"),
    ):
        found = re.search(pattern, (root / name).read_text(encoding="utf-8"), flags=re.MULTILINE)
        yield name, found[1] if found else ""


def check_changelog(root: Path) -> str:
    """Check that the first entry of the changelog is this version with a date, and return the date."""
    text = (root / "CHANGELOG.md").read_text(encoding="utf-8")
    if re.search(r"^## Unreleased", text, flags=re.MULTILINE):
        raise NotReadyError(f"CHANGELOG.md has a section Unreleased: move its entries to {__version__}")
    entry = re.search(rf"^## {re.escape(__version__)} \((\d{{4}}-\d\d-\d\d)\)\n(.*?)(?=^## |\Z)", text, re.M | re.S)
    if entry is None:
        raise NotReadyError(f"CHANGELOG.md needs a heading '## {__version__} (YYYY-MM-DD)'")
    if "\n- " not in entry[2]:
        raise NotReadyError(f"CHANGELOG.md lists no change of {__version__}")
    if f"date-released: {entry[1]}\n" not in (root / "CITATION.cff").read_text(encoding="utf-8"):
        raise NotReadyError(f"CITATION.cff needs the line 'date-released: {entry[1]}', the date in CHANGELOG.md")
    return f"released on {entry[1]} in CHANGELOG.md and CITATION.cff"


def check_tag(root: Path) -> str:
    """Check that the version was not released before."""
    if _output("git", "tag", "--list", f"v{__version__}", folder=root):
        raise NotReadyError(f"the tag v{__version__} exists; raise the version in eightpost/__init__.py")
    return f"the tag v{__version__} does not exist yet"


# ---- Checks of the distributions ------------------------------------------------------------------------------------


def check_distributions(root: Path) -> str:
    """Build wheel and source distribution, check their metadata, install the wheel and check the installation.

    The distributions are then put into dist/, where no others remain.
    """
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        files = []
        for kind in ("sdist", "wheel"):
            _run(sys.executable, "-m", "hatchling", "build", "-t", kind, "-d", str(folder / kind), folder=root)
            files += map(str, (folder / kind).iterdir())
        _run(sys.executable, "-m", "twine", "check", "--strict", *files, folder=folder)
        venv.create(folder / "venv", with_pip=True)
        python = folder / "venv" / ("Scripts" if sys.platform == "win32" else "bin") / "python"
        _run(str(python), "-m", "pip", "install", "--quiet", files[-1], folder=folder)
        _run(str(python), "-I", "-m", "eightpost", "doctor", folder=folder)
        sizes = ", ".join(f"{Path(file).name} {Path(file).stat().st_size / 1e6:.1f} MB" for file in files)
        shutil.rmtree(root / "dist", ignore_errors=True)
        (root / "dist").mkdir()
        for file in files:
            shutil.move(file, root / "dist")
    return f"dist/ has {sizes}; the wheel installs, and `eightpost doctor` is satisfied"


def check_tests(root: Path) -> str:
    """Run `make test`."""
    _run("make", "test", folder=root)
    return "make test passed"


def _output(*command: str, folder: Path) -> str:
    return subprocess.run(command, cwd=folder, check=True, capture_output=True, text=True).stdout.strip()


def _run(*command: str, folder: Path) -> None:
    ran = subprocess.run(command, cwd=folder, check=False, capture_output=True, text=True)
    if ran.returncode:
        words = " ".join(command)
        raise NotReadyError(f"`{words}` ended with {ran.returncode}:\n{ran.stdout[-4000:]}{ran.stderr[-4000:]}")


# ---- The command ----------------------------------------------------------------------------------------------------

CHECKS: tuple[Callable[[Path], str], ...] = (
    check_tree, check_versions, check_changelog, check_tag, check_distributions, check_tests,
)  # fmt: skip


def steps_text(root: Path) -> str:
    """Return what a maintainer does after the checks; this script does not."""
    files = " ".join(f"dist/{path.name}" for path in sorted((root / "dist").iterdir()))
    return (
        f"eightpost {__version__} is ready. What remains:\n"
        "1. Unless these have passed since the last change of code: make nightly, make pythons, make bounds\n"
        f"2. Tag this commit:\n{tag_text()}\n"
        f"3. Upload the distributions that were checked:\npython -m twine upload {files}\n"
        "4. Begin the next version: raise it in eightpost/__init__.py and CITATION.cff, and add a section "
        "'## Unreleased' to CHANGELOG.md"
    )


def tag_text() -> str:
    """Return the commands that tag the version; the changelog has its text."""
    name = f"v{__version__}"
    return f"git tag -a {name} -m 'eightpost {__version__}, see CHANGELOG.md'\ngit push origin {name}"


def main(arguments: list[str] | None = None) -> int:
    """Run the checks in order, stop at the first that fails, and print what remains to be done."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    names = [check.__name__.removeprefix("check_") for check in CHECKS]
    parser.add_argument("--skip", nargs="*", choices=names, default=[], help="checks to leave out; for a trial only")
    skipped = parser.parse_args(arguments).skip
    for name, check in zip(names, CHECKS, strict=True):
        if name in skipped:
            print(f"skipped: {name}")
            continue
        try:
            print(f"ok: {check(ROOT)}", flush=True)
        except NotReadyError as error:
            print(f"NOT READY ({name}): {error}\nThen run `make release` again.", file=sys.stderr)
            return 1
    print(
        f"\n{steps_text(ROOT)}"
        if not skipped
        else f"\nNot a release: skipped {', '.join(skipped)}. Run `make release`."
    )
    return 0


if __name__ == "__main__":
    sys.exit(main())
