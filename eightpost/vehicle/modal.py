"""Modal form of a linear model: one complex state per pair of eigenvalues, one real state per real eigenvalue.

Each mode is an independent scalar equation, so a step of any size needs scalar exponentials only. Modes whose
eigenvectors are nearly dependent, such as two equal modes that share an eigenvector, have no accurate form of their
own: their states remain coupled in a block. The native FMU of a vehicle is written from this form.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from scipy.linalg import block_diag, lapack, schur, svd
from scipy.sparse.csgraph import connected_components

from eightpost.array_types import Array, Complex
from eightpost.errors import ParameterError
from eightpost.vehicle import kernel

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from eightpost.vehicle.statespace import StateSpace


#: Relative accuracy of outputs that a modal form must reach.
ACCURACY = 1e-10

#: Largest condition number of the eigenvectors; beyond it, some states remain coupled. The rounding error of the sum
#: over the modes is up to twice this number (measured: 1.9 times, on random models with nearly equal eigenvalues).
WORST_CONDITION = ACCURACY / (2.0 * float(np.finfo(np.float64).eps))

_TIE = 1.0 - 1e-6


@dataclass(frozen=True, slots=True, eq=False)
class ModalForm:
    """Linear model in modal form, with a complex state z_k and `lambda_k = sigma_k + i omega_k` per mode.

        z_k' = lambda_k z_k + (B_re_k + i B_im_k) u
        y = sum_k (C_re_k Re z_k + C_im_k Im z_k) + D u

    The pairs come first, then the real modes (omega = 0, B_im = 0, C_im = 0, so that z is real). Each group is in
    increasing order of |lambda|. In each mode the largest entries of B and C have about the same size. The last of the
    real states may be coupled states, which are no modes: sigma is zero there, and `z' = coupling z + B_re u`.
    """

    sigma: Array  #: Real parts (K,) [1/s].
    omega: Array  #: Imaginary parts (K,) [1/s], above zero for a pair, zero for a real mode.
    B_re: Array  #: Real parts of the modes' inputs (K, m).
    B_im: Array  #: Imaginary parts of the modes' inputs (K, m).
    C_re: Array  #: Outputs per Re z (p, K).
    C_im: Array  #: Outputs per Im z (p, K).
    D: Array  #: Direct terms (p, m).
    coupling: Array  #: State matrix of the last d states, which are coupled (d, d) [1/s].
    steady: bool  #: Whether constant inputs have a unique steady state, according to `kernel.equilibrium`.

    def __post_init__(self) -> None:
        for name in ("sigma", "omega", "B_re", "B_im", "C_re", "C_im", "D", "coupling"):
            array = np.array(getattr(self, name), dtype=np.float64, order="C") + 0.0  # no negative zeros
            array.setflags(write=False)
            object.__setattr__(self, name, array)

    @property
    def pairs(self) -> int:
        """Number of modes that are pairs of eigenvalues; they come first."""
        return int(np.count_nonzero(self.omega))

    @property
    def uncoupled(self) -> int:
        """Number of modes; they come before the coupled states."""
        return self.sigma.size - len(self.coupling)

    @property
    def eigenvalues(self) -> Complex:
        """Eigenvalues, one per mode [1/s]; for a pair the one with positive imaginary part."""
        return np.asarray(self.sigma + 1j * self.omega)[: self.uncoupled]

    def at_rest(self) -> Complex:
        """Return z (K, m) in the steady states of the inputs, each of them 1; there must be one (`steady`)."""
        modes, b = self.uncoupled, self.B_re + 1j * self.B_im
        coupled = np.linalg.solve(self.coupling, b[modes:])
        return np.asarray(-np.concatenate([b[:modes] / self.eigenvalues[:, None], coupled]), dtype=np.complex128)


def modal_form(model: StateSpace) -> ModalForm:
    """Return the complete modal form of a continuous model; equal models give bitwise equal results.

    Parts of the model that do not act on each other are separated first, so that they remain exactly uncoupled and may
    have equal eigenvalues. Each part is balanced, `A V = V Lambda` gives its modes, and `V^-1 B`, `C V` its inputs
    and outputs. The phase of an eigenvector is chosen so that its largest entry is real and positive.

    If V is ill-conditioned, the invariant subspaces of the eigenvalues have orthonormal bases from ordered real Schur
    forms. Subspaces that are nearly dependent are joined until the bases together are well-conditioned; joined ones
    remain coupled.

    Raises:
        ParameterError: The model is discrete.

    Source: G. H. Golub, C. F. Van Loan, "Matrix Computations", 4th ed., 2013, chapter 7 (diagonal form, condition of
    eigenvectors, balancing, ordered Schur form, block diagonal form).
    """
    if model.dt is not None:
        raise ParameterError(f"{model.name}: a discrete model has no modal form; convert it to continuous time first")
    modes, groups = [], []
    for states in _separate_parts(model.A):
        uncoupled, coupled = _resolved(model, states)
        modes += uncoupled
        groups += coupled
    modes.sort(key=lambda mode: (mode.eigenvalue.imag == 0.0, abs(mode.eigenvalue)))
    return _collected(model, modes, groups)


@dataclass(frozen=True, slots=True)
class _Mode:
    """Scaled mode: `z' = eigenvalue z + b u`, with the contribution `Re(c z)` to the outputs."""

    eigenvalue: complex
    b: Complex
    c: Complex


class _Group(NamedTuple):
    """Scaled states that are coupled: `z' = matrix z + b u`, with the contribution `c z` to the outputs."""

    matrix: Array
    b: Complex
    c: Complex


class _Subspace(NamedTuple):
    """Invariant subspace of a state matrix A: the places of its eigenvalues, and `A basis = basis matrix`."""

    places: tuple[int, ...]
    basis: Array
    matrix: Array

    @property
    def is_mode(self) -> bool:
        """Whether it belongs to one real eigenvalue or to one pair."""
        return len(self.matrix) == 1 or (len(self.matrix) == 2 and self.matrix[1, 0] != 0.0)


def _separate_parts(A: Array) -> list[NDArray[np.intp]]:
    """Return the states of each uncoupled part of the model, in increasing order."""
    if not len(A):
        return []
    count, label = connected_components(A != 0.0, directed=False)
    return [np.flatnonzero(label == k) for k in range(count)]


def _resolved(model: StateSpace, states: NDArray[np.intp]) -> tuple[list[_Mode], list[_Group]]:
    """Return modes and groups of one part; a pair has its upper eigenvalue, which adds `Re(2 C v z)` to the outputs."""
    balanced, scaling = kernel.balance(model.A[np.ix_(states, states)])
    eigenvalues, vectors = np.linalg.eig(balanced)
    coupled: list[_Subspace] = []
    if not np.linalg.cond(vectors) <= WORST_CONDITION:
        subspaces = _subspaces(balanced)
        coupled = [space for space in subspaces if not space.is_mode]
        pairs = [_eigenpair(space) for space in subspaces if space.is_mode]
        eigenvalues = np.array([eigenvalue for eigenvalue, _ in pairs], dtype=np.complex128)
        vectors = np.array([vector for _, vector in pairs], dtype=np.complex128).reshape(len(pairs), len(states)).T
    upper = eigenvalues.imag >= 0.0
    eigenvalues, vectors = eigenvalues.astype(np.complex128)[upper], _phased(vectors.astype(np.complex128)[:, upper])
    pair = eigenvalues.imag > 0.0
    B, *others = _inputs(vectors, pair, [space.basis for space in coupled], model.B[states] / scaling[:, None])
    out = model.C[:, states] * scaling
    C = np.asarray(out @ np.where(pair, 2.0 * vectors, vectors.real), dtype=np.complex128)
    modes = [_Mode(complex(e), *_scaled(B[k], C[:, k])) for k, e in enumerate(eigenvalues)]
    groups = [
        _Group(space.matrix, *_scaled(b, np.asarray(out @ space.basis, dtype=np.complex128)))
        for space, b in zip(coupled, others, strict=True)
    ]
    return modes, groups


def _subspaces(A: Array) -> list[_Subspace]:
    """Return invariant subspaces of A whose orthonormal bases together have a condition of at most `WORST_CONDITION`.

    The right singular vector of the smallest singular value tells which of them are nearly dependent.
    """
    T, Q = schur(A, output="real")
    blocks = np.split(np.arange(len(A)), np.flatnonzero(np.append(1.0, np.diag(T, -1)) == 0.0))
    spaces = [_subspace(T, Q, tuple(block.tolist())) for block in blocks]
    while True:
        if whole := [space for space in spaces if len(space.matrix) == len(A)]:
            return whole[:1]
        _, singular, right = svd(np.concatenate([space.basis for space in spaces], axis=1))
        if singular[0] <= WORST_CONDITION * singular[-1]:
            return spaces
        ends = np.cumsum([len(space.matrix) for space in spaces])[:-1]
        shares = [float(np.linalg.norm(part)) for part in np.split(right[-1], ends)]
        first, second = sorted(np.argsort(shares)[-2:].tolist())
        joined = _subspace(T, Q, (*spaces[first].places, *spaces[second].places))
        spaces = [joined if k == first else space for k, space in enumerate(spaces) if k != second]


def _subspace(T: Array, Q: Array, places: tuple[int, ...]) -> _Subspace:
    """Return the invariant subspace of the eigenvalues at some places of a real Schur form.

    It is that of all eigenvalues if they are too close to be exchanged.
    """
    chosen = np.zeros(len(T), dtype=np.int32)
    chosen[list(places)] = 1
    ordered, basis, *_, fault = lapack.dtrsen(chosen, T, Q, job="N")
    count = len(T) if fault else len(places)
    return _Subspace(places, basis[:, :count], ordered[:count, :count])


def _eigenpair(mode: _Subspace) -> tuple[complex, Complex]:
    """Return the upper eigenvalue a + i w of [[a, b], [c, a]], or the only one, and its eigenvector (n,)."""
    basis, T = mode.basis, mode.matrix
    if len(T) == 1:
        return complex(T[0, 0]), basis[:, 0].astype(np.complex128)
    omega = float(np.sqrt(-T[0, 1] * T[1, 0]))
    return complex(T[0, 0], omega), basis[:, 0] + 1j * omega / T[0, 1] * basis[:, 1]


def _phased(vectors: Complex) -> Complex:
    """Rotate each eigenvector (n, K) so that its largest entry is real and positive; in a tie, the first of them."""
    sizes = np.abs(vectors)
    chosen = np.argmax(sizes >= _TIE * sizes.max(axis=0), axis=0)
    leading = np.take_along_axis(vectors, chosen[None, :], axis=0)
    return np.asarray(vectors * (leading.conj() / np.abs(leading)))


def _inputs(vectors: Complex, pair: NDArray[np.bool_], bases: Sequence[Array], B: Array) -> list[Complex]:
    """Return `V^-1 B` of the modes (K, m), then of every basis, with real arithmetic.

    A pair adds 2 Re v Re z - 2 Im v Im z to x, a real mode adds v z.
    """
    real = [np.where(pair, 2.0, 1.0) * vectors.real, -2.0 * vectors.imag[:, pair]]
    solved = np.linalg.solve(np.concatenate([*real, *bases], axis=1), B)
    sizes = [columns.shape[1] for columns in (*real, *bases)]
    own, imaginary, *others = np.split(solved, np.cumsum(sizes)[:-1])
    modal = own.astype(np.complex128)
    modal[pair] += 1j * imaginary
    return [modal, *(other.astype(np.complex128) for other in others)]


def _scaled(b: Complex, c: Complex) -> tuple[Complex, Complex]:
    """Scale states by a power of two so that the largest entries of b and c have about the same size."""
    largest_b, largest_c = float(np.abs(b).max(initial=0.0)), float(np.abs(c).max(initial=0.0))
    if largest_b == 0.0 or largest_c == 0.0:
        return b, c
    factor = 2.0 ** round(0.5 * np.log2(largest_c / largest_b))
    return b * factor, c / factor


def _collected(model: StateSpace, modes: Sequence[_Mode], groups: Sequence[_Group]) -> ModalForm:
    m, p, count = len(model.inputs), len(model.outputs), sum(len(group.matrix) for group in groups)
    eigenvalues = np.array([*(mode.eigenvalue for mode in modes), *[0.0] * count], dtype=np.complex128)
    b = np.concatenate([np.zeros((0, m)), *(mode.b[None, :] for mode in modes), *(group.b for group in groups)])
    c = np.concatenate([np.zeros((p, 0)), *(mode.c[:, None] for mode in modes), *(group.c for group in groups)], axis=1)
    coupling = block_diag(*(group.matrix for group in groups)) if groups else np.zeros((0, 0))
    try:
        kernel.equilibrium(model.A, model.B, np.zeros(m))
        steady = True
    except ValueError:
        steady = False
    arrays = (eigenvalues.real, eigenvalues.imag, b.real, b.imag, c.real, -c.imag, model.D, coupling)
    return ModalForm(*arrays, steady=steady)
