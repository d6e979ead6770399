"""Check that the sources in an archive, compiled like `fmpy compile` does, give the same outputs as its binary."""

from __future__ import annotations

import contextlib
import os
import shutil
import signal
import subprocess
import sys
import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Any

from builder.check.catalogue import archive as rules
from builder.check.process import Outcome, Unpacked
from builder.check.subject import Subject
from builder.check.surroundings import trace
from eightpost.interpreter import python_command

_TIMEOUT, _TRIAL_TIMEOUT = 300.0, 60.0  # s
_TRIAL = "int eightpost_trial(void) { return 0; }\n"
_TRIAL_PROJECT = """\
cmake_minimum_required(VERSION 3.5)
project(trial)
add_library(trial SHARED trial.c)
"""


def rebuild(subject: Subject, unpacked: Unpacked) -> Outcome:
    """Compile the sources and compare a run of the result with a run of the FMU's binary."""
    if reason := _reason_to_skip(subject):
        return Outcome(skipped=(("", reason),))
    with tempfile.TemporaryDirectory(prefix="eightpost_rebuild_") as name:
        folder = Path(name)
        if reason := _broken_compiler(folder / "trial"):
            return Outcome(skipped=(("", f"the sources could not be compiled here: {reason}"),))
        fresh = folder / "fmu"
        shutil.copytree(unpacked.folder, fresh, ignore=shutil.ignore_patterns("binaries"))
        build = python_command("builder.check.compile_sources", str(fresh))
        if message := _run(build, folder, _TIMEOUT):
            return Outcome((rules.REBUILD.finding(message),))
        return _compared(trace(replace(unpacked, folder=fresh), folder), trace(unpacked, folder))


def _compared(rebuilt: Outcome, own: Outcome) -> Outcome:
    if not rebuilt.completed or rebuilt.findings:
        return Outcome((rules.REBUILT_SAME.finding("; ".join(f.message for f in rebuilt.findings)),))
    if rebuilt.values != own.values:
        return Outcome((rules.REBUILT_SAME.finding("the outputs of a short run differ"),))
    return Outcome()


def _reason_to_skip(subject: Subject) -> str:
    files = subject.description.source_files if subject.description else ()
    if not files:
        return "no sources are listed"
    if any(f"sources/{name}" not in subject.members for name in files):
        return "sources are missing"
    return "" if shutil.which("cmake") else "CMake is not installed"


def _broken_compiler(folder: Path) -> str:
    """Compile a library of one function like the sources; return the reason if that fails, otherwise "".

    A compiler on the PATH does not always work: on macOS, it may be a stub that asks the user to install it.
    """
    folder.mkdir()
    (folder / "trial.c").write_text(_TRIAL, encoding="utf-8")
    (folder / "CMakeLists.txt").write_text(_TRIAL_PROJECT, encoding="utf-8")
    for command in (["cmake", "-S", ".", "-B", "build"], ["cmake", "--build", "build"]):
        if message := _run(command, folder, _TRIAL_TIMEOUT):
            return f"there is no working C compiler ({message})"
    return ""


def _run(command: list[str], folder: Path, patience: float) -> str:
    """Run a command; return the error message, or "" if it succeeded."""
    new_group: dict[str, Any] = {} if sys.platform == "win32" else {"start_new_session": True}
    with (folder / "printed.txt").open("w+b") as printed:
        process = subprocess.Popen(
            command, cwd=folder, stdin=subprocess.DEVNULL, stdout=printed, stderr=subprocess.STDOUT, **new_group
        )
        try:
            code = process.wait(patience)
        except subprocess.TimeoutExpired:
            return f"it did not end within {patience:g} s"
        finally:
            _end(process)
        printed.seek(0)
        return "" if code == 0 else _first_error(printed.read().decode("utf-8", "replace"), code)


def _end(process: subprocess.Popen[bytes]) -> None:
    """Kill a process and its children: a hanging compiler is a child of make, which is a child of cmake."""
    if process.poll() is None:
        with contextlib.suppress(ProcessLookupError):
            process.kill() if sys.platform == "win32" else os.killpg(process.pid, signal.SIGKILL)
        process.wait()


def _first_error(printed: str, code: int) -> str:
    lines = [line.strip() for line in printed.splitlines() if line.strip()]
    named = [line for line in lines if "error" in line.lower()]
    return next(iter([*named, *lines[-1:]]), f"it ended with code {code} and printed nothing")
