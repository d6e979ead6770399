"""Common-pole model made of real second-order blocks; each is a pair of poles shared by all paths.

    x_k' = [[0, w], [-w, -2 zeta w]] x_k + B_k u,    y = sum_k C_k x_k + D u

The block's poles are the zeros of s^2 + 2 zeta w s + w^2: a complex pair or two real poles, stable for any w and zeta
above zero. One block per pair is the minimal realisation, as each residue has rank one.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.linalg import block_diag

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]
    Complex = NDArray[np.complex128]


#: Lower limit of the damping ratio of a block [1].
_LIGHTEST = 1e-6


@dataclass(frozen=True, slots=True, eq=False)
class Blocks:
    """Poles and input matrices of N blocks.

    Attributes:
        w: Natural frequencies [1/s] (N,), above zero.
        zeta: Damping ratios [1] (N,), above zero.
        B: Input matrices (N, 2, m).
    """

    w: Array
    zeta: Array
    B: Array

    @property
    def states(self) -> int:
        """The number of states."""
        return 2 * self.w.size

    @property
    def poles(self) -> Complex:
        """The poles (2 N,) [1/s]."""
        root = np.sqrt(self.zeta.astype(np.complex128) ** 2 - 1.0)
        return np.concatenate((self.w * (-self.zeta + root), self.w * (-self.zeta - root)))

    @property
    def A(self) -> Array:  # noqa: N802  the symbol of the equation
        """The state matrix (2 N, 2 N)."""
        return np.asarray(block_diag(*self._matrices()), dtype=np.float64)

    @property
    def input_matrix(self) -> Array:
        """The input matrix (2 N, m)."""
        return self.B.reshape(self.states, -1)

    def _matrices(self) -> Array:
        zero = np.zeros_like(self.w)
        return np.stack((np.stack((zero, self.w), -1), np.stack((-self.w, -2.0 * self.zeta * self.w), -1)), -2)

    def resolvent(self, s: Complex) -> Complex:
        """Return (s I - A_k)^-1 (N, 2, 2, K)."""
        w, z = self.w[:, None], self.zeta[:, None]
        divisor = s**2 + 2.0 * z * w * s + w**2
        full = np.broadcast_to(w, divisor.shape)
        rows = [[s + 2.0 * z * w, full], [-full, s + 0.0 * w]]
        return np.asarray(np.stack([np.stack(row, 1) for row in rows], 1) / divisor[:, None, None, :])

    def states_response(self, s: Complex) -> Complex:
        """Return (s I - A)^-1 B (2 N, m, K)."""
        response = np.einsum("nabk,nbj->najk", self.resolvent(s), self.B)
        return np.asarray(response.reshape(self.states, self.B.shape[2], s.size))

    def normalised(self) -> Blocks:
        """Return the same poles with the input matrix of every block scaled to norm 1."""
        size = np.linalg.norm(self.B, axis=(1, 2), keepdims=True)
        return Blocks(self.w, self.zeta, self.B / np.where(size > 0.0, size, 1.0))


def blocks_of(poles: Complex, C: Complex) -> tuple[Blocks, Array]:
    """Return blocks with the given poles and without inputs (m = 0), and their output matrix (p, 2 N).

    Args:
        poles: Stable poles [1/s] (2 N,); complex ones in conjugate pairs.
        C: Mode shapes (p, 2 N), in the same conjugate pairs: outputs per modal coordinate.
    """
    w, zeta, outputs = [], [], []
    for first, second in _pairs(poles):
        product, total = float((poles[first] * poles[second]).real), float((poles[first] + poles[second]).real)
        rate = np.sqrt(product)
        w.append(rate)
        zeta.append(max(-0.5 * total / rate, _LIGHTEST))
        # Modal coordinates of the block: x = T (z1, z2) with rows (1, 1) and (lambda1, lambda2) / w.
        T = np.array([[1.0, 1.0], [poles[first] / rate, poles[second] / rate]])
        outputs.append(np.real(C[:, [first, second]] @ np.linalg.inv(T)))
    return Blocks(np.array(w), np.array(zeta), np.zeros((len(w), 2, 0))), np.concatenate(outputs, axis=1)


def _pairs(poles: Complex) -> list[tuple[int, int]]:
    """Pair each complex pole with its conjugate and each real pole with the next faster one."""
    upper = [int(i) for i in np.flatnonzero(poles.imag > 0.0)]
    pairs = [(i, int(np.argmin(np.abs(poles - poles[i].conj())))) for i in upper]
    real = sorted((int(i) for i in np.flatnonzero(poles.imag == 0.0)), key=lambda i: float(abs(poles[i])))
    return pairs + list(zip(real[::2], real[1::2], strict=True))
