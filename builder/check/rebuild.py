"""The sources in an archive, compiled as `fmpy compile` does, must give the FMU that is in it."""

from __future__ import annotations

import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from builder.check.catalogue import archive as rules
from builder.check.process import Outcome, run_probe
from builder.check.subject import Subject

_TIMEOUT = 300.0
_BUILD = "import sys; from fmpy.build import build_platform_binary; build_platform_binary(sys.argv[1])"
_COMPILERS = ("cc", "gcc", "clang", "cl")


def rebuild(subject: Subject, unpacked: Path) -> Outcome:
    """Compile the sources and compare a run with the FMU's own."""
    if reason := _reason_not_to(subject):
        return Outcome(skipped=(("", reason),))
    with tempfile.TemporaryDirectory(prefix="eightpost_rebuild_") as folder:
        fresh = Path(folder) / "fmu"
        shutil.copytree(unpacked, fresh, ignore=shutil.ignore_patterns("binaries"))
        if message := _compile(fresh):
            return Outcome((rules.REBUILD.finding(message),))
        ours, theirs = (run_probe("surroundings", place, module="trace") for place in (fresh, unpacked))
        if not ours.completed or ours.findings:
            return Outcome((rules.REBUILT_SAME.finding("; ".join(f.message for f in ours.findings)),))
        if ours.values != theirs.values:
            return Outcome((rules.REBUILT_SAME.finding("the outputs of a short run differ"),))
    return Outcome()


def _reason_not_to(subject: Subject) -> str:
    files = subject.description.source_files if subject.description else ()
    if not files:
        return "no sources are listed"
    if any(f"sources/{name}" not in subject.members for name in files):
        return "sources are missing"
    if shutil.which("cmake") is None:
        return "there is no cmake here"
    return "" if any(map(shutil.which, _COMPILERS)) else "there is no C compiler here"


def _compile(folder: Path) -> str:
    """Build the binary of this platform; return what went wrong."""
    try:
        ran = subprocess.run(
            [sys.executable, "-c", _BUILD, str(folder)], capture_output=True, text=True, timeout=_TIMEOUT, check=False
        )
    except subprocess.TimeoutExpired:
        return f"the compiler did not end within {_TIMEOUT:g} s"
    if ran.returncode == 0:
        return ""
    said = [line.strip() for line in (ran.stdout + ran.stderr).splitlines() if "error" in line.lower()]
    return said[0] if said else f"the build ended with code {ran.returncode}"
