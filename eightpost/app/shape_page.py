"""Page and JSON file of target curves."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from eightpost.app.shape_search import VERIFIED, Aim
from eightpost.app.shape_target import Target
from eightpost.files import atomic_path
from eightpost.report.charts import COLORS, MEASURED, Axis, Figure, grid_figure
from eightpost.report.page import Block, Section, document, write_page
from eightpost.report.tables import Amount, Cell, ResultTable
from eightpost.shock.shape import unit_of
from eightpost.verdict import Grade, Rules, Verdict

SCHEMA = 1

# ---- Verdict --------------------------------------------------------------------------------------------------------

ABOUT = "targets"

#: Largest difference between the optimiser's objective and that of the verifying run, as a share of the objective [1].
AGREEMENT = 1e-3

RULES = Rules()

GAIN = RULES.add("targets better than the bank", ABOUT, Grade.LIMITED,
    condition="the runs of the targets' own FMUs are better than the best setup of the bank",
    why="the gain is that of the model: errors of the car and of the form of the law are not in it",
    remedy="build the nearest valving, test it (eightpost dyno or a dynamometer), fit it, and run it in a study",
)  # fmt: skip
NO_GAIN = RULES.add("no gain over the bank", ABOUT, Grade.NOT_USABLE,
    condition="the runs of the targets' own FMUs are not better than the best setup of the bank",
    why="the search found nothing better within the ranges of the numbers",
    remedy="widen the ranges (--limit), vary more numbers (--vary), or use more starts (--starts)",
)  # fmt: skip
DIFFERS = RULES.add("verification differs", ABOUT, Grade.NOT_USABLE,
    condition=f"the objective of the verifying run differs by more than {100.0 * AGREEMENT:g} %",
    why="the FMU that the search used does not behave as the FMU that was built from the target",
    remedy="report this with the files in the folder shapes/",
)  # fmt: skip


def aim_verdict(found: Aim) -> Verdict:
    """Return the verdict on target curves."""
    best, targets = found.verified_objective(0), found.verified_objective(1)
    origin = f"{found.runs} trials; verified by runs of their own FMUs"
    gain = f"{best:.5g} with the best of the bank, {targets:.5g} with the targets"
    reasons = [(GAIN if targets < best else NO_GAIN).reason("the objective", figure=gain, origin=origin)]
    apart = targets - found.optimum.nominal
    if abs(apart) > AGREEMENT * abs(targets):
        text = f"{found.optimum.nominal:.6g} in the search, {targets:.6g} in the run"
        reasons.append(DIFFERS.reason("search and verifying run disagree", figure=text, origin=origin))
    return Verdict(reasons)


# ---- Tables ---------------------------------------------------------------------------------------------------------


def objective_table(found: Aim) -> ResultTable:
    """Return the objective of the best setup of the bank, of the targets, and of what comes near them."""
    best = found.verified_objective(0)
    rows: list[tuple[Cell | float | None, ...]] = []
    for rank, words in enumerate(VERIFIED):
        value = found.verified_objective(rank)
        rows.append((words, value, best - value, "FMUs of their own"))
    rows.append(("targets, in the search", found.optimum.nominal, best - found.optimum.nominal, "trial"))
    heads = ("setup", "objective .6", "gain over the bank .4", "run by")
    return ResultTable.of("Objective of the shocks exactly as planned", heads, rows)


def robust_table(found: Aim) -> ResultTable:
    """Return mean and scatter of the objective over the tolerance."""
    start, end = found.reference, found.optimum
    rows = [
        ("best of the bank", float(start.nominal[0]), float(start.scatter[0]), float(start.objective[0])),
        ("targets", end.nominal, end.scatter, end.objective),
    ]
    robust = found.request.robustness
    title = (
        f"Objective over {robust.draws} draws with a tolerance of {100.0 * found.request.tolerance:g} % of every "
        f"number; robust: mean + {robust.weight:g} standard deviations"
    )
    return ResultTable.of(title, ("setup", "as planned .6", "standard deviation", "robust .6"), rows)


def number_table(target: Target, found: Aim) -> ResultTable:
    """Return the numbers of a target, their ranges, and the intervals that keep the gain."""
    rows = []
    ranges = {one.name: one for one in found.ranges}
    for name, value in target.shape.numbers().items():
        unit = unit_of(name)
        cells: list[Cell | float | None] = [name, unit, Amount(value, unit)]
        if name in ranges:
            low, high = target.alone[name]
            ends = (ranges[name].low, ranges[name].high, low, high)
            cells += [Amount(end, unit) for end in ends]
            cells.append("at a limit" if name in target.at_limit else "")
        else:
            cells += [None, None, None, None, "fixed"]
        rows.append(cells)
    share = f"{100.0 * found.request.keep:g} % of the gain"
    heads = ("number", "unit", "target", "lower limit", "upper limit", f"from, alone keeps {share}", "to", "")
    return ResultTable.of(f"Target at {target.name}", heads, rows)


def neighbour_table(target: Target, found: Aim) -> ResultTable:
    """Return the builds of the bank and the valving near a target, and what they lose."""
    rows: list[tuple[Cell | float | None, ...]] = []
    for one in target.neighbours:
        lost = one.objective - found.optimum.nominal
        rows.append((one.build, one.difference, 100.0 * one.relative, one.objective, lost))
    valving = target.valving
    lost = target.valving_objective - found.optimum.nominal
    rows.append((f"virtual damper: {valving.valving}", valving.residual, 100.0 * valving.relative,
                 target.valving_objective, lost))  # fmt: skip
    heads = ("shock", "force difference, RMS [N]", "of the target's RMS [%]", "objective .6", "loss .4")
    title = f"Near the target at {target.name}, with the targets at the other corners"
    return ResultTable.of(title, heads, rows)


# ---- Page and file --------------------------------------------------------------------------------------------------


def write_aim(found: Aim, folder: Path) -> tuple[Path, Path]:
    """Write shapes.json and shapes.html into a folder; return their paths."""
    data, page = folder / "shapes.json", folder / "shapes.html"
    with atomic_path(data) as temporary:
        temporary.write_text(json.dumps(_content(found), indent=2) + "\n", encoding="utf-8")
    title = f"Curves to aim at: {found.study.name}"
    return data, write_page(page, document(title, aim_verdict(found), list(_sections(found)), lead=_lead(found)))


def _lead(found: Aim) -> str:
    fits = ", ".join(f"{name} {100.0 * fit.relative:.2g} %" for name, fit in found.fits.items())
    return f"Shapes of the bank describe its curves with an RMS error of: {fits}."


def band_text(found: Aim) -> str:
    """Return a sentence about the band."""
    if found.band is None:
        return "There is no gain over the best setup of the bank, so there is no band."
    share = f"{100.0 * found.band.share:g} % of the gain"
    if found.band.size == 0.0:
        return f"No box around the targets keeps {share}: a deviation of 1 % of the ranges already loses more."
    return (
        f"All numbers of all corners may deviate together by {100.0 * found.band.size:g} % of their ranges: "
        f"{100.0 * found.band.kept:.3g} % of {len(found.band.points)} random points there keep {share}."
    )


def _sections(found: Aim) -> Iterator[Section]:
    yield Section("gain", "Gain", [objective_table(found), robust_table(found), band_text(found)])
    for target in found.targets:
        blocks: list[Block] = [_figure(target, found), number_table(target, found), neighbour_table(target, found)]
        if target.valving.limits:
            blocks.append(f"At the end of what the search of valvings may use: {', '.join(target.valving.limits)}.")
        yield Section(target.name.replace("+", "-"), f"Target at {target.name}", blocks)


def _figure(target: Target, found: Aim) -> Figure:
    caption = f"Target at {target.name}; shaded: the band; dashed: the nearest build of the bank"
    axes = (Axis("damper velocity", "m/s"), Axis("force", "N"), "")
    figure = grid_figure(caption, 420, [axes], 1, gap=(0.0, 0.0))
    curve = target.shape.curve()
    if found.band is not None:
        figure.ribbon(0, target.velocity, target.low, target.high, name="band", color=COLORS[0])
    valving = target.valving
    figure.line(0, valving.velocity, valving.force, name="nearest valving", color=MEASURED)
    near = found.fits[target.neighbours[0].build].shape.curve()
    lines = {"target": (curve, COLORS[0], "solid"), target.neighbours[0].build: (near, COLORS[1], "dash")}
    for name, (one, color, dash) in lines.items():
        forces = np.array([one.force(v) for v in target.velocity.tolist()])
        figure.line(0, target.velocity, forces, name=name, color=color, dash=dash)
    return figure


def _content(found: Aim) -> dict[str, Any]:
    robust = asdict(found.request.robustness)
    return {
        "schema": SCHEMA,
        "kind": "shapes",
        "study": found.study.name,
        "best_of_bank": dict(found.bank),
        "objective": {
            "best_of_bank": found.verified_objective(0),
            "targets": found.verified_objective(1),
            "nearest_builds": found.verified_objective(2),
            "nearest_valvings": found.verified_objective(3),
            "targets_in_search": found.optimum.nominal,
            "targets_robust": found.optimum.objective,
            "targets_scatter": found.optimum.scatter,
            "best_of_bank_robust": float(found.reference.objective[0]),
        },
        "meets_constraints": found.optimum.allowed,
        "coupling_error_percent": found.verified.worst_coupling_error,
        "robustness": robust | {"tolerance": found.request.tolerance},
        "band": None if found.band is None else {
            "share": found.band.share, "size": found.band.size, "kept": found.band.kept
        },
        "ranges": {one.name: [one.low, one.high] for one in found.ranges},
        "targets": [_target(target) for target in found.targets],
        "starts": [list(pair) for pair in found.optimum.starts],
        "status": list(found.optimum.status),
        "trials": found.runs,
        "definition": json.loads(found.study.to_json()),
    }  # fmt: skip


def _target(target: Target) -> dict[str, Any]:
    valving = target.valving
    return {
        "corners": list(target.corners),
        "numbers": target.shape.numbers(),
        "alone": {name: list(pair) for name, pair in target.alone.items()},
        "at_limit": list(target.at_limit),
        "velocity [m/s]": target.velocity.tolist(),
        "lowest_force [N]": target.low.tolist(),
        "highest_force [N]": target.high.tolist(),
        "builds": [asdict(one) for one in target.neighbours],
        "valving": asdict(valving.valving) | {
            "level [N]": valving.level, "residual [N]": valving.residual, "relative": valving.relative,
            "objective": target.valving_objective, "at_limit": list(valving.limits),
        },
    }  # fmt: skip
