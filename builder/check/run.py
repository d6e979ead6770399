"""Execution of a check: first the groups that only read the file, then those that call the FMU."""

from __future__ import annotations

import tempfile
from collections.abc import Collection
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from pathlib import Path

from builder.check.archive import CheckedFmu, read_subject
from builder.check.description import static_findings
from builder.check.probes.bench import REACH
from builder.check.probes.library import binary_members, platform_folders
from builder.check.process import Outcome, Unpacked, probed, surroundings
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
from eightpost.fmi.description import Description

_IDENTITY = ("fmiVersion", "modelName", "version", "author", "generationTool")
#: Attribute of an FMU's own key by the version of FMI.
_KEYS = {2: "guid", 3: "instantiationToken"}
_AT_ONCE = 2
_LONG = ("reset", "initial_dependencies", "instances")


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


def _identity(subject: CheckedFmu) -> dict[str, str]:
    attributes = subject.description.attributes if subject.description else {}
    key = _KEYS[subject.description.fmi] if subject.description else ""
    stated = {name: attributes[name] for name in (*_IDENTITY, key) if name in attributes}
    return {**stated, "sha256": sha256_of(subject.path)}


def _tools(subject: CheckedFmu) -> Outcome:
    if not subject.is_safe:
        return Outcome(skipped=(("", "the archive is not safe to unpack"),))
    return Outcome(tuple(tool_findings(subject)))


def _call(subject: CheckedFmu, groups: list[str], ledger: _Ledger) -> None:
    """Apply the groups that call the FMU: first the simulation, then the others if the simulation works."""
    description = subject.description
    left_out = (
        ("static", "tools", "version_3") if description is not None and description.fmi == 2 else ("static", "tools")
    )
    selected = [group for group in groups if group not in left_out]
    if not selected:
        return
    if description is None or (reason := _reason_not_to_call(subject, description)):
        reason = reason if description else "there is no valid modelDescription.xml"
        ledger.skipped.append(Skipped(", ".join(selected), reason))
        return
    with tempfile.TemporaryDirectory(prefix="eightpost_check_") as folder:
        unpacked = Unpacked(Path(folder) / "fmu")
        _unpack(subject, unpacked.folder)
        if description.co_simulation is None:
            plan = [group for group in selected if group in ("model_exchange", "version_3")]
            outcomes, reason = dict(probed(plan, unpacked)), "the FMU does not support co-simulation"
        else:
            outcomes, reason = _outcomes(subject, selected, unpacked), "a plain simulation does not work"
    for group in GROUPS:
        if group in selected and group in outcomes:
            ledger.enter(group, outcomes[group])
        elif group in outcomes and not outcomes[group].completed:
            ledger.findings += outcomes[group].findings
    if others := [group for group in selected if group not in outcomes]:
        ledger.skipped.append(Skipped(", ".join(others), reason))


def _outcomes(subject: CheckedFmu, selected: list[str], unpacked: Unpacked) -> dict[str, Outcome]:
    """Return the outcomes of groups by name; without others if the simulation does not work.

    Valid calls share a process, so that an FMU is loaded and Python starts once; invalid ones share another.
    """
    apart = [group for group in ("surroundings", "rebuild") if group in selected]
    misuses = [group for group in selected if GROUPS[group].crash == "crash-misuse"]
    shared = [group for group in selected if group not in ("simulation", *apart, *misuses)]
    shared.sort(key=lambda group: group in _LONG)  # what a slow FMU leaves out is what takes long
    outcomes = dict(probed(["simulation", *(["surroundings"] if apart else []), *shared], unpacked))
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
        outcomes |= dict(probed(misuses, unpacked))
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
