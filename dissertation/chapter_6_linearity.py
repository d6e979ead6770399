"""Chapter 6.2: responses and coherence of one input at a time on the 8-post stand-in."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache

import numpy as np

from dissertation.effort import Effort
from dissertation.findings import Findings
from dissertation.plots import COHERENCE, LINEAR_FREQUENCY, TIME, Line, Plot, decibel_axis, decibels, figure_of
from dissertation.rig_bench import EIGHT_POST, FIVE_SETUPS
from eightpost.ident.linearity import Condition, Linearity, Path, judge_linearity
from eightpost.ident.preparation import prepare
from eightpost.report.charts import Axis, Figure
from eightpost.report.tables import ResultTable
from eightpost.rig import RigTest
from eightpost.units import si_factor
from eightpost.vehicle import CORNERS
from eightpost.virtual import random_drive, run_test

_OUTPUTS = (
    "lf.velocity", "rf.velocity", "lr.velocity", "rr.velocity", "lf.tire_force", "rf.tire_force", "lr.tire_force",
    "rr.tire_force", "front.ride_height", "rear.ride_height",
)  # fmt: skip
_US = {"velocity": "in/s", "tire_force": "lbf", "ride_height": "in", "road": "in", "aero": "lbf", "force": "lbf"}
_SI = {"velocity": "m/s", "tire_force": "N", "ride_height": "m"}


@cache
def _linearity(seconds: float) -> Linearity:
    return judge_linearity(prepare(_tests(seconds)), outputs=_OUTPUTS)


def _tests(seconds: float) -> Iterator[RigTest]:
    """Yield a test with each actuator alone, then a baseline and an alternate shock at each corner on one drive."""
    car, dampers = EIGHT_POST.car, EIGHT_POST.dampers
    for number, name in enumerate(car.inputs):
        drive = random_drive(car, 100 + number, duration=seconds, active=(name,))
        yield run_test(car, drive, dampers[:1] * 4, seed=number)
    drive = random_drive(car, 7, duration=seconds)
    for number, setup in enumerate(FIVE_SETUPS):
        yield run_test(car, drive, [dampers[k] for k in setup], seed=20 + number)


def _path(effort: Effort, output: str, source: str) -> Path:
    found = _linearity(effort.single_seconds)
    return next(path for path in found.paths if (path.output.name, path.input.name) == (output, source))


def _unit(name: str) -> str:
    return _US[name.rpartition(".")[2]]


def _figure(effort: Effort, outputs: tuple[str, str], kind: str) -> Figure:
    """Return time response, magnitude and coherence of two outputs over the four inputs of a kind."""
    rows: list[list[Plot]] = [[], [], []]
    for output in outputs:
        own = {corner: _path(effort, output, f"{corner}.{kind}") for corner in CORNERS}
        unit = f"{_unit(output)}/{_US[kind]}"
        scale = si_factor(_unit(output)) / si_factor(_US[kind])
        traces = [Line(c, np.arange(p.trace.size) / p.rate, p.trace) for c, p in own.items()]
        levels = [Line(c, p.frequency, decibels(p.H, scale)) for c, p in own.items()]
        shares = [Line(c, p.frequency, p.coherence) for c, p in own.items()]
        rows[0].append(Plot(output, TIME, Axis("", _SI[output.rpartition(".")[2]]), traces))
        rows[1].append(Plot(output, LINEAR_FREQUENCY, decibel_axis(unit), levels))
        rows[2].append(Plot(output, LINEAR_FREQUENCY, COHERENCE, shares))
    plots = [plot for row in rows for plot in row]
    return figure_of(f"Outputs over {kind} at each corner: time, magnitude and coherence.", plots, columns=2, row=170)


def _level(path: Path, low: float = 1.0, high: float = 15.0) -> float:
    """Return the RMS magnitude of a path in a band, SI."""
    inside = (path.frequency >= low) & (path.frequency <= high)
    return float(np.sqrt(np.mean(np.abs(path.H[inside]) ** 2)))


def _levels(effort: Effort, output: str, kind: str, low: float = 1.0, high: float = 15.0) -> dict[str, float]:
    """Return the RMS magnitude over each corner's input."""
    return {corner: _level(_path(effort, output, f"{corner}.{kind}"), low, high) for corner in CORNERS}


def _relative(levels: dict[str, float]) -> str:
    """Return levels relative to the largest, in words."""
    top = max(levels.values())
    return ", ".join(f"{corner} {20.0 * np.log10(level / top):.0f} dB" for corner, level in levels.items())


def _below(levels: dict[str, float], own: str, others: tuple[str, ...]) -> float:
    """Return how far the mean of other corners is below a corner [dB]."""
    return float(np.mean([20.0 * np.log10(levels[own] / levels[other]) for other in others]))


def _coherence(effort: Effort, output: str, source: str) -> float:
    """Return the share of the output's power that the input explains."""
    return _path(effort, output, source).mean_coherence


def figure_6_9(effort: Effort) -> Findings:
    """Shock velocities over wheelloaders."""
    front, rear = (_levels(effort, output, "road") for output in ("rf.velocity", "lr.velocity"))
    shares = [_coherence(effort, f"{c}.velocity", f"{c}.road") for c in ("rf", "lr")]
    own = _path(effort, "rf.velocity", "rf.road")
    low, peak = float(np.abs(own.H[own.frequency < 0.6]).mean()), float(np.abs(own.H).max())
    return Findings(
        {
            "front": _below(front, "rf", ("lf", "lr", "rr")),
            "rear": _below(rear, "lr", ("lf", "rf")),
            "across": _below(rear, "lr", ("rr",)),
        },
        {
            "coherence": (min(shares) > 0.9, f"{shares[0]:.3f} and {shares[1]:.3f}"),
            "low": (low < 0.2 * peak, f"below 0.6 Hz {100.0 * low / peak:.1f} % of the largest"),
        },
        [_figure(effort, ("rf.velocity", "lr.velocity"), "road")],
    )


def figure_6_10(effort: Effort) -> Findings:
    """Shock velocities over aeroloaders."""
    shares = [_coherence(effort, f"{c}.velocity", f"{c}.aero") for c in ("rf", "lr")]
    return Findings(
        claims={"coherence": (min(shares) > 0.8, f"{shares[0]:.3f} and {shares[1]:.3f}")},
        blocks=[_figure(effort, ("rf.velocity", "lr.velocity"), "aero")],
    )


def figure_6_11(effort: Effort) -> Findings:
    """Tire forces over wheelloaders."""
    front, rear = (_levels(effort, output, "road") for output in ("rf.tire_force", "lr.tire_force"))
    nearest = max(front, key=front.__getitem__) == "rf" and max(rear, key=rear.__getitem__) == "lr"
    second = sorted(rear, key=rear.__getitem__)[-2]
    return Findings(
        claims={
            "nearest": (nearest, f"right front: {_relative(front)}; left rear: {_relative(rear)}"),
            "across": (second == "rr", f"left rear: {_relative(rear)}"),
        },
        blocks=[_figure(effort, ("rf.tire_force", "lr.tire_force"), "road")],
    )


def figure_6_12(effort: Effort) -> Findings:
    """Tire forces over aeroloaders."""
    low = {c: _levels(effort, f"{c}.tire_force", "aero", 0.3, 1.5) for c in CORNERS}
    nearest = all(max(levels, key=levels.__getitem__) == corner for corner, levels in low.items())
    across = {corner: low[other][corner] / low[corner][corner] for corner, other in (("rf", "lf"), ("lr", "rr"))}
    return Findings(
        claims={
            "nearest": (nearest, f"right front tire: {_relative(low['rf'])}; left rear: {_relative(low['lr'])}"),
            "rear": (
                across["lr"] > across["rf"],
                f"other tire of the axle relative to the nearest: rear {across['lr']:.2f}, front {across['rf']:.2f}",
            ),
        },
        blocks=[_figure(effort, ("rf.tire_force", "lr.tire_force"), "aero")],
    )


_HEIGHTS = ("front.ride_height", "rear.ride_height")


def figure_6_14(effort: Effort) -> Findings:
    """Ride heights over wheelloaders."""
    front, rear = (_levels(effort, output, "road") for output in _HEIGHTS)
    axle = min(front["lf"], front["rf"]) > max(front["lr"], front["rr"])
    axle = axle and min(rear["lr"], rear["rr"]) > max(rear["lf"], rear["rf"])
    path = _path(effort, "front.ride_height", "rf.road")
    low, peak = float(np.abs(path.H[path.frequency < 0.6]).mean()), float(np.abs(path.H).max())
    return Findings(
        claims={
            "axle": (axle, f"front: {_relative(front)}; rear: {_relative(rear)}"),
            "low": (low < 0.2 * peak, f"below 0.6 Hz {100.0 * low / peak:.1f} % of the largest"),
        },
        blocks=[_figure(effort, _HEIGHTS, "road")],
    )


def figure_6_15(effort: Effort) -> Findings:
    """Ride heights over aeroloaders."""
    front, rear = (_levels(effort, output, "aero", 0.3, 4.0) for output in _HEIGHTS)
    nearest = min(front["lf"], front["rf"]) > max(front["lr"], front["rr"])
    nearest = nearest and min(rear["lr"], rear["rr"]) > max(rear["lf"], rear["rf"])
    return Findings(
        claims={"nearest": (nearest, f"front: {_relative(front)}; rear: {_relative(rear)}")},
        blocks=[_figure(effort, _HEIGHTS, "aero")],
    )


def figure_6_16(effort: Effort) -> Findings:
    """Shock velocities over shock forces."""
    levels = {c: _levels(effort, f"{c}.velocity", "force") for c in ("rf", "lr")}
    own = all(max(found, key=found.__getitem__) == corner for corner, found in levels.items())
    shares = [_coherence(effort, f"{c}.velocity", f"{c}.force") for c in ("rf", "lr")]
    path = _path(effort, "rf.velocity", "rf.force")
    inside = (path.frequency > 2.5) & (path.frequency < 12.0)
    return Findings(
        {"anti": float(path.frequency[inside][np.argmin(np.abs(path.H[inside]))])},
        {
            "own": (own, "; ".join(f"{corner}: {_relative(found)}" for corner, found in levels.items())),
            "coherence": (min(shares) > 0.9, f"{shares[0]:.3f} and {shares[1]:.3f}"),
        },
        [_figure(effort, ("rf.velocity", "lr.velocity"), "force")],
    )


def figure_6_17(effort: Effort) -> Findings:
    """Tire forces over shock forces."""
    shares = [_coherence(effort, f"{c}.tire_force", f"{c}.force") for c in ("rf", "lr")]
    across = _coherence(effort, "lf.tire_force", "rf.force")
    return Findings(
        claims={
            "nearest": (min(shares) > 0.9, f"{shares[0]:.3f} and {shares[1]:.3f}"),
            "across": (across < 0.5, f"right front shock, left front tire: {across:.3f}"),
        },
        blocks=[_figure(effort, ("rf.tire_force", "lr.tire_force"), "force")],
    )


def figure_6_18(effort: Effort) -> Findings:
    """Ride heights over shock forces."""
    paths = [_path(effort, "front.ride_height", f"{c}.force") for c in CORNERS]
    level = max(float(np.abs(p.H[(p.frequency > 5.0) & (p.frequency < 20.0)]).max()) for p in paths)
    shares = []
    for path in paths[:2]:
        inside = (path.frequency >= 1.0) & (path.frequency <= 4.0)
        shares.append(float(path.coherence[inside].mean()))
    return Findings(
        {"level": 100.0 * si_factor("lbf") * level},
        {"coherence": (min(shares) > 0.8, f"left front {shares[0]:.3f}, right front {shares[1]:.3f}")},
        [_figure(effort, _HEIGHTS, "force")],
        "The level is that from 5 to 20 Hz.",
    )


def table_6_4(effort: Effort) -> Findings:
    """Number of paths in each condition."""
    found = _linearity(effort.single_seconds)
    counts = {kind: sum(each.condition is kind for each in found.verdicts) for kind in Condition}
    rows = [(kind.name, kind.meaning, str(count)) for kind, count in counts.items()]
    third = counts[Condition.III]
    return Findings(
        claims={"high": (third == 0, f"{third} of {len(found.verdicts)} paths are in condition III")},
        blocks=[ResultTable.of("", ("condition", "meaning", "paths of the stand-in"), rows)],
    )


COMPUTATIONS = {
    "figure-6.9": figure_6_9,
    "figure-6.10": figure_6_10,
    "figure-6.11": figure_6_11,
    "figure-6.12": figure_6_12,
    "figure-6.14": figure_6_14,
    "figure-6.15": figure_6_15,
    "figure-6.16": figure_6_16,
    "figure-6.17": figure_6_17,
    "figure-6.18": figure_6_18,
    "table-6.4": table_6_4,
}
