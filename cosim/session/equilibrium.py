"""Equilibrium start: inputs and outputs that agree in initialization mode, before t = 0."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from cosim.systems.coupling import Coupling

_SWEEPS = 30
_TOLERANCE = 1e-12


@dataclass(frozen=True, slots=True)
class Equilibrium:
    """Status of the equilibrium start."""

    converged: bool  #: Whether every connection agrees to 1e-9 of its size.
    sweeps: int  #: Number of evaluations of all components.
    residual: float  #: Largest remaining disagreement, relative to its connection's size.


def solve_equilibrium(coupling: Coupling, order: tuple[str, ...]) -> Equilibrium:
    """Make inputs and outputs agree in initialization mode, gas force included; leave the outputs in `coupling.now`.

    The components are evaluated one after the other first, which is sufficient for weak springs across a bond. If this
    does not converge, the connected outputs are solved for by a Newton-like method (MINPACK's hybrd).
    """
    names = _connected(coupling)
    _sweep(coupling, order)
    residual = np.inf
    for sweep in range(2, _SWEEPS):
        before = _vector(coupling, names)
        _sweep(coupling, order)
        residual = _relative(_vector(coupling, names) - before, before)
        if residual <= _TOLERANCE:
            return Equilibrium(converged=True, sweeps=sweep, residual=residual)
    return _solve(coupling, order, names)


def _solve(coupling: Coupling, order: tuple[str, ...], names: list[str]) -> Equilibrium:
    evaluations = 0

    def disagreement(values: NDArray[np.float64]) -> NDArray[np.float64]:
        nonlocal evaluations
        evaluations += 1
        coupling.now.update(zip(names, values.tolist(), strict=True))
        _sweep_at_once(coupling, order)
        return np.asarray(_vector(coupling, names) - values)

    start = np.nan_to_num(_vector(coupling, names), posinf=0.0, neginf=0.0)
    solution = scipy.optimize.root(
        disagreement, np.where(np.abs(start) < 1e12, start, 0.0), method="hybr", tol=_TOLERANCE
    )
    residual = _relative(disagreement(solution.x), solution.x)
    return Equilibrium(converged=residual <= 1e-9, sweeps=_SWEEPS + evaluations, residual=residual)


def _connected(coupling: Coupling) -> list[str]:
    return sorted({term.source for feeds in coupling.feeds.values() for feed in feeds for term in feed.terms})


def _sweep(coupling: Coupling, order: tuple[str, ...]) -> None:
    """Evaluate the components one after the other, each with the newest values."""
    for name in order:
        coupling.feed_start(name)
        coupling.now.update(coupling.read(name))


def _sweep_at_once(coupling: Coupling, order: tuple[str, ...]) -> None:
    """Evaluate every component with the same values."""
    for name in order:
        coupling.feed_start(name)
        coupling.ahead.update(coupling.read(name))
    coupling.accept()


def _vector(coupling: Coupling, names: list[str]) -> NDArray[np.float64]:
    return np.array([coupling.now[name] for name in names])


def _relative(change: NDArray[np.float64], values: NDArray[np.float64]) -> float:
    return float(np.max(np.abs(change) / (np.abs(values) + 1.0), initial=0.0))
