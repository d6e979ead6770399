"""Benchmark of coupling schemes: errors and stability of each, for docs/explanation/coupling.md.

    python -m benchmarks.orders [--picture FILE]

The case is that of benchmarks/case.py: 10 s of the demo's track, all damping in the shocks. Prints Markdown.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import cosim
from benchmarks.case import Case, build_fmus, errors, fitted_law, make_case, track
from benchmarks.table import ROOT, number
from eightpost.corners import CORNERS
from eightpost.errors import StepError

#: Colours of Okabe and Ito, one per method; line styles, one per kind of values.
COLORS = {"Jacobi": "#D55E00", "Gauss-Seidel": "#0072B2", "Implicit": "#000000"}
STYLES = {"held": "-", "interpolated": ":", "extrapolated": "--", "parabolic": "-.", "": "-"}
TITLES = ("shock velocity", "tire force")

Errors = Mapping[str, Sequence[tuple[float | None, float | None]]]


def draw(found: Errors, rates: Sequence[float], path: Path) -> None:
    """Draw both quantities [%] by scheme; diverged runs are omitted."""
    figure = Figure(figsize=(12.0, 5.4), layout="constrained")
    both = figure.subplots(1, 2, sharey=True)
    for k, axes in enumerate(both):
        for scheme, pairs in found.items():
            points = [(rate, pair[k]) for rate, pair in zip(rates, pairs, strict=True) if pair[k] is not None]
            method, _, values = scheme.partition(", ")
            axes.loglog(*zip(*points, strict=True), "o", ms=4, ls=STYLES[values], color=COLORS[method], label=scheme)
        for order, top in ((1, 70.0), (2, 0.03), (3, 0.009)):  # short lines with the slopes of the orders
            ends = (1400.0, 2800.0) if order == 1 else (140.0, 280.0)
            axes.loglog(ends, (top, top / 2.0**order), color="0.35", linewidth=1.0)
            axes.text(1.05 * ends[1], top / 2.0**order, f"order {order}", fontsize=9, color="0.35", va="center")
        axes.set(
            title=f"{TITLES[k]}: error in % of its standard deviation", xlabel="coupling rate [Hz]", ylim=(None, 500.0)
        )
        axes.set_xticks(rates, [f"{rate:g}" for rate in rates])
        axes.minorticks_off()
        axes.grid(visible=True, alpha=0.3)
    figure.legend(handles=both[1].get_lines()[: len(found)], loc="outside right center")
    figure.savefig(path, dpi=120)


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
