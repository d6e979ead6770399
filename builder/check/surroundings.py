"""Runs elsewhere: in an empty folder, with nothing in the environment, in a read-only folder, from an odd path."""

from __future__ import annotations

import os
import shutil
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

from builder.check.catalogue import behaviour as rules
from builder.check.process import Outcome, Surroundings, run_probe
from builder.check.rules import Finding, Rule, listed

_ODD = "a path with spaces, ä 100% #1 + äöü"


def in_an_empty_folder(group: str, unpacked: Path) -> Outcome:
    """Run a probe in an empty working folder; what is there when it came to its end is a finding."""
    with tempfile.TemporaryDirectory(prefix="eightpost_folder_") as name:
        folder = Path(name)
        outcome = run_probe(group, unpacked, surroundings=Surroundings(folder, {**os.environ, **_only_python()}))
        left = sorted(str(path.relative_to(folder)) for path in folder.rglob("*"))
    if not left or not outcome.completed:  # a crash leaves what the system writes, as core
        return outcome
    return replace(outcome, findings=(*outcome.findings, rules.FILES.finding(f"it left {listed(left)}")))


def surroundings(unpacked: Path) -> Outcome:
    """Compare runs in unusual surroundings with a plain one."""
    plain = run_probe("surroundings", unpacked, module="trace")
    if not plain.completed:
        return plain
    return Outcome((*_bare(unpacked, plain), *_odd(unpacked, plain)))


def _bare(unpacked: Path, plain: Outcome) -> Iterator[Finding]:
    with tempfile.TemporaryDirectory() as folder:
        Path(folder).chmod(0o555)
        yield from _compare(rules.BARE, plain, unpacked, Surroundings(Path(folder), _only_python()))


def _only_python() -> dict[str, str]:
    """What the interpreter of the probe itself needs, and nothing else."""
    needed = {"PYTHONPATH": os.pathsep.join(path or str(Path.cwd()) for path in sys.path)}
    return needed | {name: os.environ[name] for name in ("SYSTEMROOT",) if name in os.environ}


def _odd(unpacked: Path, plain: Outcome) -> Iterator[Finding]:
    with tempfile.TemporaryDirectory() as folder:
        elsewhere = Path(folder) / _ODD
        shutil.copytree(unpacked, elsewhere)
        yield from _compare(rules.ODD_PATH, plain, elsewhere, Surroundings())


def _compare(rule: Rule, plain: Outcome, unpacked: Path, where: Surroundings) -> Iterator[Finding]:
    there = run_probe("surroundings", unpacked, surroundings=where, module="trace")
    if not there.completed or there.findings:
        yield rule.finding("; ".join(finding.message for finding in there.findings))
    elif there.values != plain.values:
        yield rule.finding("it runs, with other outputs")
