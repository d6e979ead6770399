"""Execution of probes in separate processes: a crash or a hang is a finding that names the last FMI call."""

from __future__ import annotations

import json
import os
import shutil
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from builder.check.probes.library import FREEING_NOTHING
from builder.check.rules import GROUPS, RULES, Finding, Rule, listed
from eightpost.errors import EightpostError
from eightpost.workers.process import python_command, run

#: Longest processor time of a valid and of an invalid call, and that of all groups; time for a process [s].
_PATIENCE, _MISUSE_PATIENCE, _BUDGET, _TIMEOUT = 6.0, 0.7, 8.0, 900.0
_LEAST = 1.0  # s of processor time with which another process begins


@dataclass(frozen=True)
class Outcome:
    """The result of a group of checks."""

    findings: tuple[Finding, ...] = ()  #: Findings.
    #: Pairs of a skipped part and the reason; an empty part stands for the whole group.
    skipped: tuple[tuple[str, str], ...] = ()
    completed: bool = True  #: Whether the group finished.
    used: float = 0.0  #: Processor time of the process, if it was ended because groups take too long [s].
    values: Mapping[str, str] = field(default_factory=dict)  #: Measured values by name.


@dataclass(frozen=True)
class Unpacked:
    """An unpacked FMU, and the number of steps after which it ends the simulation itself (None if it does not)."""

    folder: Path
    reach: int | None = None


def probed(groups: Sequence[str], unpacked: Unpacked) -> Iterator[tuple[str, Outcome]]:
    """Run the probes of groups in a process with empty folders; yield the outcome of each that was begun.

    After a crash, the groups that are left run in another process, except after a crash of `simulation`. Files left in
    the working folder or in that of temporary files are findings.

    Raises:
        EightpostError: A process ended before it loaded the FMU.
    """
    remaining, budget = list(groups), _BUDGET
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
        if budget < _LEAST:
            skipped = Outcome(skipped=(("", "it would take too much processor time"),))
            yield from ((group, skipped) for group in remaining)
            return
        if last == "simulation" and not outcome.completed:
            return


def _run(
    groups: Sequence[str],
    unpacked: Unpacked,
    folder: Path,
    environment: Mapping[str, str] | None = None,
    budget: float = _BUDGET,
) -> list[tuple[str, Outcome]]:
    """Run the probes of groups in a process; return the outcomes of those that were begun, of which the last may fail.

    The process runs in `folder`, with the environment of this process if `environment` is None. It is not a sandbox:
    it only protects this process from a crash.
    """
    with tempfile.NamedTemporaryFile(prefix="eightpost_call_") as progress:
        patience = _MISUSE_PATIENCE if GROUPS[groups[0]].crash == "crash-misuse" else _PATIENCE
        reach = "" if unpacked.reach is None else str(unpacked.reach)
        words = (str(unpacked.folder), progress.name, str(patience), str(budget), reach, *groups)
        ran = run(python_command("builder.check.probes", *words), _TIMEOUT, folder=folder, environment=environment)
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
    return _run(["surroundings"], unpacked, folder, environment)[0][1]


def surroundings(unpacked: Unpacked, plain: Outcome) -> Outcome:
    """Compare runs in unusual surroundings with a plain one."""
    if not plain.completed:
        return plain
    with tempfile.TemporaryDirectory(prefix="eightpost_folder_") as name:
        folder = Path(name)
        bare = folder / "read-only"
        bare.mkdir(mode=0o555)
        needed = {name: os.environ[name] for name in ("SYSTEMROOT",) if name in os.environ}
        shutil.copytree(unpacked.folder, folder / _ODD)
        odd = replace(unpacked, folder=folder / _ODD)
        return Outcome(
            (
                *differences(RULES["bare-environment"], plain, trace(unpacked, bare, needed)),
                *differences(RULES["odd-path"], plain, trace(odd, folder)),
            )
        )


def differences(rule: Rule, plain: Outcome, other: Outcome) -> Iterator[Finding]:
    """Compare a run elsewhere with a plain one."""
    if not other.completed or other.findings:
        yield rule.finding("; ".join(finding.message for finding in other.findings))
    elif other.values != plain.values:
        yield rule.finding("it runs, but the outputs differ")
