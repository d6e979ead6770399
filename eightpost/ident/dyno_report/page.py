"""Page of a report: its sections in one HTML file, for the screen and for print."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from eightpost.ident.dyno_report import plots, tables
from eightpost.ident.dyno_report.builds import DynoReport
from eightpost.ident.dyno_report.comparison import repeated_runs
from eightpost.ident.dyno_report.velocity_curve import BEND
from eightpost.ident.dyno_report.verdict import report_verdict
from eightpost.report.numbers import Display
from eightpost.report.page import Block, Section, digest, document, soft, write_page
from eightpost.report.tables import NONE, ResultTable

_SIGNS = (
    "Velocity, displacement and force are positive in compression. Forces in tables are magnitudes without the gas."
)
#: Number of findings at the top of the page; the section of findings has all.
_OPEN = 4

_LOOPS = (
    "Energy: integral of force times velocity over a cycle. Width: force at zero velocity at the compressed end minus "
    "that at the extended end; lag, friction and gas stiffness contribute to it. Lag: delay of force behind velocity, "
    "gas and friction excluded; it includes the filter of the load cell."
)
_CURVES = (
    "Measured curves are means of both branches of the loop in 40 classes of speed, after the force is advanced by its "
    "lag; gas stiffness and hysteresis cancel. The force at zero velocity (gas, and the zero of the load cell) is the "
    "mean of both ends of the stroke, in a random motion extrapolated to zero acceleration; it is subtracted. "
    "If there is a slow run of the same build, clicks and gas pressure, its gas force and stiffness are subtracted "
    "from fast runs instead; the notes name it."
)
_FASTEST = (
    "A build's figures are means over its fastest entries (90 % of the highest speed or more), because slopes depend "
    "on the range of speed; gas force, friction and energy are means over the runs that show them."
)
_KNEES = (
    "Two lines that meet at the knee are fitted to the mean curve of a stroke by least squares. There is no knee if "
    f"the slopes differ by less than {100.0 * BEND:.0f} %, or if two lines are not clearly better than one; then both "
    "slopes are that of one line."
)
_GAS = (
    "Runs: in parts slower than 10 mm/s and 0.05 m/s2, and in holds, F = gas force + stiffness (x - middle of the "
    "stroke) + friction sign(v) + rate v is fitted by least squares. Tables: see the notes. Laws: the fit's estimates. "
    "A negative gas force means that the load cell was zeroed with the gas force on it, or that the signs are reversed."
)
_DAMPING = (
    "Damping ratio c r² / (2 √(k m)) with the damping rate c at the damper, motion ratio r, wheel rate k and sprung "
    "mass m of the corner; the tire is rigid. The rates are the slopes below and above the knee."
)
_REPEATS = (
    "Runs repeat each other if build, clicks and gas pressure are the same and the standard deviations of their "
    "velocities agree within 5 %."
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
    lead = f"{_count(report)}. {_SIGNS}"
    verdict, sections = report_verdict(report.entries), list(sections_of(report))
    return write_page(path, document(title, verdict, sections, lead=lead, fold=_OPEN))


def _count(report: DynoReport) -> str:
    parts = [(len(report.variants), "build"), (len(report.runs), "run")]
    parts += [
        (sum(e.kind == kind for e in report.entries), word) for kind, word in (("table", "table"), ("law", "law"))
    ]
    listed = [f"{count} {word}{'' if count == 1 else 's'}" for count, word in parts if count]
    return ", ".join(listed)


def sections_of(report: DynoReport) -> Iterator[Section]:
    """Yield the sections of a report; sections without content are left out."""
    middle = report.speeds[len(report.speeds) // 2]
    inch = Display.of("m/s")
    at = f"Forces and ratio at {middle:.3g} m/s ({inch(middle):.3g} {inch.unit}). {_FASTEST}"
    yield Section("overview", "Overview", [
        plots.overview_figure(report), *tables.overview_table(report), soft(at), *tables.entry_table(report)
    ])  # fmt: skip
    yield Section("curves", "Force over velocity", [
        plots.curves_figure(report), soft(_CURVES), *tables.force_table(report), *tables.peak_table(report)
    ])  # fmt: skip
    yield Section("knees", "Knees and slopes", [soft(_KNEES), *tables.knee_table(report)])
    yield Section("damping", "Damping ratio", _damping(report))
    if len(report.variants) > 1:
        blocks = [*tables.difference_table(report), *tables.slope_differences(report)]
        none: list[Block] = [
            soft("No build has a curve of the same kind as the reference: one is measured, one a law.")
        ]
        heading = f"Differences from {report.reference.label}"
        yield Section("differences", heading, blocks or none)
    if report.runs:
        yield Section("loops", "Loops, energy and lag", [
            plots.runs_figure(report), soft(_LOOPS), *tables.loop_table(report), *tables.lag_table(report)
        ])  # fmt: skip
    elif lags := tables.lag_table(report):
        yield Section("loops", "Lag", lags)
    yield Section("gas", "Gas force and friction", [soft(_GAS), *tables.gas_table(report)])
    if report.runs:
        yield Section("warming", "Energy and warming", _warming(report))
        yield Section("repeatability", "Repeatability", _repeatability(report))
        yield Section("runs", "Every run", list(plots.run_figures(report)))
    yield Section("notes", "Findings and notes", _notes(report))
    yield Section("files", "Files", [_files(report)])


def _damping(report: DynoReport) -> list[Block]:
    if not report.corners:
        return [soft("Unknown: no corner of a car is given; add --corner-mass and --wheel-rate, or --car.")]
    return [soft(_DAMPING), *tables.corner_table(report), *tables.damping_tables(report)]


def _warming(report: DynoReport) -> list[Block]:
    figure = plots.temperature_figure(report)
    lines = tables.heat_lines(report) or (
        "The effect of temperature on force is unknown: no build has repeated runs whose temperatures differ by 1 K or "
        "more.",
    )
    return [*([figure] if figure else []), *tables.warming_table(report), lines]


def _repeatability(report: DynoReport) -> list[Block]:
    single = [variant.label for variant in report.variants if variant.of_kind("run") and not repeated_runs(variant)]
    unknown = (f"Unknown for {', '.join(single)}: no two runs of the build have the same motion.",) if single else ()
    return [soft(_REPEATS), *tables.repeat_table(report), *([unknown] if unknown else [])]


def _notes(report: DynoReport) -> list[Block]:
    rows = [(entry.name, note) for entry in report.entries for note in entry.notes]
    reasons = [
        (reason.grade.value, reason.about, f"{reason.statement}: {reason.figure}", reason.origin, reason.remedy)
        for reason in report_verdict(report.entries).reasons
    ]
    return [
        ResultTable.of("Findings", ("grade", "about", "finding", "entries", "to do"), reasons),
        ResultTable.of("Notes", ("entry", "note"), rows) if rows else soft("There are no notes on files."),
    ]


def _files(report: DynoReport) -> ResultTable:
    rows = [
        (entry.name, entry.setting.build, entry.source.name if entry.source else NONE, digest(entry.sha256 or NONE))
        for entry in report.entries
    ]
    return ResultTable.of("", ("entry", "build", "file", "SHA-256"), rows)
