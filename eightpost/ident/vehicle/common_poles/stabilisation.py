"""The stabilisation diagram: poles of models of rising order, and which of them stay where they are."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from eightpost.files import atomic_path

if TYPE_CHECKING:
    from pathlib import Path

    from matplotlib.axes import Axes
    from numpy.typing import NDArray

    from eightpost.ident.vehicle.common_poles.common_pole_fit import CommonPoleModel
    from eightpost.ident.vehicle.common_poles.order import OrderStudy

    Array = NDArray[np.float64]

#: A pole that moves by less than these from one order to the next is stable, in frequency and in damping [1].
STEADY_FREQUENCY, STEADY_DAMPING = 0.01, 0.05


class PlacedPole(NamedTuple):
    """One pole pair of one model: order, frequency [Hz], damping ratio, and whether the order before has it too."""

    order: int
    frequency: float
    damping: float
    steady: bool


def stabilisation(study: OrderStudy) -> tuple[PlacedPole, ...]:
    """Return the pole pairs of all orders."""
    placed: list[PlacedPole] = []
    before = np.zeros((0, 2))
    for order, poles in zip(study.orders, study.poles, strict=True):
        upper = poles[poles.imag > 0.0]
        now = np.stack((np.abs(upper) / (2.0 * np.pi), -upper.real / np.abs(upper)), axis=1)
        placed += [PlacedPole(order, float(f), float(d), _stayed(f, d, before)) for f, d in now]
        before = now
    return tuple(placed)


def _stayed(frequency: float, damping: float, before: Array) -> bool:
    near = np.abs(before[:, 0] - frequency) <= STEADY_FREQUENCY * frequency
    alike = np.abs(before[:, 1] - damping) <= STEADY_DAMPING * abs(damping)
    return bool((near & alike).any())


def plot_stabilisation(found: CommonPoleModel, path: str | Path) -> None:
    """Write a PNG: poles over frequency and order, and the gaps of the singular values by which an order is chosen."""
    figure = Figure(figsize=(11.0, 4.6), layout="constrained")
    FigureCanvasAgg(figure)
    poles, gaps = figure.subplots(1, 2, sharey=True, width_ratios=(4, 1))
    _poles(poles, found)
    study = found.start.study
    gaps.barh(study.orders, study.gaps, height=1.2)
    gaps.axhline(found.order, color="tab:red", linewidth=1.0)
    gaps.set(title="gap", xlabel="singular value over the next", xscale="log")
    with atomic_path(path) as temporary:
        figure.savefig(temporary, format="png", dpi=110)


def _poles(axes: Axes, found: CommonPoleModel) -> None:
    placed = [pole for pole in stabilisation(found.start.study) if pole.frequency <= 1.2 * found.band[1]]
    for steady, marker, label in ((True, "o", "as at the order before"), (False, "x", "moved")):
        chosen = [pole for pole in placed if pole.steady is steady]
        axes.plot([p.frequency for p in chosen], [p.order for p in chosen], marker, markersize=5, label=label)
    axes.axhline(found.order, color="tab:red", linewidth=1.0, label=f"{found.order} states")
    axes.set(title="stabilisation diagram", xlabel="frequency [Hz]", ylabel="states")
    axes.legend(loc="upper left", ncols=3, fontsize="small")
    axes.grid(alpha=0.3)
