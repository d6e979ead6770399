"""Third-party tools: `fmpy validate`, `fmutool -check`, XML schemas, and `fmpy compile` of the sources."""

from __future__ import annotations

import logging
import os
import re
import shutil
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

from builder.check.process import Outcome, Unpacked, trace
from builder.check.rules import RULES, Finding
from eightpost.extras import needs
from eightpost.fmi.description import BUILD
from eightpost.workers.process import python_command, run

if TYPE_CHECKING:  # the process that compiles would spend a second on its imports
    from builder.check.archive import Subject

# ---- Checkers -------------------------------------------------------------------------------------------------------

_SUMMARY = ("This FMU does not validate", "semantic error(s)")


def tool_findings(subject: Subject) -> Iterator[Finding]:
    """Apply both checkers to an FMU, and the schemas of the documents that they do not look at."""
    for problem in _fmpy(subject):
        yield RULES["fmpy-validate"].finding(problem)
    for message in _fmutool(subject.path):
        if not any(text in message for text in _SUMMARY):
            yield RULES["fmutool-check"].finding(message)
    for member, schema in _SCHEMAS.items():
        if member in subject.members:
            yield from (
                RULES["schema"].finding(f"{member}: {fault}") for fault in _faults(subject.members[member], schema)
            )


#: Documents with their schemas, which are those of FMI 3.0 in both versions.
_SCHEMAS = {
    "terminalsAndIcons/terminalsAndIcons.xml": "fmi3TerminalsAndIcons.xsd",
    BUILD: "fmi3BuildDescription.xsd",
}


def _faults(content: bytes, schema: str) -> list[str]:
    """Return the lines of a document that do not follow a schema, at most three."""
    with needs("check", "checking FMUs"):
        import fmu_manipulation_toolbox  # noqa: PLC0415 - slow to import
        from lxml import etree  # noqa: PLC0415

    folder = Path(fmu_manipulation_toolbox.__file__).parent / "resources" / "fmi-3.0"
    rules_of_schema = etree.XMLSchema(etree.parse(folder / schema))
    try:
        document = etree.fromstring(content, etree.XMLParser(resolve_entities=False, no_network=True))
    except etree.XMLSyntaxError as error:
        return [str(error)]
    rules_of_schema.validate(document)
    return [f"line {entry.line}: {entry.message}" for entry in rules_of_schema.error_log][:3]


#: An identifier without quotes, as the standards define it, with indices.
_PART = r"[A-Za-z_][A-Za-z_0-9]*(\[[0-9]+(,[0-9]+)*\])?"
_IDENTIFIER = rf"{_PART}(\.{_PART})*"

#: Structured names without quotes (FMI 2.0 section 2.2.9). FMPy accepts them, but its parser takes 3 ms for each.
_PLAIN_NAME = re.compile(rf"{_IDENTIFIER}|der\({_IDENTIFIER}(,[0-9]+)?\)")


def _fmpy(subject: Subject) -> list[str]:
    """Return the problems that FMPy reports; its parser of names is only used where one is not plain."""
    from fmpy.validation import validate_fmu  # noqa: PLC0415 - slow to import

    try:
        if _has_plain_names(subject):
            return _fmpy_without_names(subject.path)
        return [str(problem) for problem in validate_fmu(str(subject.path))]
    except Exception as error:  # an exception of its parser is a finding
        return [f"{type(error).__name__}: {error}"]


def _has_plain_names(subject: Subject) -> bool:
    """Return whether FMPy has nothing to say about the names of variables and members."""
    variables = subject.description.variables if subject.description else ()
    names = all(_PLAIN_NAME.fullmatch(variable.name) for variable in variables)
    return bool(variables) and names and not any("\\" in entry.orig_filename for entry in subject.entries)


def _fmpy_without_names(path: Path) -> list[str]:
    from fmpy.model_description import ValidationError, read_model_description  # noqa: PLC0415 - slow to import

    try:
        read_model_description(str(path), validate=True, validate_model_structure=True)
    except ValidationError as error:
        return [str(problem) for problem in error.problems]
    except Exception as error:  # as FMPy's own validation reports it
        return [str(error)]
    return []


def _fmutool(path: Path) -> list[str]:
    with needs("check", "checking FMUs"):
        from fmu_manipulation_toolbox.checker import get_checkers  # noqa: PLC0415 - slow to import
        from fmu_manipulation_toolbox.operations import FMU  # noqa: PLC0415

    with _errors_logged("fmu_manipulation_toolbox") as messages:
        try:
            with FMU(str(path)) as fmu:
                for checker in get_checkers():
                    fmu.apply_operation(checker())
        except Exception as error:  # an exception of its parser is a finding
            messages.append(f"{type(error).__name__}: {error}")
    return messages


@contextmanager
def _errors_logged(name: str) -> Iterator[list[str]]:
    """Collect the errors that a library logs; it reports them in no other way."""
    messages: list[str] = []
    handler = logging.Handler(logging.ERROR)
    handler.emit = lambda record: messages.append(record.getMessage())  # type: ignore[method-assign]
    source = logging.getLogger(name)
    propagate, source.propagate = source.propagate, False
    source.addHandler(handler)
    try:
        yield messages
    finally:
        source.removeHandler(handler)
        source.propagate = propagate


# ---- Sources, compiled and compared with the binary -----------------------------------------------------------------

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
        if reason := _broken_compiler():
            return Outcome(skipped=(("", f"the sources could not be compiled here: {reason}"),))
        fresh = folder / "fmu"
        shutil.copytree(unpacked.folder, fresh, ignore=shutil.ignore_patterns("binaries"))
        build = python_command("builder.check.tools", str(fresh))
        if message := _run(build, folder, _TIMEOUT):
            return Outcome((RULES["sources-compile"].finding(message),))
        return _compared(trace(replace(unpacked, folder=fresh), folder), trace(unpacked, folder))


def _compared(rebuilt: Outcome, own: Outcome) -> Outcome:
    if not rebuilt.completed or rebuilt.findings:
        return Outcome((RULES["rebuilt-same"].finding("; ".join(f.message for f in rebuilt.findings)),))
    if rebuilt.values != own.values:
        return Outcome((RULES["rebuilt-same"].finding("the outputs of a short run differ"),))
    return Outcome()


def _reason_to_skip(subject: Subject) -> str:
    files = subject.description.sources.files if subject.description else ()
    if not files:
        return "no sources are listed"
    if any(f"sources/{name}" not in subject.members for name in files):
        return "sources are missing"
    return "" if shutil.which("cmake") else "CMake is not installed"


def _broken_compiler() -> str:
    """Compile a library of one function like the sources; return the reason if that fails, otherwise "".

    A compiler on the PATH does not always work: on macOS, it may be a stub that asks the user to install it.
    """
    return _trial(tuple(os.environ.get(name, "") for name in ("PATH", "CC", "CFLAGS", "LDFLAGS", "CMAKE_GENERATOR")))


@cache
def _trial(_environment: tuple[str, ...]) -> str:
    """Compile the trial once for all FMUs that are checked in the same environment."""
    with tempfile.TemporaryDirectory(prefix="eightpost_trial_") as name:
        folder = Path(name)
        (folder / "trial.c").write_text(_TRIAL, encoding="utf-8")
        (folder / "CMakeLists.txt").write_text(_TRIAL_PROJECT, encoding="utf-8")
        for command in (["cmake", "-S", ".", "-B", "build"], ["cmake", "--build", "build"]):
            if message := _run(command, folder, _TRIAL_TIMEOUT):
                return f"there is no working C compiler ({message})"
    return ""


def _run(command: list[str], folder: Path, patience: float) -> str:
    """Run a command; return the error message, or "" if it succeeded.

    Its children are ended with it: a hanging compiler is a child of make, which is a child of cmake.
    """
    ran = run(command, patience, folder=folder, together=True, tree=True)
    if ran.code is None:
        return f"it did not end within {patience:g} s"
    return "" if ran.code == 0 else _first_error(ran.output.decode("utf-8", "replace"), ran.code)


def _first_error(printed: str, code: int) -> str:
    lines = [line.strip() for line in printed.splitlines() if line.strip()]
    named = [line for line in lines if "error" in line.lower()]
    return next(iter([*named, *lines[-1:]]), f"it ended with code {code} and printed nothing")


def _compile(folder: str) -> None:
    """Compile an unpacked FMU with FMPy; this module run as a program does this for `rebuild`."""
    from fmpy.build import build_platform_binary  # noqa: PLC0415 - slow to import

    # Sources may give functions the identifier as prefix, which FMI 3.0 lets the compiler remove.
    for name in ("CFLAGS", "CXXFLAGS"):
        os.environ[name] = f"{os.environ.get(name, '')} -DFMI3_FUNCTION_PREFIX=".strip()
    tempfile.tempdir = str(Path.cwd())  # the parent process removes this folder even if the compiler was killed
    build_platform_binary(folder)


if __name__ == "__main__":
    _compile(sys.argv[1])
