"""Page and JSON file of target curves."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from math import ceil
from pathlib import Path
from typing import Any

import numpy as np

from cosim.study.choice.shape_search import ASSURED, DrawnCar
from eightpost.api.shapes import VERIFIED, Aim, Target
from eightpost.files import write_text
from eightpost.report.charts import COLORS, MEASURED, Axis, Figure, grid_figure
from eightpost.report.page import Block, Section, document, write_page
from eightpost.report.tables import Amount, Cell, ResultTable
from eightpost.shock.shape import unit_of
from eightpost.verdict import Reason, Rules, Verdict, sealed

SCHEMA = 1

# ---- Verdict --------------------------------------------------------------------------------------------------------

ABOUT = "targets"

#: Largest difference between the optimiser's objective and that of the verifying run, as a share of the objective [1].
AGREEMENT = 1e-3

RULES = Rules.read(Path(__file__).with_suffix(".txt"), ABOUT, agreement=100.0 * AGREEMENT)


def aim_verdict(found: Aim) -> Verdict:
    """Return the verdict on target curves."""
    best, targets = found.verified_objective(0), found.verified_objective(1)
    origin = f"{found.runs} trials; verified by runs of their own FMUs"
    gain = f"{best:.5g} with the best of the bank, {targets:.5g} with the targets"
    rule = "targets better than the bank" if targets < best else "no gain over the bank"
    reasons = [RULES.reason(rule, "the objective", gain, origin)]
    reasons += _of_the_car(found)
    curves = found.curves
    as_shape = float(curves.reference.nominal[0])
    if targets < best and abs(best - as_shape) > 0.5 * (best - targets):
        text = f"{best:.6g} with its own laws, {as_shape:.6g} as shapes; gain {best - targets:.3g}"
        reasons.append(RULES.reason("gain within the error of the shapes", "the best of the bank", text, origin))
    if abs(targets - curves.optimum.nominal) > AGREEMENT * abs(targets):
        text = f"{curves.optimum.nominal:.6g} in the search, {targets:.6g} in the run"
        reasons.append(RULES.reason("verification differs", "search and verifying run disagree", text, origin))
    return Verdict(reasons)


def _of_the_car(found: Aim) -> Iterator[Reason]:
    """Yield what the stated uncertainty of the vehicle means for the gain."""
    car, about = found.curves.car, "uncertainty of the vehicle"
    if not found.request.uncertain:
        yield RULES.reason("uncertainty of the gain not computed", about, "not computed", "--set certainty=no")
    elif car is None or not car.is_known:
        known = "stated for no measure" if car is None else f"not stated for {', '.join(_unknown(car))}"
        yield RULES.reason("uncertainty of the gain unknown", about, known, "the vehicle's FMU")
    elif found.curves.chance < ASSURED:
        figure = f"{100.0 * found.curves.chance:.3g} %; limit {100.0 * ASSURED:g} %"
        draws = f"{found.curves.gains.size} draws of cars and shocks"
        yield RULES.reason("gain in doubt", "probability of a gain", figure, draws)


def _unknown(car: DrawnCar) -> Sequence[str]:
    """Return the measures of the objective whose uncertainty is not stated."""
    return car.unknown(car.criterion.measures)


# ---- Tables ---------------------------------------------------------------------------------------------------------


def objective_table(found: Aim) -> ResultTable:
    """Return objective and gain of the best setup of the bank, of the targets, and of what comes near them."""
    best, searched = found.verified_objective(0), found.curves.optimum.nominal
    values = {words: found.verified_objective(rank) for rank, words in enumerate(VERIFIED)}
    rows = [(words, value, best - value) for words, value in {**values, "targets, in the search": searched}.items()]
    title = "Objective of shocks exactly as planned"
    return ResultTable.of(title, ("setup", "objective .6", "gain .4"), rows)


def robust_table(found: Aim) -> ResultTable:
    """Return mean and scatter of the objective over the tolerance."""
    start, end = found.curves.reference, found.curves.optimum
    rows = [
        ("best of the bank", float(start.nominal[0]), float(start.scatter[0]), float(start.objective[0])),
        ("targets", end.nominal, end.scatter, end.objective),
    ]
    robust = found.request.robustness
    title = (
        f"Objective over {robust.draws} draws with a tolerance of {100.0 * found.request.tolerance:g} % of every "
        f"number{'' if found.curves.car is None else ', and over the cars that the true one may be'}; "
        f"robust: mean + {robust.weight:g} standard deviations"
    )
    return ResultTable.of(title, ("setup", "as planned .6", "standard deviation", "robust .6"), rows)


def gain_table(found: Aim) -> ResultTable:
    """Return the gain over the best setup of the bank: predicted, and what is assured."""
    curves = found.curves
    drawn = "shocks" if curves.car is None else "shocks and cars"
    half, most = np.quantile(curves.gains, [0.5, 1.0 - ASSURED]).tolist()
    gains = {
        "predicted, shocks exactly as planned": curves.predicted_gain,
        f"exceeded by 50 % of the draws of {drawn}": half,
        f"exceeded by {100.0 * ASSURED:g} % of them": most,
    }
    rows = [(words, gain, 100.0 * gain / abs(float(curves.reference.nominal[0]))) for words, gain in gains.items()]
    return ResultTable.of(
        "Gain over the best setup of the bank", ("gain", "objective .4", "of the objective [%]"), rows
    )


def number_table(target: Target, found: Aim) -> ResultTable:
    """Return the numbers of a target, their ranges, and the intervals that keep the gain."""
    rows = []
    ranges = {one.name: one for one in found.curves.space.ranges}
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
    share = f"{100.0 * found.request.keep:g} % of the assured gain"
    heads = ("number", "unit", "target", "lower limit", "upper limit", "from", "to", "")
    return ResultTable.of(f"Target at {target.name}; from, to: each number alone keeps {share}", heads, rows)


def neighbour_table(target: Target, found: Aim) -> ResultTable:
    """Return the builds of the bank and the valving near a target, and what they lose."""
    rows: list[tuple[Cell | float | None, ...]] = []
    for one in target.neighbours:
        lost = one.objective - found.curves.optimum.nominal
        rows.append((one.build, one.difference, 100.0 * one.relative, one.objective, lost))
    valving = target.valving
    lost = target.valving_objective - found.curves.optimum.nominal
    rows.append((f"virtual damper: {valving.valving}", valving.residual, 100.0 * valving.relative,
                 target.valving_objective, lost))  # fmt: skip
    heads = ("shock", "force difference, RMS [N]", "of the target's RMS [%]", "objective .6", "loss .4")
    title = f"Near the target at {target.name}, with the targets at the other corners"
    return ResultTable.of(title, heads, rows)


# ---- Page and file --------------------------------------------------------------------------------------------------


def write_aim(found: Aim, folder: Path) -> tuple[Path, Path]:
    """Write shapes.json and shapes.html into a folder; return their paths."""
    data = write_text(folder / "shapes.json", json.dumps(sealed(_content(found)), indent=2) + "\n")
    fits = ", ".join(f"{name} {100.0 * fit.relative:.2g} %" for name, fit in found.curves.fits.items())
    lead = f"Shapes of the bank describe its curves with an RMS error of: {fits}."
    title, links = f"Curves to aim at: {found.study.name}", {"report.html": "The study"}
    page = document(title, aim_verdict(found), list(_sections(found)), lead=lead, links=links)
    return data, write_page(folder / "shapes.html", page)


def car_text(found: Aim) -> str:
    """Return a sentence about what the vehicle's uncertainty does to the gain."""
    if not found.request.uncertain:
        return "The errors of the vehicle are left out on request: the gain and its band are those of the model."
    car = found.curves.car
    if car is None:
        return (
            "The vehicle states no uncertainty: the gain and its band are those of this vehicle, as if it were exact."
        )
    missing = _unknown(car)
    unknown = f" The uncertainty of {', '.join(missing)} is not known and not included." if missing else ""
    return (
        f"With the errors that the vehicle states, the targets are better than the best setup of the bank with a "
        f"probability of {chance_text(found.curves.chance, len(car.draws.common))}.{unknown}"
    )


def chance_text(share: float, cars: int) -> str:
    """Return the share of drawn cars with a gain as a probability, no more extreme than the number of cars resolves.

    >>> chance_text(0.873, 256), chance_text(1.0, 256), chance_text(0.0, 256)
    ('87.3 %', 'more than 99 %', 'less than 1 %')
    """
    finest = ceil(100.0 / cars)
    if 100.0 * share > 100.0 - finest:
        return f"more than {100 - finest} %"
    return f"{100.0 * share:.3g} %" if 100.0 * share >= finest else f"less than {finest} %"


def band_text(found: Aim) -> str:
    """Return a sentence about the band."""
    if (band := found.curves.band) is None:
        return f"No gain is assured with {100.0 * ASSURED:g} %, so there is no band."
    share = f"{100.0 * band.share:g} % of the assured gain"
    if band.size == 0.0:
        return f"No box around the targets keeps {share}: a deviation of 1 % of the ranges already loses more."
    return (
        f"All numbers of all corners may deviate together by {100.0 * band.size:g} % of their ranges: "
        f"{100.0 * band.kept:.3g} % of {len(band.points)} random points there keep {share}."
    )


def _sections(found: Aim) -> Iterator[Section]:
    tables = [objective_table(found), gain_table(found), car_text(found), robust_table(found), band_text(found)]
    yield Section("gain", "Gain", tables)
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
    if found.curves.band is not None:
        figure.ribbon(0, target.velocity, target.low, target.high, name="band", color=COLORS[0])
    valving = target.valving
    figure.line(0, valving.velocity, valving.force, name="nearest valving", color=MEASURED)
    near = found.curves.fits[target.neighbours[0].build].shape.curve()
    lines = {"target": (curve, COLORS[0], "solid"), target.neighbours[0].build: (near, COLORS[1], "dash")}
    for name, (one, color, dash) in lines.items():
        forces = np.array([one.force(v) for v in target.velocity.tolist()])
        figure.line(0, target.velocity, forces, name=name, color=color, dash=dash)
    return figure


def _content(found: Aim) -> dict[str, Any]:
    curves, optimum, robust = found.curves, found.curves.optimum, asdict(found.request.robustness)
    return {
        "schema": SCHEMA,
        "kind": "shapes",
        "study": found.study.name,
        "digest": found.digest,
        "best_of_bank": dict(curves.bank),
        "objective": {
            "best_of_bank": found.verified_objective(0),
            "targets": found.verified_objective(1),
            "nearest_builds": found.verified_objective(2),
            "nearest_valvings": found.verified_objective(3),
            "targets_in_search": optimum.nominal,
            "targets_robust": optimum.objective,
            "targets_scatter": optimum.scatter,
            "best_of_bank_robust": float(curves.reference.objective[0]),
        },
        "meets_constraints": optimum.allowed,
        "coupling_error_percent": found.verified.worst_coupling_error,
        "robustness": robust | {"tolerance": found.request.tolerance},
        "gain": {
            "predicted": curves.predicted_gain,
            "assured": curves.assured_gain,
            "probability": curves.chance,
            "includes_car": curves.car is not None and curves.car.is_known,
        },
        "band": None if curves.band is None else {
            "share": curves.band.share, "size": curves.band.size, "kept": curves.band.kept
        },
        "ranges": {one.name: [one.low, one.high] for one in curves.space.ranges},
        "targets": [_target(target) for target in found.targets],
        "starts": [list(pair) for pair in optimum.starts],
        "status": list(optimum.status),
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
