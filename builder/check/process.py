"""Execution of a probe in a separate process: a crash or a hang is a finding that names the last FMI call."""

from __future__ import annotations

import json
import subprocess
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from builder.check.catalogue import CATALOGUE
from builder.check.catalogue.behaviour import CRASH_MISUSE, FREE_NULL
from builder.check.groups import GROUPS
from builder.check.probes.library import FREEING_NOTHING
from builder.check.rules import Finding
from eightpost.errors import EightpostError
from eightpost.interpreter import python_command

_TIMEOUT, _MISUSE_TIMEOUT = 120.0, 30.0  # s
_RULES = {rule.identifier: rule for rule in CATALOGUE}


@dataclass(frozen=True)
class Outcome:
    """The result of a group of checks.

    Attributes:
        findings: Findings.
        skipped: Pairs of a skipped part and the reason; an empty part stands for the whole group.
        completed: Whether the group finished.
        stopped: Whether a call failed that had to succeed.
        values: Measured values by name.
    """

    findings: tuple[Finding, ...] = ()
    skipped: tuple[tuple[str, str], ...] = ()
    completed: bool = True
    stopped: bool = False
    values: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Surroundings:
    """Working folder and environment of a probe's process; None keeps the environment of this process."""

    folder: Path
    environment: Mapping[str, str] | None = None


@dataclass(frozen=True)
class Unpacked:
    """An unpacked FMU, and the number of steps after which it ends the simulation itself (None if it does not)."""

    folder: Path
    reach: int | None = None


def run_probe(group: str, unpacked: Unpacked, surroundings: Surroundings, *, module: str = "") -> Outcome:
    """Run a probe on an unpacked FMU; `module` replaces the module of the group.

    The process is not a sandbox: it only protects this process from a crash.

    Raises:
        EightpostError: The probe ended before it loaded the FMU.
    """
    with tempfile.NamedTemporaryFile(prefix="eightpost_call_") as progress:
        name = module or GROUPS[group].module
        reach = [] if unpacked.reach is None else [str(unpacked.reach)]
        command = python_command("builder.check.probes", name, str(unpacked.folder), progress.name, *reach)
        patience = _MISUSE_TIMEOUT if GROUPS[group].crash is CRASH_MISUSE else _TIMEOUT
        try:
            ran = subprocess.run(
                command,
                capture_output=True,
                timeout=patience,
                check=False,
                cwd=surroundings.folder,
                env=None if surroundings.environment is None else dict(surroundings.environment),
            )
        except subprocess.TimeoutExpired as error:
            outcome = _read(error.stdout or b"")
            return _failed(group, outcome, f"did not end within {patience:g} s{_last_call(progress.name)}")
        outcome = _read(ran.stdout)
        if outcome.completed or outcome.stopped:
            return outcome
        if ran.returncode > 0 and not _last_call(progress.name):
            raise _not_started(group, ran.stderr)
        how = f"was killed by signal {-ran.returncode}" if ran.returncode < 0 else f"ended with code {ran.returncode}"
        last = ran.stderr.decode("utf-8", "replace").strip().splitlines()[-1:]
        return _failed(group, outcome, f"{how}{_last_call(progress.name)}{f'; it printed: {last[0]}' if last else ''}")


def _not_started(group: str, printed: bytes) -> EightpostError:
    """Return the error for a probe that ended before it loaded the FMU, so that the FMU is not the cause."""
    text = printed.decode("utf-8", "replace").strip()
    return EightpostError(
        f"the probe {group!r} could not be started, so the FMU was not checked: {text.rpartition(chr(10))[2]}; "
        "reinstall eightpost"
    )


def _failed(group: str, outcome: Outcome, message: str) -> Outcome:
    rule = FREE_NULL if FREEING_NOTHING in message else GROUPS[group].crash
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
            findings.append(Finding(_RULES[entry["rule"]], entry["message"]))
        elif "skipped" in entry:
            skipped.append((entry["skipped"], entry["reason"]))
        elif "value" in entry:
            values[entry["value"]] = entry["is"]
        ends |= entry.keys() & {"completed", "stopped"}
    return Outcome(tuple(findings), tuple(skipped), "completed" in ends, "stopped" in ends, values)
