"""Stability of an identified vehicle with shocks."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import product
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from eightpost.array_types import Array
from eightpost.ident.vehicle.experiment import channel
from eightpost.vehicle import kernel

if TYPE_CHECKING:
    from eightpost.vehicle import IdentifiedVehicle, StateSpace


# ---- Detection of the intervals in which stepped loads are held constant --------------------------------------------

#: Loads are held if they change by less than `_STILL` of their range within `_LOOK` [s], for at least `_SHORTEST` [s].
_STILL, _LOOK, _SHORTEST = 0.01, 0.2, 1.0


def holds(rows: Array, rate: float) -> list[slice]:
    """Return the second half of every hold, when oscillations have decayed.

    Args:
        rows: Loads (A, N).
        rate: Sample rate [Hz].
    """
    look = max(1, round(_LOOK * rate))
    change = np.abs(rows[:, look:] - rows[:, :-look]).max(axis=0)
    still = np.concatenate(([False], change <= _STILL * np.ptp(rows, axis=1).max(), [False]))
    edges = np.flatnonzero(np.diff(still.astype(int)))
    spans = [(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True) if b - a >= _SHORTEST * rate]
    return [slice((start + stop) // 2, stop) for start, stop in spans]


# ---- Exact discretisation of models whose states form many independent parts, such as parallel sections -------------


def discretise_by_parts(A: Array, B: Array, step: float) -> kernel.Discrete:
    """Return `kernel.discretise(A, B, step)`, computed part by part, as one for 1200 states takes minutes."""
    count, part = connected_components(csr_array(A != 0.0), directed=False)
    Ad, B0, B1 = np.zeros_like(A), np.zeros_like(B), np.zeros_like(B)
    for number in range(count):
        states = np.flatnonzero(part == number)
        driven = np.flatnonzero(B[states].any(axis=0))
        found = kernel.discretise(A[np.ix_(states, states)], B[np.ix_(states, driven)], step)
        Ad[np.ix_(states, states)] = found.Ad
        B0[np.ix_(states, driven)], B1[np.ix_(states, driven)] = found.B0, found.B1
    return kernel.Discrete(Ad, B0, B1)


# ---- Stability of an identified vehicle with linear dampers ---------------------------------------------------------

#: Dampers to try, relative to the baseline damping [1].
FACTORS = (0.25, 0.45, 0.7, 1.5, 2.0, 3.0)


class Stability(NamedTuple):
    """Stability with all dampers that were tried.

    Attributes:
        stable: Whether the vehicle is stable with all dampers that were tried.
        worst: Damping of the loop with the largest growth rate [N.s/m], by port.
        growth: Largest real part of that loop's poles [1/s]; the loop is unstable if it is above zero.
        tried: Number of sets of dampers that were tried.
    """

    stable: bool
    worst: Mapping[str, float]
    growth: float
    tried: int

    def summary(self) -> str:
        """Return the result as a sentence."""
        if self.stable:
            return (
                f"the loop is stable with all {self.tried} sets of linear dampers from {FACTORS[0]:g} to "
                f"{FACTORS[-1]:g} times the baseline damping"
            )
        rates = ", ".join(f"{port or 'port'} {rate:.0f}" for port, rate in self.worst.items())
        return f"UNSTABLE: with dampers of {rates} N.s/m a motion grows at a rate of {self.growth:.2g} 1/s"


def closed_loop_stability(vehicle: IdentifiedVehicle, factors: Sequence[float] = FACTORS) -> Stability:
    """Return the stability of the loop closed with linear dampers, changed all together and one at a time.

    Only the states between shock forces and shock velocities are in the loop (Fig 6.25); all others are stable as
    fitted.

    Args:
        vehicle: Identified continuous vehicle.
        factors: Dampers to try, relative to the baseline damping [1].
    """
    ports = tuple(vehicle.baseline_damping)
    loop = _port_model(vehicle.state_space, ports)
    baseline = np.array([vehicle.baseline_damping[port] for port in ports])
    worst, growth, tried = baseline, -np.inf, 0
    for scale in _scales(len(ports), factors):
        closed = loop.A + loop.B @ np.diag((scale - 1.0) * baseline) @ loop.C
        largest = float(np.linalg.eigvals(closed).real.max(initial=-np.inf))
        tried += 1
        if largest > growth:
            worst, growth = scale * baseline, largest
    return Stability(growth < 0.0, dict(zip(ports, worst.tolist(), strict=True)), growth, tried)


class _Ports(NamedTuple):
    A: Array
    B: Array
    C: Array


def _scales(ports: int, factors: Sequence[float]) -> Iterator[Array]:
    yield np.ones(ports)
    for factor in factors:
        yield np.full(ports, factor)
    if ports > 1:
        for port, factor in product(range(ports), factors):
            yield np.where(np.arange(ports) == port, factor, 1.0)


def _port_model(model: StateSpace, ports: Sequence[str]) -> _Ports:
    """Return the model between shock forces and shock velocities without uncontrollable and unobservable parts."""
    chosen = model.select(
        inputs=[channel(port, "force") for port in ports], outputs=[channel(port, "velocity") for port in ports]
    )
    count, part = connected_components(csr_array(chosen.A != 0.0), directed=False)
    driven = np.array([chosen.B[part == k].any() and chosen.C[:, part == k].any() for k in range(count)], dtype=bool)
    kept = np.flatnonzero(driven[part])
    return _Ports(chosen.A[np.ix_(kept, kept)], chosen.B[kept], chosen.C[:, kept])
