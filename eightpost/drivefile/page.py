"""Page of a drive file iteration: its verdict, errors by pass and frequency, conditioning, gains, signals, limits."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from eightpost.array_types import Complex
from eightpost.drivefile.folder import IterationFolder
from eightpost.drivefile.iteration import PATIENCE, REJECTED, Outcome, Pass, Problem, Status
from eightpost.drivefile.target import EDGES, PassErrors
from eightpost.report.charts import COLORS, MEASURED, Axis, Figure, grid_figure
from eightpost.report.page import Block, Section, digest, document, write_page
from eightpost.report.tables import Cell, ResultTable
from eightpost.verdict import Reason, Rules, Verdict

# ==== Verdict ========================================================================================================

ABOUT = "drive file"
_MEAN = 0.5  #: Error of a mean displacement, relative to the RMS of the displacement, above which it is reported [1].

RULES = Rules.read(Path(__file__).with_suffix(".txt"), ABOUT, patience=PATIENCE, rejected=REJECTED, mean=100.0 * _MEAN)


_OF_STATUS = {
    Status.CONVERGED: ("target reproduced", "the rig reproduces the target"),
    Status.RUNNING: ("not finished", "the target is not reproduced yet"),
    Status.STALLED: ("no progress", "the target is not reproduced, and the error no longer decreases"),
    Status.DIVERGED: ("divergence", "the iteration diverged"),
}


def _reasons(problem: Problem, outcome: Outcome, hits: Sequence[str]) -> Iterator[Reason]:
    """Yield the reasons on an iteration; `hits` are sentences on limits that changed the drive of the best pass."""
    (rule, statement), number = _OF_STATUS[outcome.status], outcome.best + 1
    place = f"best pass {number} of {len(outcome.errors)}" if number else f"{len(outcome.errors)} passes"
    figure = _error_summary(outcome.errors[outcome.best]) if number else "no pass is better than a rig at rest"
    yield RULES.reason(rule, statement, figure, origin=place)
    for hit in dict.fromkeys((*hits, *map(str, outcome.hits))):
        yield RULES.reason("limit of an actuator", "the drive is limited", figure=hit, origin="drive file")
    if number and problem.settings.has_means:
        means = outcome.errors[outcome.best].means
        for name, unit in zip(problem.target.names, problem.target.units, strict=True):
            if unit == "m" and abs(means[name]) > _MEAN:
                figure = f"{name} {100.0 * means[name]:+.0f} % of its RMS; limit {100.0 * _MEAN:g} %"
                yield RULES.reason("mean displacement", "a mean displacement is not reproduced", figure, origin=place)


def _error_summary(errors: PassErrors) -> str:
    """Return the error of each quantity and the worst channel as a phrase."""
    quantities = dict.fromkeys(name.rpartition(".")[2] for name in errors.channels)
    parts = [f"{q.replace('_', ' ')} {100.0 * (errors.of_quantity(q) or 0.0):.2f} %" for q in quantities]
    name, value = errors.worst
    return f"{', '.join(parts)}; worst {name} {100.0 * value:.2f} %"


# ==== The page =======================================================================================================

_SHOWN = 3.0  #: Time that a time plot shows around the largest error [s].

_PERCENT = "% of the target's RMS"
_ERRORS = (
    "Errors are the RMS of measured minus target between the fades, up to the highest frequency, relative to the RMS "
    "of the target without its mean. Two runs of one drive file also differ: below that level, passes differ by chance."
)
_CONDITION = (
    "Condition: ratio of the largest to the smallest singular value of the response, scaled by the amplitudes of the "
    "target and typical commands. Directions: number of independent combinations of channels that the regularised "
    "inverse drives. Above the bandwidth of the aeroloaders, only the wheelloaders move the car."
)


def write_iteration_page(folder: IterationFolder) -> Path:
    """Write report.html into the folder of an iteration, and return its path."""
    outcome = folder.outcome()
    sections = list(_sections(folder, outcome))
    title = f"Drive file iteration {folder.path.resolve().name}"
    return write_page(folder.path / "report.html", document(title, verdict_of(folder), sections, lead=_ERRORS))


def verdict_of(folder: IterationFolder) -> Verdict:
    """Return the verdict on the iteration in a folder, with the limits that changed its best drive."""
    outcome = folder.outcome()
    reasons = _reasons(folder.problem, outcome, folder.limit_hits(outcome.best + 1))
    return Verdict([*reasons, *folder.edits.reasons])


def _sections(folder: IterationFolder, outcome: Outcome) -> Iterator[Section]:
    problem, passes = folder.problem, folder.passes()
    blocks: list[Block] = ["No pass has a record."]
    if passes:
        blocks = [error_table(problem, outcome), _pass_figure(problem, outcome)]
    yield Section("passes", "Errors by pass", blocks)
    if passes:
        last = len(outcome.errors) - 1
        shown = sorted({0, min(1, last), last // 2, last, *([outcome.best] if outcome.best >= 0 else [])})
        spectra: list[Block] = [_band_table(problem, outcome), _spectrum_figure(problem, passes, shown)]
        yield Section("spectra", "Errors by frequency", spectra)
        yield Section("time", "Time signals", [_time_figure(problem, outcome, passes)])
    response: list[Block] = [_CONDITION, _response_figure(problem, outcome), _reach_table(problem, outcome)]
    yield Section("response", "Response and gains", response, folded=True)
    number = outcome.best + 1 if outcome.best >= 0 else folder.waiting
    yield Section("drive", "Drive", _drive_blocks(folder, number, outcome), folded=True)
    sources = [(name, digest(one)) for name, one in folder.sources.items()]
    files: list[Block] = [ResultTable.of("", ("file", "SHA-256"), sources), tuple(problem.start.notes)]
    yield Section("sources", "Sources", files, folded=True)


# ---- Tables ---------------------------------------------------------------------------------------------------------


def error_table(problem: Problem, outcome: Outcome) -> ResultTable:
    """Return the errors of each pass [%]: the quantities, all channels together, and the worst channel."""
    quantities = dict.fromkeys(name.rpartition(".")[2] for name in problem.target.names)
    heads = ["pass", *(f"{q.replace('_', ' ')} [%]" for q in quantities), "all [%]", "worst [%]", "means [%]", ""]
    rows: list[list[Cell | float | None]] = []
    for k, errors in enumerate(outcome.errors):
        of_quantities = [100.0 * (errors.of_quantity(q) or 0.0) for q in quantities]
        mean = 100.0 * max(abs(value) for value in errors.means.values())
        mark = "best" if k == outcome.best else ""
        rows.append([str(k + 1), *of_quantities, 100.0 * errors.total, 100.0 * errors.worst[1], mean, mark])
    return ResultTable.of("", heads, rows)


def _band_table(problem: Problem, outcome: Outcome) -> ResultTable:
    """Return the errors of the best pass (or the last one) in bands [%]."""
    errors = outcome.errors[outcome.best]
    high = problem.target.high
    edges = [edge for edge in EDGES if edge < high]
    heads = [f"{low:g} to {up:g} Hz [%]" for low, up in zip(edges, [*edges[1:], high], strict=True)]
    rows: list[list[Cell | float | None]] = []
    for name in problem.target.names:
        bands = [100.0 * share for share in errors.bands[name][: len(edges)]]
        rows.append([name, *bands, 100.0 * errors.peaks[name], 100.0 * errors.beyond[name]])
    title = f"Pass {(outcome.best % len(outcome.errors)) + 1}: errors by band, of the RMS of the whole target"
    return ResultTable.of(title, ["channel", *heads, "largest, of the peak [%]", f"above {high:g} Hz [%]"], rows)


def _reach_table(problem: Problem, outcome: Outcome) -> ResultTable:
    rows = zip(problem.target.names, 100.0 * outcome.unreachable, strict=True)
    title = "Part of the target that the regularised inverse leaves in one step; later passes reduce it"
    return ResultTable.of(title, ["channel", "RMS [%]"], [(name, float(value)) for name, value in rows])


def _drive_blocks(folder: IterationFolder, number: int | None, outcome: Outcome) -> list[Block]:
    problem = folder.problem
    blocks: list[Block] = []
    if number is not None:
        drive = folder.drive(number)
        rate = problem.target.rate
        rows = [
            (name, unit, f"{float(np.abs(row).max()):.4g}", f"{float(np.abs(np.diff(row)).max() * rate):.4g}")
            for name, unit, row in zip(problem.inputs, problem.units, drive, strict=True)
        ]
        title = f"Largest commands of pass {number}, SI"
        blocks.append(ResultTable.of(title, ["input", "SI unit", "largest value", "largest change per second"], rows))
    hits = (*(folder.limit_hits(number) if number else ()), *map(str, outcome.hits))
    blocks.append(tuple(dict.fromkeys(hits)) or "No limit of an actuator changed the drive.")
    return blocks


# ---- Figures --------------------------------------------------------------------------------------------------------


def _pass_figure(problem: Problem, outcome: Outcome) -> Figure:
    caption = "Errors by pass. Dotted: accepted errors."
    figure = grid_figure(caption, 320, [(Axis("pass"), Axis(_PERCENT, kind="log"), "")], 1, gap=(0.0, 0.0))
    numbers = np.arange(1.0, len(outcome.errors) + 1.0)
    firsts = {name.rpartition(".")[2]: name for name in problem.target.names}
    for color, (quantity, name) in zip(COLORS, firsts.items(), strict=False):
        values = np.array([100.0 * (errors.of_quantity(quantity) or 0.0) for errors in outcome.errors])
        figure.marks(0, numbers, values, name=quantity.replace("_", " "), color=color)
        figure.level(0, 100.0 * problem.accepted(name))
    return figure


def _spectrum_figure(problem: Problem, passes: Sequence[Pass], shown: Sequence[int]) -> Figure:
    target = problem.target
    panels = [(Axis("Hz"), Axis("%", kind="log"), name) for name in target.names]
    height = 110 + 205 * -(-len(panels) // 4)
    caption = "Target and errors in bands of 1 Hz, in % of the target's RMS."
    figure = grid_figure(caption, height, panels, min(4, len(panels)), gap=(0.06, 0.12))
    size = np.linalg.norm(problem.wanted, axis=0)
    every = max(1, target.lines.frequency.size // 400)
    frequency = target.lines.frequency[::every]

    def draw(spectrum: Complex, name: str, color: str) -> None:
        density = np.sqrt(target.lines.band_mean(np.abs(spectrum) ** 2, 1.0) / target.lines.spacing)
        for k in range(len(target.names)):
            figure.line(k, frequency, 100.0 * density[::every, k] / size[k], name=name, color=color)

    draw(problem.wanted, "target", MEASURED)
    for color, k in zip(COLORS, shown, strict=False):
        moving, _ = target.without_means(passes[k].record)
        draw(target.lines.spectrum(target.error_window * (moving - target.rows)), f"error of pass {k + 1}", color)
    return figure


def _time_figure(problem: Problem, outcome: Outcome, passes: Sequence[Pass]) -> Figure:
    """Return target and best pass around the largest error of the worst channel of each quantity."""
    target, k = problem.target, outcome.best
    errors = outcome.errors[k]
    quantities = dict.fromkeys(name.rpartition(".")[2] for name in target.names)
    worst = [max((n for n in target.names if n.endswith(q)), key=errors.channels.__getitem__) for q in quantities]
    panels = [(Axis("time [s]"), Axis(name, target.units[target.names.index(name)]), "") for name in worst]
    number = (k % len(outcome.errors)) + 1
    caption = f"Worst channels of pass {number} around their largest errors, up to {target.high:g} Hz, without means."
    figure = grid_figure(caption, 90 + 210 * len(panels), panels, 1, gap=(0.0, 0.14))
    wanted = target.lines.rows(problem.wanted)
    measured = target.lines.rows(target.lines.spectrum(target.without_means(passes[k].record)[0]))
    for panel, name in enumerate(worst):
        row = target.names.index(name)
        error, half = np.abs(measured[row] - wanted[row]), round(0.5 * _SHOWN * target.rate)
        centre = target.judged.start + int(np.argmax(error[target.judged]))
        part = slice(max(centre - half, 0), centre + half)
        figure.line(panel, target.time[part], wanted[row, part], name="target", color=MEASURED)
        figure.line(panel, target.time[part], measured[row, part], name=f"pass {number}", color=COLORS[0])
    return figure


def _response_figure(problem: Problem, outcome: Outcome) -> Figure:
    lines = problem.target.lines
    panels = [(Axis("Hz"), Axis("condition", kind="log"), ""), (Axis("Hz"), Axis("directions"), ""),
              (Axis("Hz"), Axis("gain", span=(0.0, 1.05)), "")]  # fmt: skip
    caption = "Conditioning of the corrected response, directions that are driven, and gains of the next update."
    figure = grid_figure(caption, 300, panels, 3, gap=(0.07, 0.0))
    every = max(1, lines.frequency.size // 600)
    frequency = lines.frequency[::every]
    figure.line(0, frequency, outcome.inverse.condition[::every], name="", color=COLORS[0])
    figure.line(1, frequency, outcome.inverse.rank[::every], name="", color=COLORS[0])
    for k, name in enumerate(problem.target.names):
        color = COLORS[k % len(COLORS)]
        figure.line(2, frequency, outcome.gains[::every, k], name=name, color=color)
    return figure
