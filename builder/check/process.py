"""Execution of a probe in a separate process: a crash or a hang is a finding that names the last FMI call."""

from __future__ import annotations

import json
import os
import shutil
import tempfile
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

from builder.check.probes.library import FREEING_NOTHING
from builder.check.rules import GROUPS, RULES, Finding, Rule, listed
from eightpost.errors import EightpostError
from eightpost.workers.process import python_command, run

_TIMEOUT, _MISUSE_TIMEOUT = 120.0, 30.0  # s


@dataclass(frozen=True)
class Outcome:
    """The result of a group of checks."""

    findings: tuple[Finding, ...] = ()  #: Findings.
    #: Pairs of a skipped part and the reason; an empty part stands for the whole group.
    skipped: tuple[tuple[str, str], ...] = ()
    completed: bool = True  #: Whether the group finished.
    stopped: bool = False  #: Whether a call failed that had to succeed.
    values: Mapping[str, str] = field(default_factory=dict)  #: Measured values by name.


@dataclass(frozen=True)
class Unpacked:
    """An unpacked FMU, and the number of steps after which it ends the simulation itself (None if it does not)."""

    folder: Path
    reach: int | None = None


def _run_probe(
    group: str, unpacked: Unpacked, folder: Path, environment: Mapping[str, str] | None = None, *, probe: str = ""
) -> Outcome:
    """Run the probe of a group on an unpacked FMU; `probe` is another one to run in its place.

    The process runs in `folder`, with the environment of this process if `environment` is None. It is not a sandbox:
    it only protects this process from a crash.

    Raises:
        EightpostError: The probe ended before it loaded the FMU.
    """
    with tempfile.NamedTemporaryFile(prefix="eightpost_call_") as progress:
        name = probe or f"{GROUPS[group].module}.probe_{group}"
        reach = [] if unpacked.reach is None else [str(unpacked.reach)]
        command = python_command("builder.check.probes", name, str(unpacked.folder), progress.name, *reach)
        patience = _MISUSE_TIMEOUT if GROUPS[group].crash == "crash-misuse" else _TIMEOUT
        ran = run(command, patience, folder=folder, environment=environment)
        outcome, code = _read(ran.output), ran.code
        if code is None:
            return _failed(group, outcome, f"did not end within {patience:g} s{_last_call(progress.name)}")
        if outcome.completed or outcome.stopped:
            return outcome
        if code > 0 and not _last_call(progress.name):
            raise _not_started(group, ran.errors)
        how = f"was killed by signal {-code}" if code < 0 else f"ended with code {code}"
        last = ran.errors.decode("utf-8", "replace").strip().splitlines()[-1:]
        return _failed(group, outcome, f"{how}{_last_call(progress.name)}{f'; it printed: {last[0]}' if last else ''}")


def _not_started(group: str, printed: bytes) -> EightpostError:
    """Return the error for a probe that ended before it loaded the FMU, so that the FMU is not the cause."""
    text = printed.decode("utf-8", "replace").strip()
    return EightpostError(
        f"the probe {group!r} could not be started, so the FMU was not checked: {text.rpartition(chr(10))[2]}; "
        "reinstall eightpost"
    )


def _failed(group: str, outcome: Outcome, message: str) -> Outcome:
    rule = RULES["free-null"] if FREEING_NOTHING.removeprefix("fmi2") in message else RULES[GROUPS[group].crash]
    crash = rule.finding(f"the process of the probe {group!r} {message}")
    return Outcome((*outcome.findings, crash), outcome.skipped, completed=False, values=outcome.values)


def _last_call(progress: str) -> str:
    call = Path(progress).read_bytes().partition(b"\0")[0].decode("utf-8", "replace")
    return f" in or after {call}" if call else ""


def _read(output: bytes) -> Outcome:
    """Read the output of a probe: one JSON object per line; the last line states that the probe finished."""
    findings, skipped, values, ends = [], [], {}, set()
    for line in output.decode("utf-8", "replace").splitlines():
        try:
            entry = json.loads(line)
        except ValueError:
            continue  # a line cut off by a crash
        if "rule" in entry:
            findings.append(Finding(RULES[entry["rule"]], entry["message"]))
        elif "skipped" in entry:
            skipped.append((entry["skipped"], entry["reason"]))
        elif "value" in entry:
            values[entry["value"]] = entry["is"]
        ends |= entry.keys() & {"completed", "stopped"}
    return Outcome(tuple(findings), tuple(skipped), "completed" in ends, "stopped" in ends, values)


# ---- Unusual surroundings: an empty folder, an empty environment, a read-only folder, an unusual path ---------------

_ODD = "a path with spaces, ä 100% #1 + äöü"


def in_an_empty_folder(group: str, unpacked: Unpacked) -> Outcome:
    """Run a probe in an empty working folder; any file left there by a completed probe is a finding."""
    with tempfile.TemporaryDirectory(prefix="eightpost_folder_") as name:
        folder = Path(name)
        outcome = _run_probe(group, unpacked, folder)
        left = sorted(str(path.relative_to(folder)) for path in folder.rglob("*"))
    if not left or not outcome.completed:  # after a crash, the system may write files such as core
        return outcome
    return replace(outcome, findings=(*outcome.findings, RULES["working-folder"].finding(f"it left {listed(left)}")))


def trace(unpacked: Unpacked, folder: Path, environment: Mapping[str, str] | None = None) -> Outcome:
    """Run the probe that computes a digest of the outputs, in a working folder."""
    return _run_probe("surroundings", unpacked, folder, environment, probe="simulation.probe_trace")


def surroundings(unpacked: Unpacked) -> Outcome:
    """Compare runs in unusual surroundings with a plain one."""
    with tempfile.TemporaryDirectory(prefix="eightpost_folder_") as name:
        folder = Path(name)
        plain = trace(unpacked, folder)
        if not plain.completed:
            return plain
        return Outcome((*_bare(unpacked, plain, folder / "read-only"), *_odd(unpacked, plain, folder)))


def _bare(unpacked: Unpacked, plain: Outcome, folder: Path) -> Iterator[Finding]:
    folder.mkdir(mode=0o555)
    needed = {name: os.environ[name] for name in ("SYSTEMROOT",) if name in os.environ}
    yield from _compare(RULES["bare-environment"], plain, trace(unpacked, folder, needed))


def _odd(unpacked: Unpacked, plain: Outcome, folder: Path) -> Iterator[Finding]:
    shutil.copytree(unpacked.folder, folder / _ODD)
    yield from _compare(RULES["odd-path"], plain, trace(replace(unpacked, folder=folder / _ODD), folder))


def _compare(rule: Rule, plain: Outcome, there: Outcome) -> Iterator[Finding]:
    if not there.completed or there.findings:
        yield rule.finding("; ".join(finding.message for finding in there.findings))
    elif there.values != plain.values:
        yield rule.finding("it runs, but the outputs differ")
