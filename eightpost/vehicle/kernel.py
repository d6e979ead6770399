"""Exact time stepping of a linear model `x' = A x + B u`, `y = C x + D u`.

The python FMU of a vehicle contains this file, so it imports numpy and scipy.linalg only.
"""

from __future__ import annotations

from collections import OrderedDict
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from scipy.linalg import expm, matrix_balance, svd

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]

#: Number of discretisations that a stepper caches. A master that accumulates its time makes steps that differ by
#: rounding errors, so one nominal step needs several entries.
CACHE_SIZE = 32

#: Smallest singular value, relative to the largest and to the number of states, that does not count as zero.
_SINGULAR = 100.0 * float(np.finfo(np.float64).eps)


class Discrete(NamedTuple):
    """Matrices of one exact step: `x(t+h) = Ad x(t) + B0 u(t) + B1 u(t+h)` for inputs that are linear over the step.

    Inputs that are held over the step have `u(t+h) = u(t)`: `x(t+h) = Ad x(t) + (B0 + B1) u(t)`.
    """

    Ad: Array
    B0: Array
    B1: Array


def discretise(A: Array, B: Array, step: float) -> Discrete:
    """Discretise `x' = A x + B u` exactly for inputs that are linear over a step h > 0 [s].

    With `Z = [[A, B, 0], [0, 0, I/h], [0, 0, 0]]` the top row of `exp(Z h)` is `[Ad, G1, G2]`. `G1` is the
    response to a constant 1 over the step and `G2` that to a ramp from 0 to 1, so `B0 = G1 - G2` and `B1 = G2`.
    No matrix is inverted, so `A` may be singular.

    Raises:
        ValueError: The step is not a finite number above zero.

    The result is valid for any step at which `exp(A h)` is finite; tested from 1e-7 to 0.05 s.
    Source: C. Van Loan, "Computing integrals involving the matrix exponential", IEEE TAC 23 (1978) 395-404,
    doi 10.1109/TAC.1978.1101743.
    """
    if not (np.isfinite(step) and step > 0.0):
        raise ValueError(f"the step is {step!r} s; give a finite number above zero")
    n, m = B.shape
    scale = _input_scale(A, B)
    Z = np.zeros((n + 2 * m, n + 2 * m))
    Z[:n, :n] = A * step
    Z[:n, n : n + m] = B * (step / scale)
    Z[n : n + m, n + m :] = np.eye(m)
    top = expm(Z)[:n]
    held, ramp = top[:, n : n + m] * scale, top[:, n + m :] * scale
    return Discrete(np.ascontiguousarray(top[:, :n]), held - ramp, ramp)


def _input_scale(A: Array, B: Array) -> Array:
    """Return powers of two that scale the columns of `B` to the size of `A`, without rounding errors.

    Without them, a large `B` would cause more scaling and squaring in the exponential than `A` needs.
    """
    ratio = np.abs(B).max(axis=0, initial=0.0) / max(1.0, float(np.abs(A).max(initial=0.0)))
    exponents = np.ceil(np.log2(np.maximum(ratio, 1.0)))
    return np.asarray(np.exp2(exponents), dtype=np.float64)


def balance(A: Array) -> tuple[Array, Array]:
    """Return `S^-1 A S` with rows and columns of similar size, and the diagonal of S (n,), powers of two.

    Entries below 1e-40 of the largest are ignored, because they would drive the scaling to its limits.
    """
    counted = np.where(np.abs(A) < 1e-40 * np.abs(A).max(initial=0.0), 0.0, A)
    with np.errstate(invalid="ignore"):  # scipy converts the scaling to integers
        _, (scaling, _) = matrix_balance(counted, permute=False, separate=True)
    return np.asarray(A * scaling / scaling[:, None]), np.asarray(scaling, dtype=np.float64)


def equilibrium(A: Array, B: Array, u: Array) -> Array:
    """Solve `0 = A x + B u`, the steady state x (n,) or (n, k) of constant inputs u (m,) or (m, k).

    Raises:
        ValueError: `A` is singular to working precision, so that there is no steady state, or many.
    """
    if A.shape[0] == 0:
        return np.zeros((0, *u.shape[1:]))
    balanced, scaling = balance(A)
    left, singular, right = svd(balanced)
    if singular[-1] <= _SINGULAR * A.shape[0] * singular[0]:
        raise ValueError(
            f"no unique steady state: the state matrix is singular (its smallest singular value is "
            f"{singular[-1]:.3g}, its largest {singular[0]:.3g}), so a part of the model is free to drift; "
            "constrain that part (is a stiffness zero?) or start from given states"
        )
    load = ((B @ u).T / scaling).T
    solution = right.T @ ((left.T @ load).T / singular).T
    return np.asarray(-(solution.T * scaling).T, dtype=np.float64)


class LinearStepper:
    """Linear model `x' = A x + B u`, `y = C x + D u` with exact steps of any size.

    The caller stores the state, so saving and restoring it means saving and restoring one array.
    """

    def __init__(self, A: Array, B: Array, C: Array, D: Array) -> None:
        """Store the matrices (n, n), (n, m), (p, n), (p, m); they are not copied."""
        self.A, self.B, self.C, self.D = A, B, C, D
        self._steps: OrderedDict[float, Discrete] = OrderedDict()

    def discrete(self, h: float) -> Discrete:
        """Return the matrices of one step of `h` seconds, from the cache if possible."""
        known = self._steps.get(h)
        if known is not None:
            self._steps.move_to_end(h)
            return known
        new = discretise(self.A, self.B, h)
        self._steps[h] = new
        if len(self._steps) > CACHE_SIZE:
            self._steps.popitem(last=False)
        return new

    def advance(self, x: Array, u0: Array, u1: Array, h: float) -> Array:
        """Return the exact state (n,) after `h` seconds for inputs (m,) that change linearly from `u0` to `u1`.

        Raises:
            ValueError: The step is not a finite number above zero.
        """
        Ad, B0, B1 = self.discrete(h)
        return np.asarray(Ad @ x + B0 @ u0 + B1 @ u1, dtype=np.float64)

    def output(self, x: Array, u: Array) -> Array:
        """Return the outputs (p,) for state `x` (n,) and inputs `u` (m,)."""
        return np.asarray(self.C @ x + self.D @ u, dtype=np.float64)

    def equilibrium(self, u: Array) -> Array:
        """Return the steady state (n,) of constant inputs `u` (m,).

        Raises:
            ValueError: There is no steady state, or more than one.
        """
        return equilibrium(self.A, self.B, u)
