"""Runs in unusual surroundings: an empty folder, an empty environment, a read-only folder, an unusual path."""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path

from builder.check.catalogue import behaviour as rules
from builder.check.process import Outcome, Surroundings, Unpacked, run_probe
from builder.check.rules import Finding, Rule, listed

_ODD = "a path with spaces, ä 100% #1 + äöü"


def in_an_empty_folder(group: str, unpacked: Unpacked) -> Outcome:
    """Run a probe in an empty working folder; any file left there by a completed probe is a finding."""
    with tempfile.TemporaryDirectory(prefix="eightpost_folder_") as name:
        folder = Path(name)
        outcome = run_probe(group, unpacked, Surroundings(folder))
        left = sorted(str(path.relative_to(folder)) for path in folder.rglob("*"))
    if not left or not outcome.completed:  # after a crash, the system may write files such as core
        return outcome
    return replace(outcome, findings=(*outcome.findings, rules.FILES.finding(f"it left {listed(left)}")))


def trace(unpacked: Unpacked, folder: Path, environment: Mapping[str, str] | None = None) -> Outcome:
    """Run the probe that computes a digest of the outputs, in a working folder."""
    return run_probe("surroundings", unpacked, Surroundings(folder, environment), module="trace")


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
    yield from _compare(rules.BARE, plain, trace(unpacked, folder, needed))


def _odd(unpacked: Unpacked, plain: Outcome, folder: Path) -> Iterator[Finding]:
    shutil.copytree(unpacked.folder, folder / _ODD)
    yield from _compare(rules.ODD_PATH, plain, trace(replace(unpacked, folder=folder / _ODD), folder))


def _compare(rule: Rule, plain: Outcome, there: Outcome) -> Iterator[Finding]:
    if not there.completed or there.findings:
        yield rule.finding("; ".join(finding.message for finding in there.findings))
    elif there.values != plain.values:
        yield rule.finding("it runs, but the outputs differ")
