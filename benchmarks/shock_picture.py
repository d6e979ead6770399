"""Picture of the errors of the laws on the twelve configurations, and of the errors in the dissertation."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import NullFormatter, ScalarFormatter

from benchmarks.printed_shocks import CONFIGURATIONS
from benchmarks.shock_rows import Result
from benchmarks.shock_tables import virtual
from eightpost.shock import law_title

#: Colours of Okabe and Ito, which colour-blind readers can distinguish.
COLORS = {"polylinear": "#0072B2", "lpf1": "#E69F00", "lpnl2": "#009E73", "hysteresis": "#CC79A7"}


def draw(found: Sequence[Result], path: Path) -> None:
    """Draw the errors on the held-out draws; errors of the dissertation have hollow marks."""
    errors = virtual(found)
    if not errors:
        return
    figure = Figure(figsize=(9.5, 4.6), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots()
    for shift, (law, color) in zip((-0.12, -0.04, 0.04, 0.12), COLORS.items(), strict=True):
        ours = [(one.configuration + shift, one.rms[law]) for one in errors if law in one.rms]
        if ours:
            axes.semilogy(*zip(*ours, strict=True), "o", color=color, label=law_title(law))
        printed_points = [(one.number + shift, one.rms_lbf[law]) for one in CONFIGURATIONS if law in one.rms_lbf]
        if printed_points:
            axes.semilogy(*zip(*printed_points, strict=True), "o", color=color, fillstyle="none", label="printed")
    axes.set_xticks([one.number for one in CONFIGURATIONS], [_tick(one.number) for one in CONFIGURATIONS], fontsize=8)
    axes.set_yticks([1, 2, 3, 4, 5, 6, 8, 10, 15, 20, 30, 50])
    axes.yaxis.set_major_formatter(ScalarFormatter())
    axes.yaxis.set_minor_formatter(NullFormatter())
    axes.set(ylabel="RMS error on another phase draw [lbf]", xlabel="configuration: build, clicks, gas")
    axes.grid(visible=True, which="both", axis="y", color="0.92")
    axes.legend(ncols=4, fontsize=8)
    figure.savefig(path, dpi=110)


def _tick(configuration: int) -> str:
    one = CONFIGURATIONS[configuration - 1]
    return f"{configuration}\n{one.build}, {one.clicks}\n{one.gas_pressure_psi:g} psi"
