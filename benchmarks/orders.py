"""Benchmark of coupling schemes: errors and stability of each, for docs/explanation/coupling.md.

    python -m benchmarks.orders [--picture FILE] [--only NAMES]

The case is that of benchmarks/case.py: 10 s of the demo's track, all damping in the shocks. Prints Markdown.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from math import log10
from pathlib import Path
from typing import Any

import control
import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np

import cosim
from benchmarks.case import CORNERS, ROOT, SETTLING, Case, build_fmus, errors, fitted_law, make_case, track
from benchmarks.engines.runs import load, measure
from benchmarks.table import number
from builder.build import build
from eightpost.errors import StepError
from eightpost.shock import Lpf1, Polylinear, ShockLaw, StaticCurve
from eightpost.signals import Drivefile, TimeSeries
from eightpost.vehicle import read_vehicle

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
#: Rates for python FMUs, which are slow.
PYTHON_RATES = RATES[:-1]
STOP, RECORD_STEP = 10.0, 0.008
VALUES = ("held", "interpolated", "extrapolated", "parabolic")
SCHEMES: Mapping[str, cosim.Algorithm] = {
    **{f"Jacobi, {values}": cosim.Jacobi(values=values) for values in VALUES},
    **{f"Gauss-Seidel, {values}": cosim.GaussSeidel(values=values) for values in VALUES},
    "Implicit": cosim.Implicit(),
}
#: [N.s/m] per [lbf/(in/s)].
POUNDS = 175.12683524647636
QUANTITIES = ("car.{}.velocity", "car.{}.tire_force")

Errors = dict[str, list[tuple[float | None, float | None]]]


def main() -> None:
    """Run the measurements and print the tables."""
    options = _options()
    parts = {"curve": _curve, "linear": _linear, "python": _python, "drive": _drive, "limits": _limits}
    with tempfile.TemporaryDirectory() as name:
        for part in options.only.split(",") if options.only else parts:
            folder = Path(name) / part
            folder.mkdir()
            print("\n".join([f"\n{part}\n", *parts[part](folder, options.picture)]), flush=True)


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "--picture", type=Path, default=ROOT / "docs" / "pictures" / "coupling.png", help="picture file to write"
    )
    parser.add_argument(
        "--only", help="tables to print, from curve, linear, python, drive, limits; separated by commas"
    )
    return parser.parse_args()


def _case() -> Case:
    return make_case(fitted_law(), track(), STOP, record_step=RECORD_STEP)


def _curve(folder: Path, picture: Path) -> Iterator[str]:
    """Yield the table for fitted LPNL2 shocks and native FMUs."""
    build_fmus(fitted_law(), folder)
    found = _errors(_case(), folder, RATES)
    draw(found, RATES, picture)
    yield from _table(found, RATES)


def _python(folder: Path, _: Path) -> Iterator[str]:
    """Yield the same table for Python FMUs, which hold their inputs, without schemes that repeat steps."""
    build_fmus(fitted_law(), folder)
    build([ROOT / "examples" / "car.toml", folder / "shock.json"], folder, target="python")
    names = ("Jacobi, held", "Gauss-Seidel, held", "Gauss-Seidel, extrapolated")
    yield from _table(_errors(_case(), folder, PYTHON_RATES, {name: SCHEMES[name] for name in names}), PYTHON_RATES)


def _errors(
    case: Case, folder: Path, rates: tuple[float, ...], schemes: Mapping[str, cosim.Algorithm] = SCHEMES
) -> Errors:
    found: Errors = {}
    for scheme, algorithm in schemes.items():
        rows = [measure(case, folder, algorithm, 1.0 / rate) for rate in rates]
        found[scheme] = [(row["error_velocity_percent"], row["error_tire_force_percent"]) for row in rows]
    return found


def _table(found: Errors, rates: tuple[float, ...]) -> Iterator[str]:
    yield f"| scheme | {' | '.join(_rate(rate) for rate in rates)} | order |"
    yield "|---" * (len(rates) + 2) + "|"
    for scheme, pairs in found.items():
        cells = ["diverges" if a is None or b is None else f"{number(a, 2)} / {number(b, 2)}" for a, b in pairs]
        yield f"| {scheme} | {' | '.join(cells)} | {_order(pairs)} |"


def _order(pairs: list[tuple[float | None, float | None]]) -> str:
    """Return the observed orders of both quantities between the two highest rates."""
    slopes = [np.log2((a or np.nan) / (b or np.nan)) for a, b in zip(*pairs[-2:], strict=True)]
    return " / ".join(f"{slope:.2f}" for slope in slopes)


def _rate(rate: float) -> str:
    return f"{rate:g} Hz" if rate < 1000.0 else f"{rate / 1000.0:g} kHz"


def linear_curve(rate: float) -> StaticCurve:
    """Return the linear curve F_s = rate * v, with the rate [N.s/m] in every piece."""
    v = 0.4
    outer = (rate * v, rate * v, 0.0, 0.0)
    back = (-rate * v, -rate * v, 0.0, 0.0)
    return StaticCurve((rate * v, *[0.0] * 14), outer, back, v, 0.01, 9.0, 9.0, rate, rate)


def _linear(folder: Path, _: Path) -> Iterator[str]:
    """Yield the tables for linear shocks, compared with the exact closed-loop response."""
    plain, lagged, tau = 16.67 * POUNDS, 30.0 * POUNDS, 0.0013
    eye = np.eye(4)
    yield "16.67 lbf/(in/s) without lag\n"
    law, loop = Polylinear(linear_curve(plain)), control.ss([], [], [], plain * eye)
    yield from _table(_linear_errors(law, loop, folder / "plain"), RATES)
    yield "\n30 lbf/(in/s) behind a lag of 1.3 ms\n"
    slow, loop = Lpf1(linear_curve(lagged), tau), control.ss(-eye / tau, eye / tau, lagged * eye, 0)
    yield from _table(_linear_errors(slow, loop, folder / "lagged"), RATES)


def _linear_errors(law: ShockLaw, damper: Any, folder: Path) -> Errors:
    build_fmus(law, folder)
    system, expected = load(folder), _closed_loop(damper)
    return {
        scheme: [_linear_error(system, expected, algorithm, rate) for rate in RATES]
        for scheme, algorithm in SCHEMES.items()
    }


def _linear_error(
    system: cosim.System, expected: TimeSeries, algorithm: cosim.Algorithm, rate: float
) -> tuple[float | None, float | None]:
    names = tuple(quantity.format(corner) for quantity in QUANTITIES for corner in CORNERS)
    scenario = cosim.Scenario(STOP, track(), record=names, record_step=RECORD_STEP)
    try:
        found = cosim.run(system, scenario, algorithm=algorithm, step=1.0 / rate, compared=False).series
    except StepError:
        return None, None
    return _worst_apart(found, expected)


def _worst_apart(found: TimeSeries, expected: TimeSeries) -> tuple[float | None, float | None]:
    at = np.searchsorted(expected.time, found.time - 1e-7)
    late = found.time >= SETTLING
    worst = []
    for quantity in QUANTITIES:
        ends = [(found[n][late], expected[n][at][late]) for n in map(quantity.format, CORNERS)]
        worst.append(max(100.0 * float(np.std(a - b) / np.std(b)) for a, b in ends))
    return (worst[0], worst[1]) if max(worst) < 1000.0 else (None, None)


def _closed_loop(damper: Any) -> TimeSeries:
    """Return the response from python-control: the car with linear dampers in feedback, a piecewise linear drive."""
    car = read_vehicle(ROOT / "examples" / "car.toml").coupled()
    ports = [car.input_names.index(f"{c}.force") for c in CORNERS]
    speeds = [car.output_names.index(f"{c}.velocity") for c in CORNERS]
    pick, place = np.eye(len(car.outputs))[speeds], np.eye(len(car.inputs))[:, ports]
    through = control.ss([], [], [], place) * damper * control.ss([], [], [], pick)
    loop = control.feedback(control.ss(car.A, car.B, car.C, car.D), through, sign=1)
    series = track().series.window(0.0, STOP)
    u = np.stack([series[name] if name in series else np.zeros(len(series)) for name in car.input_names])
    start = np.concatenate([car.steady_state(u[:, 0]), np.zeros(loop.nstates - car.A.shape[0])])
    found = np.asarray(control.forced_response(loop, series.time, u, start).outputs)
    names = tuple(f"car.{name}" for name in car.output_names)
    return TimeSeries(series.time, found, names, tuple(c.unit for c in car.outputs))


def _drive(folder: Path, _: Path) -> Iterator[str]:
    """Yield the errors from holding only the drive: a staircase, coupled at 32 kHz, read at the end of each step."""
    build_fmus(fitted_law(), folder)
    case, system, fine = _case(), load(folder), 1.0 / 32000.0
    names = tuple(quantity.format(corner) for quantity in QUANTITIES for corner in CORNERS)
    yield "| drive held | shock velocity | tire force |"
    yield "|---|---|---|"
    for rate in RATES[:4]:
        drive = _staircase(case.drive, 1.0 / rate, fine)
        scenario = cosim.Scenario(STOP, drive, record=names, record_step=RECORD_STEP)
        series = cosim.run(system, scenario, step=fine, compared=False).series
        found = np.stack([series[name] for name in names])
        velocity, tire_force = errors(case, series.time, found[:4], found[4:])
        yield f"| {_rate(rate)} | {number(velocity, 2)} % | {number(tire_force, 2)} % |"


def _staircase(drive: Drivefile, held: float, fine: float) -> Drivefile:
    """Return the drive held over each interval at its start value; it jumps within `fine` [s] of the next interval."""
    time = np.arange(0.0, STOP + fine / 2, fine)
    steps = np.maximum(0.0, np.ceil(time / held - 1e-6) - 1.0) * held
    series = drive.series
    return Drivefile(TimeSeries(time, drive.sample(steps), series.names, series.units))


def _limits(folder: Path, _: Path) -> Iterator[str]:
    """Yield the largest steps at which the coupling of the car with linear shocks of 30 lbf/(in/s) is stable."""
    rate = 30.0 * POUNDS
    build_fmus(Polylinear(linear_curve(rate)), folder / "plain")
    build_fmus(Lpf1(linear_curve(rate), 0.0013), folder / "lagged")
    systems = [load(folder / name) for name in ("plain", "lagged")]
    yield "| scheme | without lag | lag of 1.3 ms |"
    yield "|---|---|---|"
    for scheme, algorithm in SCHEMES.items():
        limits = [_limit(system, algorithm) for system in systems]
        yield f"| {scheme} | {' | '.join(limits)} |"


def _limit(system: cosim.System, algorithm: cosim.Algorithm) -> str:
    low, high = 5e-4, 0.04
    if _stable(system, algorithm, high):
        return "above 40 ms"
    while high / low > 1.01:
        middle = (low * high) ** 0.5
        low, high = (middle, high) if _stable(system, algorithm, middle) else (low, middle)
    return f"{1e3 * low:.2g} ms"


def _stable(system: cosim.System, algorithm: cosim.Algorithm, step: float) -> bool:
    names = tuple(f"car.{corner}.velocity" for corner in CORNERS)
    try:
        series = cosim.run(
            system, cosim.Scenario(20.0, track(), record=names), algorithm=algorithm, step=step, compared=False
        ).series
    except StepError:
        return False
    return bool(np.abs(series.values).max() < 10.0)


if __name__ == "__main__":
    main()
