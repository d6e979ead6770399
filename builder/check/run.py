"""Execution of a check: groups that read the file, third-party tools, and probes in processes of their own."""

from __future__ import annotations

import json
import logging
import os
import re
import shutil
import tempfile
from collections.abc import Collection, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path
from typing import Any

from builder.check.archive import CheckedFmu, read_subject
from builder.check.description import static_findings
from builder.check.probes.bench import REACH
from builder.check.probes.library import FREEING_NOTHING, binary_members, platform_folders
from builder.check.rules import (
    GROUPS,
    RULES,
    CheckReport,
    Finding,
    Level,
    Scope,
    Skipped,
    finding_in_version_3,
    findings,
    listed,
    text_in_version_3,
)
from eightpost.errors import EightpostError, FmuError
from eightpost.extras import needs
from eightpost.files import sha256_of
from eightpost.fmi import BUILD, Description
from eightpost.workers import process

#: Longest processor time of a valid and of an invalid call; time for a process [s].
_PATIENCE, _MISUSE_PATIENCE, _TIMEOUT = 6.0, 0.7, 900.0
#: Processor time of the groups of valid calls, of those of invalid ones, and of a run in other surroundings [s].
_BUDGET, _MISUSE_BUDGET, _TRACE_BUDGET = 8.0, 4.0, 3.0
_LEAST = 1.0  # s of processor time with which another process begins


@dataclass(frozen=True)
class Outcome:
    """The result of a group of checks."""

    findings: tuple[Finding, ...] = ()  #: Findings.
    #: Pairs of a skipped part and the reason; an empty part stands for the whole group.
    skipped: tuple[tuple[str, str], ...] = ()
    completed: bool = True  #: Whether the group finished.
    used: float = 0.0  #: Processor time of the process, if it was ended because calls or groups take too long [s].
    values: Mapping[str, str] = field(default_factory=dict)  #: Measured values by name.


def _skipped(reason: str) -> Outcome:
    """Return the outcome of a group that was not run."""
    return Outcome(skipped=(("", reason),))


@dataclass(frozen=True)
class Unpacked:
    """An unpacked FMU, and the number of steps after which it ends the simulation itself (None if it does not)."""

    folder: Path
    reach: int | None = None


def _probed(groups: Sequence[str], unpacked: Unpacked, budget: float) -> Iterator[tuple[str, Outcome]]:
    """Run the probes of groups in a process with empty folders; yield the outcome of each that was begun.

    After a crash, the groups that are left run in another process, except after a crash of `simulation`. Files left in
    the working folder or in that of temporary files are findings.
    """
    remaining = list(groups)
    while remaining:
        with tempfile.TemporaryDirectory(prefix="eightpost_folder_") as name:
            folders = {"working-folder": Path(name) / "work", "temporary-files": Path(name) / "temporary"}
            for folder in folders.values():
                folder.mkdir()
            temporary = dict.fromkeys(("TMPDIR", "TMP", "TEMP"), str(folders["temporary-files"]))
            outcomes = _run(remaining, unpacked, folders["working-folder"], {**os.environ, **temporary}, budget)
            files = {rule: sorted(str(path.relative_to(f)) for path in f.rglob("*")) for rule, f in folders.items()}
        (last, outcome), remaining = outcomes[-1], remaining[len(outcomes) :]
        if outcome.completed:  # after a crash, the system may write files such as core
            stray = tuple(RULES[rule].finding(f"it left {listed(names)}") for rule, names in files.items() if names)
            outcomes[-1] = last, replace(outcome, findings=(*outcome.findings, *stray))
        yield from outcomes
        budget -= outcome.used
        if budget < (_LEAST if outcome.completed else max(_LEAST, _patience(groups))):  # another call may hang
            yield from ((group, _skipped("it would take too much processor time")) for group in remaining)
            return
        if last == "simulation" and not outcome.completed:
            return


def _patience(groups: Sequence[str]) -> float:
    return _MISUSE_PATIENCE if GROUPS[groups[0]].crash == "crash-misuse" else _PATIENCE


def _run(
    groups: Sequence[str],
    unpacked: Unpacked,
    folder: Path,
    environment: Mapping[str, str] | None,
    budget: float,
) -> list[tuple[str, Outcome]]:
    """Run the probes of groups in a process; return the outcomes of those that were begun, of which the last may fail.

    The process runs in `folder`, with the environment of this process if `environment` is None. It is not a sandbox:
    it only protects this process from a crash.
    """
    with tempfile.NamedTemporaryFile(prefix="eightpost_call_") as progress:
        patience = _patience(groups)
        reach = "" if unpacked.reach is None else str(unpacked.reach)
        words = (str(unpacked.folder), progress.name, str(patience), str(budget), reach, *groups)
        command = process.python_command("builder.check.probes", *words)
        ran = process.run(command, _TIMEOUT, folder=folder, environment=environment)
        call = Path(progress.name).read_bytes().partition(b"\0")[0].decode("utf-8", "replace")
    outcomes, hung = _read(ran.output)
    printed = ran.errors.decode("utf-8", "replace").strip().rpartition("\n")[2]
    if not outcomes or ((ran.code or 0) > 0 and not call):
        raise EightpostError(
            f"the probe {groups[0]!r} could not be started, so the FMU was not checked: {printed}; reinstall eightpost"
        )
    group, outcome = outcomes[-1]
    if ran.code == 0 or outcome.completed:
        return outcomes
    how = f"was killed by signal {-(ran.code or 0)}" if (ran.code or 0) < 0 else f"ended with code {ran.code}"
    if hung or ran.code is None:
        how, printed = f"did not end within {hung or f'{_TIMEOUT:g} s'}", ""
    message = f"{how}{f' in or after {call}' if call else ''}{f'; it printed: {printed}' if printed else ''}"
    rule = RULES["free-null"] if FREEING_NOTHING.removeprefix("fmi2") in call else RULES[GROUPS[group].crash]
    crash = rule.finding(f"the process of the probe {group!r} {message}")
    return [*outcomes[:-1], (group, replace(outcome, findings=(*outcome.findings, crash)))]


def _read(output: bytes) -> tuple[list[tuple[str, Outcome]], str]:
    """Read the output of a process, one JSON object per line; return outcomes, and how long a call hung."""
    groups: list[tuple[str, list[dict[str, Any]]]] = []
    for line in output.decode("utf-8", "replace").splitlines():
        try:
            entry = json.loads(line)
        except ValueError:
            continue  # a line cut off by a crash
        if "group" in entry:
            groups.append((entry["group"], []))
        else:
            groups[-1][1].append(entry)
    hung = next((e["hung"] for _, entries in groups for e in entries if "hung" in e), "")
    return [(group, _outcome(entries)) for group, entries in groups], hung


def _outcome(entries: Sequence[dict[str, Any]]) -> Outcome:
    return Outcome(
        tuple(RULES[e["rule"]].finding(e["message"]) for e in entries if "rule" in e),
        tuple((e["skipped"], e["reason"]) for e in entries if "skipped" in e),
        any(e.get("completed") for e in entries),
        next((e["used"] for e in entries if "used" in e), 0.0),
        {e["value"]: e["is"] for e in entries if "value" in e},
    )


# ---- Unusual surroundings: an empty environment, a read-only folder, an unusual path --------------------------------

_ODD = "a path with spaces, ä 100% #1 + äöü"


def trace(unpacked: Unpacked, folder: Path, environment: Mapping[str, str] | None = None) -> Outcome:
    """Run the probe that computes a digest of the outputs, in a working folder."""
    return _run(["surroundings"], unpacked, folder, environment, _TRACE_BUDGET)[0][1]


def surroundings(unpacked: Unpacked, plain: Outcome) -> Outcome:
    """Compare runs in unusual surroundings with a plain one."""
    if not plain.values:
        return plain
    with tempfile.TemporaryDirectory(prefix="eightpost_folder_") as name:
        folder = Path(name)
        bare = folder / "read-only"
        bare.mkdir(mode=0o555)
        needed = {name: os.environ[name] for name in ("SYSTEMROOT",) if name in os.environ}
        shutil.copytree(unpacked.folder, folder / _ODD)
        odd = replace(unpacked, folder=folder / _ODD)
        runs = {"bare-environment": trace(unpacked, bare, needed), "odd-path": trace(odd, folder)}
        found = tuple(finding for rule, run in runs.items() for finding in differences(rule, plain, run))
        return Outcome(found, tuple(dict.fromkeys(part for run in runs.values() for part in run.skipped)))


def differences(rule: str, plain: Outcome, other: Outcome) -> Iterator[Finding]:
    """Compare a run elsewhere with a plain one."""
    fresh = [finding.message for finding in other.findings if finding not in plain.findings]
    if not other.completed or fresh:
        yield RULES[rule].finding("; ".join(fresh))
    elif plain.values and other.values and other.values != plain.values:
        yield RULES[rule].finding("it runs, but the outputs differ")


# ---- Checkers -------------------------------------------------------------------------------------------------------

_SUMMARY = ("This FMU does not validate", "semantic error(s)")


def _tool_findings(subject: CheckedFmu) -> Iterator[Finding]:
    """Apply both checkers to an FMU, and the schemas of the documents that they do not look at."""
    own = [message for message in _fmutool(subject.path) if not any(text in message for text in _SUMMARY)]
    faults = [("fmpy-validate", problem) for problem in _fmpy(subject)] + [("fmutool-check", text) for text in own]
    for member, schema in _SCHEMAS.items():
        if member in subject.members:
            faults += [("schema", f"{member}: {fault}") for fault in _faults(subject.members[member], schema)]
    return findings(faults)


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

_TOOL_TIMEOUT, _TRIAL_TIMEOUT = 120.0, 30.0  # s
_OPTIONS = ("-shared", "-fPIC", "-w", "-ffp-contract=off",
            "-DFMI2_OVERRIDE_FUNCTION_PREFIX", "-DFMI3_OVERRIDE_FUNCTION_PREFIX")  # fmt: skip


def rebuild(subject: CheckedFmu, unpacked: Unpacked, plain: Outcome) -> Outcome:
    """Compile the sources with the C compiler of this machine, and compare a run with that of the FMU's binary."""
    fmu = subject.description
    if fmu is None or not fmu.sources.files:
        return _skipped("no sources are listed")
    if any(f"sources/{name}" not in subject.members for name in fmu.sources.files):
        return _skipped("sources are missing")
    is_c = all(name.endswith(".c") for name in fmu.sources.files)
    names = ("cc", "gcc", "clang") if is_c else ("c++", "g++", "clang++")
    compiler = next(filter(None, map(shutil.which, names)), "")
    if fault := _trial(compiler) if compiler else f"there is no {names[0]}":
        return _skipped(f"the sources could not be compiled here: {fault}")
    with tempfile.TemporaryDirectory(prefix="eightpost_rebuild_") as name:
        folder = Path(name)
        copy = folder / "fmu"
        shutil.copytree(unpacked.folder, copy, ignore=shutil.ignore_patterns("binaries"))
        binary = copy / binary_members(fmu.identifier, fmu.fmi)[0]
        binary.parent.mkdir(parents=True)
        definitions = [f"-D{d.get('name', '')}={d.get('value', '1')}" for d in fmu.sources.definitions]
        includes = ["-I.", *(f"-I{place}" for place in fmu.sources.folders), "-I", str(_headers())]
        command = [compiler, *_OPTIONS, *definitions, *includes, *fmu.sources.files, "-o", str(binary), "-lm"]
        if message := _compile(command, copy / "sources", _TOOL_TIMEOUT):
            return Outcome((RULES["sources-compile"].finding(message),))
        return Outcome(tuple(differences("rebuilt-same", plain, trace(replace(unpacked, folder=copy), folder))))


def _headers() -> Path:
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
        fault = _compile([compiler, "-shared", "-fPIC", "trial.c", "-o", "trial.so"], folder, _TRIAL_TIMEOUT)
    return f"{compiler} does not work ({fault})" if fault else ""


def _compile(command: list[str], folder: Path, patience: float) -> str:
    """Run a command; return the error message, or "" if it succeeded. Its children are ended with it."""
    ran = process.run(command, patience, folder=folder, together=True, tree=True)
    if ran.code is None:
        return f"it did not end within {patience:g} s"
    lines = [line.strip() for line in ran.output.decode("utf-8", "replace").splitlines() if line.strip()]
    faults = [line for line in lines if "error" in line.lower()] + lines[-1:]
    return "" if ran.code == 0 else next(iter(faults), f"it ended with code {ran.code} and printed nothing")


# ==== Check ==========================================================================================================

_IDENTITY = ("fmiVersion", "modelName", "version", "author", "generationTool")
#: Attribute of an FMU's own key by the version of FMI.
_KEYS = {2: "guid", 3: "instantiationToken"}
_AT_ONCE = 2
_LONG = ("reset", "initial_dependencies", "instances")


def run(path: Path, scope: Scope, groups: Collection[str]) -> CheckReport:
    """Check an FMU; see `builder.check.check`.

    Raises:
        FmuError: A group of checks is not known.
    """
    if unknown := sorted(set(groups) - GROUPS.keys()):
        raise FmuError(f"group of checks {unknown[0]!r} is not known; use some of {', '.join(GROUPS)}")
    subject = read_subject(path)
    outcomes = dict(_applied(subject, [group for group in GROUPS if group in groups]))
    done = tuple(group for group, one in outcomes.items() if group in groups and all(what for what, _ in one.skipped))
    skipped = [
        (f"{group}: {what}" if what else group, why) for group, one in outcomes.items() for what, why in one.skipped
    ]
    found = [finding for one in outcomes.values() for finding in one.findings if scope.covers(finding.rule.level)]
    if subject.description is not None and subject.description.fmi == 3:
        found = [finding_in_version_3(finding) for finding in found]
        skipped = [(text_in_version_3(what), text_in_version_3(why)) for what, why in skipped]
    found = sorted(dict.fromkeys(found), key=lambda finding: list(Level).index(finding.rule.level))
    return CheckReport(path, scope, _identity(subject), done, tuple(Skipped(*one) for one in skipped), tuple(found))


def _identity(subject: CheckedFmu) -> dict[str, str]:
    attributes = subject.description.attributes if subject.description else {}
    key = _KEYS[subject.description.fmi] if subject.description else ""
    stated = {name: attributes[name] for name in (*_IDENTITY, key) if name in attributes}
    return {**stated, "sha256": sha256_of(subject.path)}


def _applied(subject: CheckedFmu, groups: list[str]) -> Iterator[tuple[str, Outcome]]:
    """Apply groups of checks; yield their outcomes, one for those together that are skipped for one reason.

    Of those that call the FMU, the simulation is first; it has an outcome of its own if it fails for others.
    """
    if "static" in groups:
        yield "static", Outcome(tuple(static_findings(subject)))
    if "tools" in groups:
        unsafe = _skipped("the archive is not safe to unpack")
        yield "tools", Outcome(tuple(_tool_findings(subject))) if subject.is_safe else unsafe
    description = subject.description
    left_out = ["static", "tools", *(["version_3"] if description and description.fmi == 2 else [])]
    selected = [group for group in groups if group not in left_out]
    if not selected:
        return
    if description is None or (reason := _reason_not_to_call(subject, description)):
        yield ", ".join(selected), _skipped(reason if description else "there is no valid modelDescription.xml")
        return
    with tempfile.TemporaryDirectory(prefix="eightpost_check_") as folder:
        unpacked = Unpacked(Path(folder) / "fmu")
        _unpack(subject, unpacked.folder)
        if description.co_simulation is None:
            plan = [group for group in selected if group in ("model_exchange", "version_3")]
            outcomes, reason = dict(_probed(plan, unpacked, _BUDGET)), "the FMU does not support co-simulation"
        else:
            outcomes, reason = _outcomes(subject, selected, unpacked), "a plain simulation does not work"
    for group in GROUPS:
        if group in outcomes and (group in selected or not outcomes[group].completed):
            yield group, outcomes[group] if group in selected else Outcome(outcomes[group].findings)
    if others := [group for group in selected if group not in outcomes]:
        yield ", ".join(others), _skipped(reason)


def _outcomes(subject: CheckedFmu, selected: list[str], unpacked: Unpacked) -> dict[str, Outcome]:
    """Return the outcomes of groups by name; without others if the simulation does not work.

    Valid calls share a process, so that an FMU is loaded and Python starts once; invalid ones share another.
    """
    apart = [group for group in ("surroundings", "rebuild") if group in selected]
    misuses = [group for group in selected if GROUPS[group].crash == "crash-misuse"]
    shared = [group for group in selected if group not in ("simulation", *apart, *misuses)]
    shared.sort(key=lambda group: group in _LONG)  # what a slow FMU leaves out is what takes long
    outcomes = dict(_probed(["simulation", *(["surroundings"] if apart else []), *shared], unpacked, _BUDGET))
    first, plain = outcomes["simulation"], outcomes.pop("surroundings", Outcome())
    if not first.completed:
        return outcomes
    if REACH in first.values:
        unpacked = replace(unpacked, reach=int(first.values[REACH]))
    with ThreadPoolExecutor(_AT_ONCE) as pool:
        waiting = {}
        if "surroundings" in apart:
            waiting["surroundings"] = pool.submit(surroundings, unpacked, plain)
        if "rebuild" in apart:
            waiting["rebuild"] = pool.submit(rebuild, subject, unpacked, plain)
        outcomes |= dict(_probed(misuses, unpacked, _MISUSE_BUDGET))
        return outcomes | {group: future.result() for group, future in waiting.items()}


def _reason_not_to_call(subject: CheckedFmu, fmu: Description) -> str:
    if not subject.is_safe:
        return "the archive is not safe to unpack"
    if fmu.co_simulation is None and fmu.model_exchange is None:
        return "the FMU supports neither co-simulation nor model exchange"
    if subject.members.keys().isdisjoint(binary_members(fmu.identifier, fmu.fmi)):
        available = [binary.platform for binary in subject.own_binaries]
        available += ["sources"] if fmu.sources.files else []
        here = platform_folders(fmu.fmi)[0]
        return f"no binary for this platform ({here}), so nothing was run; available: {', '.join(available) or 'none'}"
    return ""


def _unpack(subject: CheckedFmu, folder: Path) -> None:
    for name, content in subject.members.items():
        target = folder / name
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_bytes(content)
