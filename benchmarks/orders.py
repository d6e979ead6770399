"""Benchmark of coupling schemes: errors and stability of each, for docs/explanation/coupling.md.

    python -m benchmarks.orders [--picture FILE]

The case is that of benchmarks/case.py: 10 s of the demo's track, all damping in the shocks. Prints Markdown.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from math import log10
from pathlib import Path
from typing import Any

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np

import cosim
from benchmarks.case import ROOT, Case, build_fmus, errors, fitted_law, make_case, track
from benchmarks.table import number
from eightpost.corners import CORNERS
from eightpost.errors import StepError

mpl.use("Agg")


#: Colours of Okabe and Ito, one per method; line styles, one per kind of values.
COLORS = {"Jacobi": "#D55E00", "Gauss-Seidel": "#0072B2", "Implicit": "#000000"}
STYLES = {"held": "-", "interpolated": ":", "extrapolated": "--", "parabolic": "-.", "": "-"}
TITLES = ("shock velocity", "tire force")

Errors = Mapping[str, Sequence[tuple[float | None, float | None]]]


def draw(found: Errors, rates: Sequence[float], path: Path) -> None:
    """Draw both quantities [%] by scheme; diverged runs are omitted."""
    figure, both = plt.subplots(1, 2, figsize=(12.0, 5.4), sharey=True)
    figure.subplots_adjust(left=0.07, right=0.83, bottom=0.11, top=0.9, wspace=0.04)
    lowest = min(value for pairs in found.values() for pair in pairs for value in pair if value is not None)
    for k, axes in enumerate(both):
        for scheme, pairs in found.items():
            points = [(rate, pair[k]) for rate, pair in zip(rates, pairs, strict=True) if pair[k] is not None]
            axes.loglog(*zip(*points, strict=True), marker="o", markersize=4, linewidth=1.6, **_look(scheme))
        for order in (1, 2, 3):
            _slope(axes, order)
        _dress(axes, rates, f"{TITLES[k]}: error in % of its standard deviation", lowest)
    _names(both[1], found)
    figure.savefig(path, dpi=120)
    plt.close(figure)


def _look(scheme: str) -> dict[str, Any]:
    method, _, values = scheme.partition(", ")
    return {"color": COLORS[method], "linestyle": STYLES[values]}


def _dress(axes: Any, rates: Sequence[float], title: str, lowest: float) -> None:
    axes.set_title(title, fontsize=11)
    axes.set_xlabel("coupling rate [Hz]")
    axes.set_xticks(rates, [f"{rate:g}" for rate in rates])
    axes.minorticks_off()
    axes.set_ylim(0.7 * lowest, 500.0)
    axes.text(125.0, 330.0, "Jacobi diverges at 125 Hz", fontsize=9, color=COLORS["Jacobi"], va="center")
    axes.set_yticks([0.001, 0.01, 0.1, 1.0, 10.0, 100.0], ["0.001 %", "0.01 %", "0.1 %", "1 %", "10 %", "100 %"])
    axes.grid(visible=True, alpha=0.3)


def _slope(axes: Any, order: int) -> None:
    """Draw a short line with the slope of an order, and its label."""
    first, top = {1: (1400.0, 70.0), 2: (140.0, 0.03), 3: (140.0, 0.009)}[order]
    ends = (first, 2.0 * first), (top, top / 2.0**order)
    axes.loglog(*ends, color="0.35", linewidth=1.0)
    axes.text(2.1 * first, ends[1][1], f"order {order}", fontsize=9, color="0.35", va="center")


def _names(axes: Any, found: Errors) -> None:
    """Draw names at the right end of each line, without overlaps."""
    low, high = (log10(limit) for limit in axes.get_ylim())
    ends = sorted((pairs[-1][1], scheme) for scheme, pairs in found.items() if pairs[-1][1] is not None)
    wanted = [(log10(value) - low) / (high - low) for value, _ in ends]
    for (value, scheme), height in zip(ends, _apart(wanted, 0.05), strict=True):
        axes.annotate(
            scheme, xy=(4000.0, value), xytext=(1.03, height), textcoords="axes fraction", va="center", fontsize=9.5,
            color=_look(scheme)["color"],
            arrowprops={"arrowstyle": "-", "linewidth": 0.5, "color": "0.6", "relpos": (0.0, 0.5)},
        )  # fmt: skip


def _apart(heights: Sequence[float], gap: float) -> list[float]:
    """Return sorted heights at least `gap` apart, within the axes if they fit."""
    placed: list[float] = []
    for height in heights:
        placed.append(max(height, placed[-1] + gap) if placed else max(height, 0.02))
    excess = max(0.0, placed[-1] - 0.98) if placed else 0.0
    top = 1.0 + gap
    for k in range(len(placed) - 1, -1, -1):
        placed[k] = min(placed[k], top - gap) if excess else placed[k]
        top = placed[k]
    return placed


RATES = (125.0, 250.0, 500.0, 1000.0, 2000.0, 4000.0)
STOP, RECORD_STEP = 10.0, 0.008
VALUES = ("held", "interpolated", "extrapolated", "parabolic")
SCHEMES: Mapping[str, cosim.Algorithm] = {
    **{f"Jacobi, {values}": cosim.Jacobi(values=values) for values in VALUES},
    **{f"Gauss-Seidel, {values}": cosim.GaussSeidel(values=values) for values in VALUES},
    "Implicit": cosim.Implicit(),
}


def main() -> None:
    """Run the measurements, draw the picture and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    picture = ROOT / "docs" / "pictures" / "coupling.png"
    parser.add_argument("--picture", type=Path, default=picture, help="picture file to write")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        build_fmus(fitted_law(), Path(name))
        found = _errors(make_case(fitted_law(), track(), STOP, record_step=RECORD_STEP), Path(name))
    draw(found, RATES, options.picture)
    print("\n".join(_table(found)))


def _errors(case: Case, folder: Path) -> Errors:
    found: dict[str, list[tuple[float | None, float | None]]] = {}
    for scheme, algorithm in SCHEMES.items():
        found[scheme] = [measure(case, folder, algorithm, 1.0 / rate) for rate in RATES]
    return found


def measure(case: Case, folder: Path, algorithm: cosim.Algorithm, step: float) -> tuple[float | None, float | None]:
    """Return the errors of shock velocity and tire force [%] of one run; None if it diverged."""
    fmus = {"car": folder / "car.fmu"} | dict.fromkeys(CORNERS, folder / "shock.fmu")
    system = cosim.System.load(fmus, [cosim.Bond.between(f"car.{corner}", corner) for corner in CORNERS])
    names = [f"car.{corner}.{quantity}" for quantity in ("velocity", "tire_force") for corner in CORNERS]
    scenario = cosim.Scenario(case.stop, case.drive, record=names)
    try:
        result = cosim.run(system, scenario, algorithm=algorithm, step=step, compared=False)
    except StepError:
        return None, None
    values = np.stack([result.series[name] for name in names])
    return (None, None) if result.partial else errors(case, result.series.time, values[:4], values[4:])


def _table(found: Errors) -> Iterator[str]:
    yield f"| scheme | {' | '.join(_rate(rate) for rate in RATES)} | order |"
    yield "|---" * (len(RATES) + 2) + "|"
    for scheme, pairs in found.items():
        cells = ["diverges" if a is None or b is None else f"{number(a, 2)} / {number(b, 2)}" for a, b in pairs]
        yield f"| {scheme} | {' | '.join(cells)} | {_order(pairs)} |"


def _order(pairs: Sequence[tuple[float | None, float | None]]) -> str:
    """Return the observed orders of both quantities between the two highest rates."""
    slopes = [np.log2((a or np.nan) / (b or np.nan)) for a, b in zip(*pairs[-2:], strict=True)]
    return " / ".join(f"{slope:.2f}" for slope in slopes)


def _rate(rate: float) -> str:
    return f"{rate:g} Hz" if rate < 1000.0 else f"{rate / 1000.0:g} kHz"


if __name__ == "__main__":
    main()
