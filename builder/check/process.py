"""A probe in a process of its own: a crash or a hang there is a finding that names the last call begun."""

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
    """What a group of checks came to: findings, and (what, why) for what was skipped, "" meaning all of it.

    `completed` is whether it came to its end, `stopped` whether a call that had to succeed did not; `values` are what
    it measured, by name.
    """

    findings: tuple[Finding, ...] = ()
    skipped: tuple[tuple[str, str], ...] = ()
    completed: bool = True
    stopped: bool = False
    values: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Surroundings:
    """Working folder and environment of a probe's process; an environment of None is that of this process."""

    folder: Path
    environment: Mapping[str, str] | None = None


@dataclass(frozen=True)
class Unpacked:
    """An unpacked FMU, and the number of steps after which it ends a simulation by itself (None where it does not)."""

    folder: Path
    reach: int | None = None


def run_probe(group: str, unpacked: Unpacked, surroundings: Surroundings, *, module: str = "") -> Outcome:
    """Run a probe on an unpacked FMU; `module` where it is not that of the group.

    The probe is no sandbox: a process of its own keeps a crash from this one, and nothing else.

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
            said = _read(error.stdout or b"")
            return _failed(group, said, f"did not end within {patience:g} s{_last_call(progress.name)}")
        said = _read(ran.stdout)
        if said.completed or said.stopped:
            return said
        if ran.returncode > 0 and not _last_call(progress.name):
            raise _not_started(group, ran.stderr)
        how = f"was killed by signal {-ran.returncode}" if ran.returncode < 0 else f"ended with code {ran.returncode}"
        last = ran.stderr.decode("utf-8", "replace").strip().splitlines()[-1:]
        return _failed(group, said, f"{how}{_last_call(progress.name)}{f'; it said: {last[0]}' if last else ''}")


def _not_started(group: str, printed: bytes) -> EightpostError:
    """Return the error of a probe that ended before it loaded the FMU: the FMU has no part in it."""
    text = printed.decode("utf-8", "replace").strip()
    return EightpostError(
        f"the probe {group!r} could not be started, so the FMU was not checked: {text.rpartition(chr(10))[2]}; "
        "install eightpost again"
    )


def _failed(group: str, said: Outcome, message: str) -> Outcome:
    rule = FREE_NULL if FREEING_NOTHING in message else GROUPS[group].crash
    crash = rule.finding(f"the process of the probe {group!r} {message}")
    return Outcome((*said.findings, crash), said.skipped, completed=False, values=said.values)


def _last_call(progress: str) -> str:
    call = Path(progress).read_bytes().partition(b"\0")[0].decode("utf-8", "replace")
    return f" in or after {call}" if call else ""


def _read(output: bytes) -> Outcome:
    """Read the lines of a probe: one JSON object each, the last one says that it came to its end."""
    findings, skipped, values, ends = [], [], {}, set()
    for line in output.decode("utf-8", "replace").splitlines():
        try:
            said = json.loads(line)
        except ValueError:
            continue  # a line cut off by a crash
        if "rule" in said:
            findings.append(Finding(_RULES[said["rule"]], said["message"]))
        elif "skipped" in said:
            skipped.append((said["skipped"], said["reason"]))
        elif "value" in said:
            values[said["value"]] = said["is"]
        ends |= said.keys() & {"completed", "stopped"}
    return Outcome(tuple(findings), tuple(skipped), "completed" in ends, "stopped" in ends, values)
