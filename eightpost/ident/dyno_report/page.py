"""Page of a report: its sections in one HTML file, for the screen and for print."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from markupsafe import Markup

from eightpost.ident.dyno_report import figures, tables
from eightpost.ident.dyno_report.builds import DynoReport
from eightpost.ident.dyno_report.curve import BEND
from eightpost.ident.dyno_report.verdict import report_verdict
from eightpost.report.page import Block, Section, document, soft, write_page
from eightpost.report.tables import ResultTable

_SIGNS = (
    "Velocity, displacement and force are positive in compression. Forces in tables are magnitudes without the gas."
)
#: How the figures are made.
_DEFINITIONS = (
    "Mean curve: mean of both branches of the loop in classes of speed, without the lag and the gas spring with which "
    "the branches agree best. Without the force at zero velocity (mean of both ends of the stroke, in a random motion "
    "extrapolated to zero acceleration), or the gas force of a slow run of the same build, clicks and gas pressure.",
    "A build's figures are means over its fastest entries (90 % of the highest speed or more).",
    "Knee: two lines that meet are fitted to the mean curve of a stroke. There is no knee if the slopes differ by less "
    f"than {100.0 * BEND:.0f} %, or if two lines are not clearly better than one; both slopes are those of one line.",
    "Damping ratio c r² / (2 √(k m)): damping rate c at the damper, motion ratio r, wheel rate k and sprung mass m of "
    "the corner; the tire is rigid. The rates are the slopes below and above the knee.",
    "Energy: integral of force times velocity over a cycle. Width: force at zero velocity at the compressed end minus "
    "that at the extended end.",
    "Gas force and friction: from parts slower than 10 mm/s and 0.05 m/s²; of a table see the notes, of a law the "
    "fit's estimates. A negative gas force means a load cell zeroed with the gas force on it, or reversed signs.",
    "Repeated runs have the same build, clicks and gas pressure, and standard deviations of velocity within 5 %.",
)


def write_report(path: str | Path, report: DynoReport, *, title: str = "Dynamometer report") -> Path:
    """Write a report as one HTML page; an existing file is replaced only when the new one is complete.

    Args:
        path: File to write.
        report: Content.
        title: Heading of the page.

    Returns:
        Path of the written file.
    """
    lead = Markup("{}. {}{}").format(_count(report), _result(report), _SIGNS)
    verdict, sections = report_verdict(report.entries), list(sections_of(report))
    return write_page(path, document(title, verdict, sections, lead=lead, fold=0))


def _result(report: DynoReport) -> Markup:
    """Return whether the curves are within the limits, as a sentence; nothing without limits."""
    if report.limits is None:
        return Markup("")
    failed = sorted({one.entry.name for one in report.judgements if not one.passed})
    text = f"FAIL ({', '.join(failed)})" if failed else "pass" if report.judgements else "not judged"
    return Markup('<strong class="{}">Limits: {}.</strong> ').format("pass" if text == "pass" else "fail", text)


def _count(report: DynoReport) -> str:
    parts = [(len(report.variants), "build"), (len(report.runs), "run")]
    parts += [(sum(e.kind == kind for e in report.entries), kind) for kind in ("table", "law")]
    return ", ".join(f"{count} {word}{'' if count == 1 else 's'}" for count, word in parts if count)


def sections_of(report: DynoReport) -> Iterator[Section]:
    """Yield the sections of a report; sections without content are left out."""
    yield Section("curves", "Force over velocity", [
        figures.curves_figure(report), *tables.force_table(report), *tables.track_table(report)
    ])  # fmt: skip
    if report.limits is not None:
        none: list[Block] = [soft("No run or table reaches a speed of the master curve.")]
        heading = f"Limits: {report.limits.name}"
        yield Section("limits", heading, tables.limit_table(report) or none)
    if len(report.variants) > 1:
        none = [soft("No build has a curve of the same kind as the first: one is measured, one a law.")]
        heading = f"Differences from {report.variants[0].label}"
        yield Section("differences", heading, tables.difference_table(report) or none)
    if report.runs:
        yield Section("branches", "Branches and peaks", [
            figures.branches_figure(report), *tables.peak_table(report), *tables.branch_table(report)
        ])  # fmt: skip
    yield Section("knees", "Knees and slopes", tables.knee_table(report))
    if report.corners:
        yield Section("damping", "Damping ratio", tables.damping_tables(report))
    loops: list[Block] = [figures.loops_figure(report)] if report.runs else []
    yield Section("runs", "Runs, loops and gas", [*loops, *tables.run_table(report), *tables.loop_table(report)])
    if repeats := [*tables.repeat_table(report), *([lines] if (lines := tables.heat_lines(report)) else [])]:
        yield Section("repeatability", "Repeatability", repeats)
    yield Section("notes", "Notes", [*_notes(report), *tables.file_table(report), _DEFINITIONS])


def _notes(report: DynoReport) -> list[Block]:
    notes: dict[str, list[str]] = {}
    for entry in report.entries:
        for note in entry.notes:
            notes.setdefault(note, []).append(entry.name)
    reasons = [
        (reason.grade.value, f"{reason.statement}: {reason.figure}", reason.origin, reason.remedy)
        for reason in report_verdict(report.entries).reasons if reason.grade.value != "usable"
    ]  # fmt: skip
    lines = tuple(f"{', '.join(names)}: {note}" for note, names in notes.items())
    findings: list[Block] = [ResultTable.of("", ("grade", "finding", "entries", "to do"), reasons)] if reasons else []
    return [*findings, *([lines] if lines else [])]
