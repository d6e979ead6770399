"""Third-party tools: `fmpy validate`, `fmutool -check`, XML schemas, and the C compiler."""

from __future__ import annotations

import logging
import re
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import cache
from pathlib import Path

from builder.check.archive import CheckedFmu
from builder.check.probes.library import binary_members
from builder.check.process import Outcome, Unpacked, differences, trace
from builder.check.rules import RULES, Finding
from eightpost.extras import needs
from eightpost.fmi.description import BUILD
from eightpost.workers.process import run

# ---- Checkers -------------------------------------------------------------------------------------------------------

_SUMMARY = ("This FMU does not validate", "semantic error(s)")


def tool_findings(subject: CheckedFmu) -> Iterator[Finding]:
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
_SCHEMAS = {"terminalsAndIcons/terminalsAndIcons.xml": "fmi3TerminalsAndIcons.xsd", BUILD: "fmi3BuildDescription.xsd"}


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


def _fmpy(subject: CheckedFmu) -> list[str]:
    """Return the problems that FMPy reports; its parser of names is only used where one is not plain."""
    from fmpy.validation import validate_fmu  # noqa: PLC0415 - slow to import

    try:
        if _has_plain_names(subject):
            return _fmpy_without_names(subject.path)
        return [str(problem) for problem in validate_fmu(str(subject.path))]
    except Exception as error:  # an exception of its parser is a finding
        return [f"{type(error).__name__}: {error}"]


def _has_plain_names(subject: CheckedFmu) -> bool:
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

_TIMEOUT, _TRIAL_TIMEOUT = 120.0, 30.0  # s
_OPTIONS = ("-shared", "-fPIC", "-w", "-ffp-contract=off",
            "-DFMI2_OVERRIDE_FUNCTION_PREFIX", "-DFMI3_OVERRIDE_FUNCTION_PREFIX")  # fmt: skip


def rebuild(subject: CheckedFmu, unpacked: Unpacked, plain: Outcome) -> Outcome:
    """Compile the sources with the C compiler of this machine, and compare a run with that of the FMU's binary."""
    fmu = subject.description
    if fmu is None or not fmu.sources.files:
        return Outcome(skipped=(("", "no sources are listed"),))
    if any(f"sources/{name}" not in subject.members for name in fmu.sources.files):
        return Outcome(skipped=(("", "sources are missing"),))
    names = (
        ("c++", "g++", "clang++") if any(not n.endswith(".c") for n in fmu.sources.files) else ("cc", "gcc", "clang")
    )
    compiler = next(filter(None, map(shutil.which, names)), "")
    if not compiler:
        return Outcome(skipped=(("", f"the sources could not be compiled here: there is no {names[0]}"),))
    with tempfile.TemporaryDirectory(prefix="eightpost_rebuild_") as name:
        folder = Path(name)
        if fault := _trial(compiler):
            return Outcome(
                skipped=(("", f"the sources could not be compiled here: {compiler} does not work ({fault})"),)
            )
        copy = folder / "fmu"
        shutil.copytree(unpacked.folder, copy, ignore=shutil.ignore_patterns("binaries"))
        binary = copy / binary_members(fmu.identifier, fmu.fmi)[0]
        binary.parent.mkdir(parents=True)
        definitions = [f"-D{d.get('name', '')}={d.get('value', '1')}" for d in fmu.sources.definitions]
        includes = ["-I.", *(f"-I{place}" for place in fmu.sources.folders), "-I", str(_headers())]
        command = [compiler, *_OPTIONS, *definitions, *includes, *fmu.sources.files, "-o", str(binary), "-lm"]
        if message := _run(command, copy / "sources", _TIMEOUT):
            return Outcome((RULES["sources-compile"].finding(message),))
        return Outcome(tuple(differences(RULES["rebuilt-same"], plain, trace(replace(unpacked, folder=copy), folder))))


def _headers() -> Path:
    """Return the folder with the headers of FMI 2.0 and 3.0."""
    with needs("check", "checking FMUs"):
        import fmpy  # noqa: PLC0415 - slow to import

    return Path(fmpy.__file__).with_name("c-code")


@cache
def _trial(compiler: str) -> str:
    """Compile a library of one function; return the reason if that fails, otherwise "".

    A compiler on the PATH does not always work: on macOS, it may be a stub that asks the user to install it.
    """
    with tempfile.TemporaryDirectory(prefix="eightpost_trial_") as name:
        folder = Path(name)
        (folder / "trial.c").write_text("int eightpost_trial(void) { return 0; }\n", encoding="utf-8")
        return _run([compiler, "-shared", "-fPIC", "trial.c", "-o", "trial.so"], folder, _TRIAL_TIMEOUT)


def _run(command: list[str], folder: Path, patience: float) -> str:
    """Run a command; return the error message, or "" if it succeeded. Its children are ended with it."""
    ran = run(command, patience, folder=folder, together=True, tree=True)
    if ran.code is None:
        return f"it did not end within {patience:g} s"
    lines = [line.strip() for line in ran.output.decode("utf-8", "replace").splitlines() if line.strip()]
    faults = [line for line in lines if "error" in line.lower()] + lines[-1:]
    return "" if ran.code == 0 else next(iter(faults), f"it ended with code {ran.code} and printed nothing")
