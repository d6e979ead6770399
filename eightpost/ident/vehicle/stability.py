"""Stability of an identified vehicle with shocks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import product
from typing import NamedTuple

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from eightpost.array_types import Array
from eightpost.corners import channel
from eightpost.vehicle import IdentifiedVehicle, StateSpace, add_port_damping, kernel
from eightpost.vehicle.vehicles import GROWTH_WITHOUT

# ---- Exact discretisation of models whose states form many independent parts, such as parallel sections -------------


def discretise_by_parts(A: Array, B: Array, step: float) -> kernel.Discrete:
    """Return `kernel.discretise(A, B, step)`, computed part by part, as one for 1200 states takes minutes."""
    count, part = connected_components(csr_array(A != 0.0), directed=False)
    Ad, B0, B1 = np.zeros_like(A), np.zeros_like(B), np.zeros_like(B)
    for number in range(count):
        states = np.flatnonzero(part == number)
        driven = np.flatnonzero(B[states].any(axis=0))
        exact = kernel.discretise(A[np.ix_(states, states)], B[np.ix_(states, driven)], step)
        Ad[np.ix_(states, states)] = exact.Ad
        B0[np.ix_(states, driven)], B1[np.ix_(states, driven)] = exact.B0, exact.B1
    return kernel.Discrete(Ad, B0, B1)


# ---- Stability of an identified vehicle with linear dampers ---------------------------------------------------------

#: Dampers to try, relative to the baseline damping [1].
FACTORS = (0.25, 0.45, 0.7, 1.5, 2.0, 3.0)


class Stability(NamedTuple):
    """Stability with all dampers that were tried."""

    #: Whether the vehicle is stable with all dampers that were tried, and grows slowly without any.
    stable: bool
    worst: Mapping[str, float]  #: Damping of the loop with the largest growth rate [N.s/m], by port.
    growth: float  #: Largest real part of that loop's poles [1/s]; the loop is unstable if it is above zero.
    tried: int  #: Number of sets of dampers that were tried.

    def summary(self) -> str:
        """Return the result as a sentence."""
        if self.stable:
            return (
                f"the loop is stable with all {self.tried} sets of linear dampers from {FACTORS[0]:g} to "
                f"{FACTORS[-1]:g} times the baseline damping"
            )
        rates = ", ".join(f"{port or 'port'} {rate:.0f}" for port, rate in self.worst.items())
        return f"UNSTABLE: with dampers of {rates} N.s/m a motion grows at a rate of {self.growth:.2g} 1/s"


def closed_loop_stability(vehicle: IdentifiedVehicle) -> Stability:
    """Return the stability of the loop closed with linear dampers, changed by `FACTORS` all together and one at a time.

    Without dampers, motions may grow slowly: a car that is nearly undamped may be found so. Only the states between
    shock forces and shock velocities are in the loop (Fig 6.25); all others are stable as fitted.
    """
    ports = tuple(vehicle.baseline_damping)
    A, B, C = _port_model(vehicle.state_space, ports)
    count, baseline = len(ports), np.array(list(vehicle.baseline_damping.values()))
    scales = [np.ones(count), *(np.full(count, factor) for factor in FACTORS)]
    if count > 1:
        scales += [np.where(np.arange(count) == port, f, 1.0) for port, f in product(range(count), FACTORS)]

    def growth_with(scale: Array) -> float:
        poles = np.linalg.eigvals(A + B @ np.diag((scale - 1.0) * baseline) @ C)
        return float(poles.real.max(initial=-np.inf))

    growths = [growth_with(scale) for scale in scales]
    worst, growth = scales[int(np.argmax(growths))] * baseline, max(growths)
    without = growth_with(np.zeros(count))
    if without > max(growth, GROWTH_WITHOUT):
        worst, growth = 0.0 * baseline, without
    return Stability(growth < 0.0, dict(zip(ports, worst.tolist(), strict=True)), growth, len(scales))


def _port_model(model: StateSpace, ports: Sequence[str]) -> tuple[Array, Array, Array]:
    """Return A, B, C between shock forces and velocities without uncontrollable and unobservable parts."""
    chosen = model.select(
        inputs=[channel(port, "force") for port in ports], outputs=[channel(port, "velocity") for port in ports]
    )
    count, part = connected_components(csr_array(chosen.A != 0.0), directed=False)
    driven = np.array([chosen.B[part == k].any() and chosen.C[:, part == k].any() for k in range(count)], dtype=bool)
    states = np.flatnonzero(driven[part])
    return chosen.A[np.ix_(states, states)], chosen.B[states], chosen.C[:, states]


# ---- Range of shock slopes with proved stability --------------------------------------------------------------------

#: Lower slopes that are tested, and the upper slope, relative to the baseline dampers [1].
SOFTEST, STIFFEST = (0.0, 0.02, 0.05, 0.1, 0.2, 0.35, 0.5), 10.0

#: Frequencies at which the criterion is evaluated [Hz].
_FREQUENCIES = np.geomspace(0.01, 2000.0, 700)


class _SafeSlopes(NamedTuple):
    """Range of shock slopes with proved stability."""

    softest: float | None  #: Lowest safe slope relative to the baseline damper [1]; None if no tested slope is safe.
    stiffest: float  #: Highest safe slope relative to the baseline damper [1].
    worst: float  #: Frequency at which the criterion is closest to failing, or fails for the last tested slope [Hz].

    def summary(self) -> str:
        """Return the result as a sentence."""
        if self.softest is None:
            return (
                f"Stability with any shocks is not proved: the circle criterion fails near {self.worst:.3g} Hz even "
                f"for slopes from {SOFTEST[-1]:g} to {self.stiffest:g} times the baseline dampers; simulate every "
                "bank at its lowest and highest slopes."
            )
        return (
            f"The car is stable with any shocks whose slopes are from {self.softest:g} to {self.stiffest:g} times the "
            f"baseline dampers (circle criterion, closest to failing at {self.worst:.3g} Hz)."
        )


def safe_slopes(model: StateSpace, baseline: Mapping[str, float]) -> _SafeSlopes:
    """Return the range of shock slopes with which the car is proved stable by the circle criterion.

    Let M be the port mobility (velocity per opposing force) with dampers of c_low at all ports. A shock whose slope
    dF/dv is everywhere between c_low and c_high cannot make the loop unstable if

        M(j w) + M(j w)* + 2 / (c_high - c_low)  is positive definite at every frequency, and M itself is stable

    This circle criterion covers any curve with slopes in the range and any mix of shocks, so it is stricter than
    stability with some linear dampers.

    Source: H. K. Khalil, "Nonlinear Systems", 3rd ed., 2002, section 7.1 (multivariable circle criterion).

    Args:
        baseline: Baseline damping C-bar [N.s/m] by port.
    """
    ports = model.select(
        inputs=[channel(port, "force") for port in baseline], outputs=[channel(port, "velocity") for port in baseline]
    )
    worst = 0.0
    for softest in SOFTEST:
        safe, worst = _criterion(ports, baseline, softest)
        if safe:
            return _SafeSlopes(softest, STIFFEST, worst)
    return _SafeSlopes(None, STIFFEST, worst)


def _criterion(ports: StateSpace, baseline: Mapping[str, float], softest: float) -> tuple[bool, float]:
    """Return whether the criterion is satisfied, and the frequency at which it is closest to failing [Hz]."""
    soft = add_port_damping(ports, {port: (softest - 1.0) * rate for port, rate in baseline.items()})
    poles = soft.poles()
    if (poles.real >= 0.0).any():
        return False, float(np.abs(poles[np.argmax(poles.real)]) / (2.0 * np.pi))
    rates = np.sqrt(np.array(list(baseline.values())))
    # Mobility times damping is dimensionless; 1 is a port whose motion only its damper resists.
    M = -soft.frequency_response(_FREQUENCIES).transpose(2, 0, 1) * np.outer(rates, rates)
    slack = 2.0 / (STIFFEST - softest) * np.eye(rates.size)
    smallest = np.linalg.eigvalsh(M + M.conj().transpose(0, 2, 1) + slack)[:, 0]
    return bool(smallest.min() > 0.0), float(_FREQUENCIES[np.argmin(smallest)])
