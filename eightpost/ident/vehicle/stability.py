"""Whether an identified vehicle settles with every damper it may meet."""

from __future__ import annotations

from itertools import product
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from eightpost.ident.vehicle.experiment import channel

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from numpy.typing import NDArray

    from eightpost.vehicle import IdentifiedVehicle, StateSpace

    Array = NDArray[np.float64]

#: Dampers that are tried, as parts of the baseline's.
FACTORS = (0.25, 0.45, 0.7, 1.5, 2.0, 3.0)


class Stability(NamedTuple):
    """What came out.

    Attributes:
        stable: Whether the vehicle settled with all dampings that were tried.
        worst: The damping [N.s/m] by port of the least stable loop.
        growth: Its largest real part [1/s]; above zero it grows.
        tried: How many there were.
    """

    stable: bool
    worst: Mapping[str, float]
    growth: float
    tried: int

    def said(self) -> str:
        """Return it as a sentence."""
        if self.stable:
            return (
                f"the loop is stable with all {self.tried} sets of linear dampers from {FACTORS[0]:g} to "
                f"{FACTORS[-1]:g} times the baseline's"
            )
        rates = ", ".join(f"{port or 'port'} {rate:.0f}" for port, rate in self.worst.items())
        return f"UNSTABLE: with dampers of {rates} N.s/m a motion grows by {self.growth:.2g} 1/s"


def closed_loop_stability(vehicle: IdentifiedVehicle, factors: Sequence[float] = FACTORS) -> Stability:
    """Close the loop with linear dampers, all alike and each alone different, and judge the poles.

    Only what lies between shock forces and shock velocities is in the loop (Fig 6.25); the rest is stable as fitted.

    Args:
        vehicle: As identified, continuous.
        factors: Dampers, as parts of the baseline's.
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
    """Return the states between forces and velocities: parts that are not driven, or not seen, are left out."""
    chosen = model.select(
        inputs=[channel(port, "force") for port in ports], outputs=[channel(port, "velocity") for port in ports]
    )
    count, part = connected_components(csr_array(chosen.A != 0.0), directed=False)
    driven = np.array([chosen.B[part == k].any() and chosen.C[:, part == k].any() for k in range(count)], dtype=bool)
    kept = np.flatnonzero(driven[part])
    return _Ports(chosen.A[np.ix_(kept, kept)], chosen.B[kept], chosen.C[:, kept])
