"""Execution of a check: first the groups that only read the file, then those that call the FMU."""

from __future__ import annotations

import tempfile
from collections.abc import Collection, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from pathlib import Path

from builder.check.archive import Subject, read_subject
from builder.check.description import static_findings
from builder.check.probes.bench import REACH
from builder.check.probes.library import binary_members, platform_folders
from builder.check.process import Outcome, Unpacked, in_an_empty_folder, surroundings
from builder.check.rules import (
    GROUPS,
    CheckReport,
    Finding,
    Level,
    Scope,
    Skipped,
    finding_in_version_3,
    text_in_version_3,
)
from builder.check.tools import rebuild, tool_findings
from eightpost.errors import FmuError
from eightpost.files import sha256_of

_IDENTITY = ("fmiVersion", "modelName", "version", "author", "generationTool")
#: Attribute of an FMU's own key by the version of FMI.
_KEYS = {2: "guid", 3: "instantiationToken"}
_AT_ONCE = 2


@dataclass
class _Ledger:
    """Groups, skipped checks and findings of a check so far."""

    groups: list[str] = field(default_factory=list)
    skipped: list[Skipped] = field(default_factory=list)
    findings: list[Finding] = field(default_factory=list)

    def enter(self, group: str, outcome: Outcome) -> None:
        """Add the outcome of a group."""
        self.findings += outcome.findings
        self.skipped += [Skipped(f"{group}: {what}" if what else group, reason) for what, reason in outcome.skipped]
        if not any(not what for what, _ in outcome.skipped):
            self.groups.append(group)


def run(path: Path, scope: Scope, groups: Collection[str]) -> CheckReport:
    """Check an FMU; see `builder.check.check`.

    Raises:
        FmuError: A group of checks is not known.
    """
    if unknown := sorted(set(groups) - GROUPS.keys()):
        raise FmuError(f"group of checks {unknown[0]!r} is not known; use some of {', '.join(GROUPS)}")
    subject = read_subject(path)
    ledger = _Ledger()
    if "static" in groups:
        ledger.enter("static", Outcome(tuple(static_findings(subject))))
    if "tools" in groups:
        ledger.enter("tools", _tools(subject))
    _call(subject, [group for group in GROUPS if group in groups], ledger)
    findings = [finding for finding in dict.fromkeys(ledger.findings) if scope.covers(finding.rule.level)]
    if subject.description is not None and subject.description.fmi == 3:
        findings = [finding_in_version_3(finding) for finding in findings]
        ledger.skipped = [
            Skipped(text_in_version_3(item.what), text_in_version_3(item.reason)) for item in ledger.skipped
        ]
    order = list(Level)
    findings.sort(key=lambda finding: order.index(finding.rule.level))
    return CheckReport(path, scope, _identity(subject), tuple(ledger.groups), tuple(ledger.skipped), tuple(findings))


def _identity(subject: Subject) -> dict[str, str]:
    attributes = subject.description.attributes if subject.description else {}
    key = _KEYS[subject.description.fmi] if subject.description else ""
    stated = {name: attributes[name] for name in (*_IDENTITY, key) if name in attributes}
    return {**stated, "sha256": sha256_of(subject.path)}


def _tools(subject: Subject) -> Outcome:
    if not subject.is_safe:
        return Outcome(skipped=(("", "the archive is not safe to unpack"),))
    return Outcome(tuple(tool_findings(subject)))


def _call(subject: Subject, groups: list[str], ledger: _Ledger) -> None:
    """Apply the groups that call the FMU: first the simulation, then the others if the simulation works."""
    version_2 = subject.description is not None and subject.description.fmi == 2
    selected = [group for group in groups if group not in ("static", "tools", *(["version_3"] if version_2 else []))]
    if not selected:
        return
    if reason := _reason_not_to_call(subject):
        ledger.skipped.append(Skipped(", ".join(selected), reason))
        return
    with tempfile.TemporaryDirectory(prefix="eightpost_check_") as folder:
        unpacked = Unpacked(Path(folder) / "fmu")
        _unpack(subject, unpacked.folder)
        if subject.description is not None and subject.description.co_simulation is None:
            _call_model_exchange(selected, unpacked, ledger)
            return
        first = in_an_empty_folder("simulation", unpacked)
        if "simulation" in selected:
            ledger.enter("simulation", first)
        others = [group for group in selected if group != "simulation"]
        if not first.completed:
            ledger.findings += [f for f in first.findings if "simulation" not in selected]
            ledger.skipped += [Skipped(", ".join(others), "a plain simulation does not work")] if others else []
            return
        if REACH in first.values:
            unpacked = replace(unpacked, reach=int(first.values[REACH]))
        for group, outcome in _outcomes(subject, others, unpacked):
            ledger.enter(group, outcome)


def _call_model_exchange(selected: list[str], unpacked: Unpacked, ledger: _Ledger) -> None:
    """Apply the groups for model exchange to an FMU that offers nothing else."""
    for group in ("model_exchange", "version_3"):
        if group in selected:
            ledger.enter(group, in_an_empty_folder(group, unpacked))
    if others := [group for group in selected if group not in ("model_exchange", "version_3")]:
        ledger.skipped.append(Skipped(", ".join(others), "the FMU does not support co-simulation"))


def _outcomes(subject: Subject, groups: list[str], unpacked: Unpacked) -> Iterator[tuple[str, Outcome]]:
    def outcome(group: str) -> Outcome:
        if group == "rebuild":
            return rebuild(subject, unpacked)
        return surroundings(unpacked) if group == "surroundings" else in_an_empty_folder(group, unpacked)

    with ThreadPoolExecutor(_AT_ONCE) as pool:
        yield from zip(groups, pool.map(outcome, groups), strict=True)


def _reason_not_to_call(subject: Subject) -> str:
    if not subject.is_safe:
        return "the archive is not safe to unpack"
    if subject.description is None:
        return "there is no valid modelDescription.xml"
    if subject.description.co_simulation is None and subject.description.model_exchange is None:
        return "the FMU supports neither co-simulation nor model exchange"
    if subject.members.keys().isdisjoint(binary_members(subject.description.identifier, subject.description.fmi)):
        available = [binary.platform for binary in subject.own_binaries]
        available += ["sources"] if subject.description.sources.files else []
        here = platform_folders(subject.description.fmi)[0]
        return f"no binary for this platform ({here}), so nothing was run; available: {', '.join(available) or 'none'}"
    return ""


def _unpack(subject: Subject, folder: Path) -> None:
    for name, content in subject.members.items():
        target = folder / name
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_bytes(content)
