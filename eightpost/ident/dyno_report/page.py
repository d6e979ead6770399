"""Page of a report: its verdict, tables and figures in one HTML file."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from operator import sub
from pathlib import Path

import numpy as np
from markupsafe import Markup

from eightpost.ident.dyno_report.builds import (
    BuildVariant,
    CarCorner,
    DynoReport,
    deviation_of,
    heat_effect,
    mean_force,
    repeated_runs,
)
from eightpost.ident.dyno_report.cycles import STROKES, Cycles, Found, Stroke, Unknown, mean_of, of_known
from eightpost.ident.dyno_report.entry import Entry
from eightpost.ident.dyno_report.figures import branches_figure, curves_figure, loops_figure
from eightpost.ident.dyno_report.loop import BEND, Branches, ratio_at
from eightpost.report.page import Block, Section, digest, document, soft, write_page
from eightpost.report.tables import NONE, Amount, Cell, ResultTable, cell_html, plain, unit_html
from eightpost.verdict import Reason, Rules, Verdict

# ==== Verdict: the findings about the records, and the verdicts of the shock files ===================================

RULES = Rules.read(Path(__file__).with_suffix(".txt"))


def report_verdict(entries: Iterable[Entry]) -> Verdict:
    """Return the verdict of a report; the origin of each reason begins with the name of its entry."""
    return Verdict(reason for entry in entries for reason in _reasons(entry))


def _reasons(entry: Entry) -> Iterator[Reason]:
    if entry.kind == "table":
        yield RULES.reason(
            "table without time", "the file is a peak-velocity table", figure="no time", origin=entry.name
        )
    elif entry.test is not None:
        yield from (replace(reason, origin=entry.name) for reason in entry.test.reasons)
        if not entry.test.reasons:
            yield RULES.reason("plausible record", "the record is plausible", figure="no finding", origin=entry.name)
    elif entry.shock is not None and entry.shock.validity is None:
        yield RULES.reason(
            "shock without verdict", "the shock file states no verdict", figure="no validity", origin=entry.name
        )
    elif entry.shock is not None and entry.shock.validity is not None:
        for reason in entry.shock.validity.verdict.reasons:
            yield replace(reason, origin=f"shock {entry.name}")


# ==== Tables; an unknown figure is a dash with the number of its reason below the table ==============================

Row = Sequence[Cell | Found | None]

BASES = ("measured", "law")
_USUAL = {"basis": "measured", "kind": "run"}  #: Columns that are left out if all rows have the usual text.
SAME_SPEED = 0.1  #: Peaks of both strokes belong together if their speeds agree within this share.


def explained(title: str, columns: Sequence[str | Amount], rows: Iterable[Row], unit: str = "N") -> list[Block]:
    """Return a table without its empty columns and the reasons below it; nothing if there is no row.

    A column without any figure is left out; one line names it with its reason. A column may be a speed, of figures in
    a unit.
    """
    rows = [tuple(row) for row in rows]
    empty = [
        k for k in range(len(columns)) if all(row[k] in (None, NONE) or isinstance(row[k], Unknown) for row in rows)
    ]
    same = [k for k in range(len(columns)) if all(row[k] == _USUAL.get(str(columns[k])) for row in rows)]
    kept = [k for k in range(len(columns)) if k not in (*empty, *same)]
    if not rows or not kept:
        return []
    reasons: dict[str, int] = {}

    def shown(value: Cell | Found | None) -> Cell | float | None:
        if not isinstance(value, Unknown):
            return value
        return f"{NONE}\N{NO-BREAK SPACE}[{reasons.setdefault(value.reason, len(reasons) + 1)}]"

    cells = [[shown(row[k]) for k in kept] for row in rows]
    names = [f"at [{unit}]" if isinstance(column, Amount) else column for column in columns]
    table = ResultTable.of(title, [names[k] for k in kept], cells)
    heads = [
        (Markup("{} {}").format(cell_html(speed), unit_html(speed.unit)), head[1])
        if isinstance(speed, Amount)
        else head
        for head, speed in zip(table.heads, (columns[k] for k in kept), strict=True)
    ]
    causes: dict[str, list[str]] = {}
    for k in empty:
        for reason in dict.fromkeys(cell.reason for row in rows if isinstance(cell := row[k], Unknown)):
            causes.setdefault(reason, []).append(names[k].partition(" [")[0])
    lines = [f"[{number}] {reason}." for reason, number in reasons.items()]
    lines += [f"Not known: {', '.join(found)}; {reason}." for reason, found in causes.items()]
    return [replace(table, heads=tuple(heads)), *([tuple(lines)] if lines else [])]


def _at_speeds(
    report: DynoReport,
    heads: Sequence[str],
    rows: Iterable[tuple[Sequence[Cell], Sequence[Found | Cell]]],
    *,
    title: str = "",
    unit: str = "N",
) -> list[Block]:
    """Return a table with a column for each speed; figures at speeds that a curve does not reach are dashes."""
    columns: list[str | Amount] = [*heads, *(Amount(speed, "m/s") for speed in report.speeds)]
    shown = ((*texts, *(None if isinstance(v, Unknown) else v for v in found)) for texts, found in rows)
    return explained(title, columns, shown, unit)


def _labelled(report: DynoReport) -> Iterator[tuple[BuildVariant, Entry]]:
    return ((variant, entry) for variant in report.variants for entry in variant.entries)


# ---- Forces ---------------------------------------------------------------------------------------------------------


def force_table(report: DynoReport) -> list[Block]:
    """Return the forces of every build at the report's speeds, and the ratio of rebound to compression."""
    rows: list[tuple[Sequence[Cell], Sequence[Found | Cell]]] = []
    for variant in report.variants:
        for basis in BASES:
            if entries := variant.representatives(basis):
                label = (*_fitted(report, variant), variant.label, basis)
                rows += [
                    ((*label, stroke), [mean_force(entries, v, stroke) for v in report.speeds]) for stroke in STROKES
                ]
                ratios = [mean_of(ratio_at(entry.curve, speed) for entry in entries) for speed in report.speeds]
                rows.append(((*label, "reb/comp"), [of_known(lambda r: Amount(r, "1"), ratio) for ratio in ratios]))
    corner = ("corner",) if report.fitted_to else ()
    return _at_speeds(report, (*corner, "build", "basis", "stroke"), rows)


def _fitted(report: DynoReport, variant: BuildVariant) -> tuple[str, ...]:
    if not report.fitted_to:
        return ()
    names = [name for name, build in report.fitted_to.items() if build in (variant.label, variant.build)]
    return (", ".join(names) or NONE,)


def difference_table(report: DynoReport) -> list[Block]:
    """Return the forces of every build relative to the first one: means of measured curves, and of laws."""
    rows: list[tuple[Sequence[Cell], Sequence[Found | Cell]]] = []
    for variant in report.variants[1:]:
        for basis in BASES:
            ours, base = variant.representatives(basis), report.variants[0].representatives(basis)
            for stroke in STROKES if ours and base else ():
                pairs = [(mean_force(ours, v, stroke), mean_force(base, v, stroke)) for v in report.speeds]
                rows.append(((variant.label, basis, stroke), [_with_share(of_known(sub, a, b), b) for a, b in pairs]))
    return _at_speeds(report, ("build", "basis", "stroke"), rows)


def _with_share(value: Found, whole: Found) -> Found | Cell:
    """Return a force and its share of another one, as a cell."""
    if isinstance(value, Unknown) or isinstance(whole, Unknown) or whole == 0.0:
        return value
    share = plain(100.0 * value / abs(whole), 2).replace("-", "−")
    return Markup("{} ({}\N{NO-BREAK SPACE}%)").format(cell_html(Amount(value, "N")), share)


def limit_table(report: DynoReport) -> list[Block]:
    """Return whether each run and table is within the limits, at the speed at which it is farthest from the master."""
    rows = [
        ("pass" if one.passed else Markup('<strong class="fail">FAIL</strong>'), one.entry.name, one.stroke,
         str(one.count), one.speed, one.force, one.master, one.deviation, one.tolerance)
        for one in report.judgements
    ]  # fmt: skip
    columns = ("result", "entry", "stroke", "speeds", "farthest at [m/s]", "force [N]", "master [N]", "deviation [N]",
               "tolerance [N]")  # fmt: skip
    return explained("", columns, rows)


def repeat_table(report: DynoReport) -> list[Block]:
    """Return the standard deviation of the forces of repeated runs."""
    rows: list[tuple[Sequence[Cell], Sequence[Found | Cell]]] = []
    for variant in report.variants:
        for group in repeated_runs(variant):
            for stroke in STROKES:
                found = [
                    _with_share(deviation_of(group, v, stroke), mean_force(group, v, stroke)) for v in report.speeds
                ]
                rows.append(((variant.label, str(len(group)), stroke), found))
    return _at_speeds(report, ("build", "runs", "stroke"), rows)


def _track_table(report: DynoReport) -> list[Block]:
    """Return the share of time of each track that the shaft spends in each stroke below the report's speeds."""
    rows: list[tuple[Sequence[Cell], Sequence[Found | Cell]]] = []
    for name, velocity in report.track.items():
        for stroke, sign in zip(STROKES, (1.0, -1.0), strict=True):
            speed = sign * velocity[sign * velocity > 0.0]
            rows.append(((name, stroke), [100.0 * float(np.mean(speed <= v)) for v in report.speeds]))
    return _at_speeds(report, ("track", "time in the stroke below"), rows, unit="%")


# ---- Knees and damping ----------------------------------------------------------------------------------------------


def _knee_table(report: DynoReport) -> list[Block]:
    """Return knees and slopes of every entry."""
    rows = [
        (entry.name, entry.title, stroke, one.knee, one.knee_force, one.low, one.high, one.highest or None)
        for _, entry in _labelled(report) for stroke, one in entry.strokes.items()
    ]  # fmt: skip
    columns = ("entry", "kind", "stroke", "knee at [m/s]", "force there [N]", "slope below [N.s/m]",
               "slope above [N.s/m]", "highest speed [m/s]")  # fmt: skip
    return explained("", columns, rows)


def damping_tables(report: DynoReport) -> list[Block]:
    """Return the damping ratio of every build at every corner: below and above the knee, and of both strokes."""
    rows = []
    for corner in report.corners:
        for variant in report.variants:
            if report.fitted_to.get(corner.name) in (None, variant.label, variant.build):
                rows += [(corner.name, entry.name, entry.title, *_ratios(corner, entry)) for entry in variant.entries]
    columns = ("corner", "entry", "kind", "comp. below knee [%]", "reb. below knee [%]", "mean below knee [%]",
               "comp. above knee [%]", "reb. above knee [%]", "mean above knee [%]")  # fmt: skip
    corners = [(corner.name, corner.mass, corner.wheel_rate, corner.motion_ratio) for corner in report.corners]
    heads = ("corner", "sprung mass [kg]", "wheel rate [N/m]", "motion ratio")
    return [*explained("", heads, corners), *explained("", columns, rows)]


def _ratios(corner: CarCorner, entry: Entry) -> Iterator[Found]:
    """Yield the damping ratios [%] of compression, rebound and their mean, below and then above the knee."""
    for side in ("low", "high"):
        rates: list[Found] = [getattr(entry.strokes[stroke], side) for stroke in STROKES]
        for rate in (*rates, of_known(lambda *both: mean_of(both), *rates)):
            yield of_known(lambda ratio: 100.0 * ratio, corner.damping_ratio(rate))


# ---- Runs -----------------------------------------------------------------------------------------------------------


def _run_table(report: DynoReport) -> list[Block]:
    """Return conditions and motion of the runs and tables, and the temperature and power of the runs."""
    rows: list[Row] = []
    for variant, entry in _labelled(report):
        test, cycles, warming = entry.test, entry.cycles, entry.warming
        build = None if entry.name == variant.label else variant.label
        setting = entry.setting
        first = (entry.name, build, entry.title, setting.clicks, setting.gas_pressure, entry.highest or None)
        if test is not None and isinstance(cycles, Cycles):
            heats = (of_known(_celsius, warming.start), of_known(_kelvin, warming.drift))
            rows.append((*first, test.stroke, cycles.frequency, str(cycles.count), *heats, warming.power))
        elif entry.kind == "table":
            rows.append((*first, *(None,) * 6))
    columns = ("entry", "build", "kind", "clicks", "gas pressure [Pa]", "highest speed [m/s]", "stroke [m]",
               "frequency [Hz]", "cycles", "temperature", "warming", "mean power [W]")  # fmt: skip
    return explained("", columns, rows)


def _celsius(temperature: float) -> Markup:
    celsius = temperature - 273.15
    return _both(f"{1.8 * celsius + 32.0:.0f} °F", f"{celsius:.1f} °C")


def _kelvin(drift: float) -> Markup:
    return _both(*(text.replace("-", "−") for text in (f"{1.8 * drift:+.1f} °F", f"{drift:+.2f} K")))


def _both(us: str, si: str) -> Markup:
    return Markup('<span class="us">{}</span><span class="si">{}</span>').format(us, si)


def loop_table(report: DynoReport) -> list[Block]:
    """Return energy, width and lag of the loops, gas force, gas stiffness and friction."""
    rows = []
    for _, entry in _labelled(report):
        cycles, slow, percent = entry.cycles, entry.slow, entry.shock.fit.get("percent") if entry.shock else None
        loop: tuple[Found | None, ...] = (None, None, None)
        if isinstance(cycles, Cycles):
            loop = (cycles.energy, cycles.energy_scatter, cycles.width)
        rows.append((entry.name, entry.title, *loop, entry.offset if entry.kind == "run" else None,
                     of_known(lambda lag: 1e3 * lag, entry.lag), slow.gas_force, slow.stiffness, slow.friction,
                     float(percent) if isinstance(percent, int | float) else None))  # fmt: skip
    columns = ("entry", "kind", "energy per cycle [J]", "its deviation [J]", "width at v = 0 [N]", "force at v = 0 [N]",
               "lag (ms)", "gas force [N]", "gas stiffness [N/m]", "friction [N]", "fit error [%] .2")  # fmt: skip
    return explained("", columns, rows)


def branch_table(report: DynoReport) -> list[Block]:
    """Return the forces on the open and the closed branch of the loop of every run."""
    rows = [
        ((entry.name, stroke), [_branch_cell(entry.branches, v, stroke) for v in report.speeds])
        for entry in report.runs if entry.branches is not None for stroke in STROKES
    ]  # fmt: skip
    return _at_speeds(report, ("run", "stroke"), rows, title="Branches of the loop (CVP), open / closed")


def _branch_cell(branches: Branches, speed: float, stroke: Stroke) -> Found | Cell:
    def cell(*forces: float) -> Markup:
        return Markup(" / ").join(cell_html(Amount(force, "N")) for force in forces)

    return of_known(cell, *(branches.force_at(speed, stroke, branch) for branch in ("open", "closed")))


def peak_table(report: DynoReport) -> list[Block]:
    """Return the forces at the centre of the stroke (PVP) of the runs, with their scatter from cycle to cycle."""
    rows: list[Row] = []
    for entry in report.runs:
        level = 0.0 if isinstance(entry.level, Unknown) else entry.level
        compression, rebound = (
            entry.cycles.peaks(sign) if isinstance(entry.cycles, Cycles) else () for sign in (1.0, -1.0)
        )
        for down in rebound:
            up = next((one for one in compression if abs(one.speed / down.speed - 1.0) <= SAME_SPEED), None)
            force = down.force + level
            above = (None,) * 3 if up is None else (up.speed, up.force - level, up.scatter)
            ratio = None if up is None else force / (up.force - level)
            rows.append((entry.name, *above, down.speed, force, down.scatter, ratio, str(down.count)))
    columns = ("run", "compression at [m/s]", "force [N]", "deviation [N] .2", "rebound at [m/s]", "force [N]",
               "deviation [N] .2", "reb/comp", "peaks")  # fmt: skip
    return explained("Peaks at the centre of the stroke (PVP)", columns, rows)


def _file_table(report: DynoReport) -> list[Block]:
    """Return the files of the entries, with their full names and digests."""
    rows = [
        (entry.name, None if entry.source and entry.setting.build == entry.source.stem else entry.setting.build,
         entry.source.name if entry.source else None, digest(entry.sha256) if entry.sha256 else None)
        for entry in report.entries
    ]  # fmt: skip
    return explained("Files", ("entry", "build", "file", "SHA-256"), rows)


# ==== The page =======================================================================================================

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
        curves_figure(report), *force_table(report), *_track_table(report)
    ])  # fmt: skip
    if report.limits is not None:
        none: list[Block] = [soft("No run or table reaches a speed of the master curve.")]
        heading = f"Limits: {report.limits.name}"
        yield Section("limits", heading, limit_table(report) or none)
    if len(report.variants) > 1:
        none = [soft("No build has a curve of the same kind as the first: one is measured, one a law.")]
        heading = f"Differences from {report.variants[0].label}"
        yield Section("differences", heading, difference_table(report) or none)
    if report.runs:
        yield Section("branches", "Branches and peaks", [
            branches_figure(report), *peak_table(report), *branch_table(report)
        ])  # fmt: skip
    yield Section("knees", "Knees and slopes", _knee_table(report))
    if report.corners:
        yield Section("damping", "Damping ratio", damping_tables(report))
    loops: list[Block] = [loops_figure(report)] if report.runs else []
    yield Section("runs", "Runs, loops and gas", [*loops, *_run_table(report), *loop_table(report)])
    lines = tuple(f"{one.label}: {effect}." for one in report.variants if (effect := heat_effect(one)))
    if repeats := [*repeat_table(report), *([lines] if lines else [])]:
        yield Section("repeatability", "Repeatability", repeats)
    yield Section("notes", "Notes", [*_notes(report), *_file_table(report), _DEFINITIONS])


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
