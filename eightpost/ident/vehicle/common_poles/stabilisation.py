"""Stabilisation diagram: the poles of models of increasing order, and which of them are stable from order to order."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from eightpost.array_types import Array
from eightpost.ident.vehicle.common_poles.common_pole_fit import CLEAR_GAP, CommonPoleModel, OrderStudy
from eightpost.ident.vehicle.trust import OrderCandidate, Orders, PolePair
from eightpost.report.pictures import Axes, new_figure, save, ticks_at_1_2_5

#: Relative change of frequency and damping ratio below which a pole is stable from one order to the next [1].
STEADY_FREQUENCY, STEADY_DAMPING = 0.01, 0.05


def orders_of(found: CommonPoleModel) -> Orders:
    """Return the choice of a model's number of states, with the poles of all orders."""
    study = found.start.study
    return Orders(stabilisation(study), found.order, study.clear and found.order == study.suggested, found.band[1])


def stabilisation(study: OrderStudy) -> tuple[OrderCandidate, ...]:
    """Return the pole pairs of all orders."""
    tried: list[OrderCandidate] = []
    before = np.zeros((0, 2))
    for order, gap, poles in zip(study.orders, study.gaps, study.poles, strict=True):
        upper = poles[poles.imag > 0.0]
        now = np.stack((np.abs(upper) / (2.0 * np.pi), -upper.real / np.abs(upper)), axis=1)
        pairs = tuple(PolePair(float(f), float(d), _is_stable(f, d, before)) for f, d in now)
        tried.append(OrderCandidate(order, float(gap), pairs))
        before = now
    return tuple(tried)


def _is_stable(frequency: float, damping: float, before: Array) -> bool:
    near = np.abs(before[:, 0] - frequency) <= STEADY_FREQUENCY * frequency
    similar = np.abs(before[:, 1] - damping) <= STEADY_DAMPING * abs(damping)
    return bool((near & similar).any())


def plot_stabilisation(orders: Orders, path: str | Path) -> None:
    """Write a PNG of the poles over frequency and order, and of the gaps of the singular values."""
    figure = new_figure(11.0, 4.6)
    poles, gaps = figure.subplots(1, 2, sharey=True, width_ratios=(4, 1))
    _poles(poles, orders)
    gaps.barh([one.states for one in orders.tried], [one.gap for one in orders.tried], height=1.2)
    gaps.axhline(orders.chosen, color="tab:red", linewidth=1.0)
    gaps.axvline(CLEAR_GAP, color="0.5", linewidth=1.0, linestyle="--", label="clear gap")
    gaps.set(title="gap", xlabel="ratio to next singular value", xscale="log")
    ticks_at_1_2_5(gaps)
    gaps.legend(fontsize="small", loc="upper right")
    save(figure, path, format="png")


def _poles(axes: Axes, orders: Orders) -> None:
    placed = [(one.states, pole) for one in orders.tried for pole in one.poles if pole.frequency <= 1.2 * orders.high]
    for steady, marker, label in ((True, "o", "stable"), (False, "x", "not stable")):
        chosen = [(pole.frequency, states) for states, pole in placed if pole.steady is steady]
        axes.plot([f for f, _ in chosen], [states for _, states in chosen], marker, markersize=5, label=label)
    why = "a clear gap" if orders.is_clear else "no clear gap"
    axes.axhline(orders.chosen, color="tab:red", linewidth=1.0, label=f"{orders.chosen} states, {why}")
    top = orders.tried[-1].states + 5.0  # space for the legend
    axes.set(title="stabilisation diagram", xlabel="frequency [Hz]", ylabel="states", ylim=(0.0, top))
    axes.legend(loc="upper left", ncols=3, fontsize="small")
    axes.grid(alpha=0.3)
