"""Modal form of a linear model: one complex state per pair of eigenvalues, one real state per real eigenvalue.

Each mode is an independent scalar equation, so a step of any size needs scalar exponentials only and no matrix
exponential. The native FMU of a vehicle is written from this form.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.sparse.csgraph import connected_components

from eightpost.array_types import Array, Complex
from eightpost.errors import ParameterError
from eightpost.vehicle import kernel

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from eightpost.vehicle.statespace import StateSpace


#: Relative accuracy of outputs that a modal form must reach; otherwise it is rejected.
ACCURACY = 1e-10

#: Largest condition number of the eigenvectors. The rounding error of the sum over the modes is up to twice this number
#: (measured: 1.9 times, on random models with nearly equal eigenvalues).
WORST_CONDITION = ACCURACY / (2.0 * float(np.finfo(np.float64).eps))

_TIE = 1.0 - 1e-6


@dataclass(frozen=True, slots=True, eq=False)
class ModalForm:
    """Linear model in modal form, with a complex state z_k and `lambda_k = sigma_k + i omega_k` per mode.

        z_k' = lambda_k z_k + (B_re_k + i B_im_k) u
        y = sum_k (C_re_k Re z_k + C_im_k Im z_k) + D u

    The pairs come first, then the real modes (omega = 0, B_im = 0, C_im = 0, so that z is real). Each group is in
    increasing order of |lambda|. In each mode the largest entries of B and C have about the same size.
    """

    sigma: Array  #: Real parts (K,) [1/s].
    omega: Array  #: Imaginary parts (K,) [1/s], above zero for a pair, zero for a real mode.
    B_re: Array  #: Real parts of the modes' inputs (K, m).
    B_im: Array  #: Imaginary parts of the modes' inputs (K, m).
    C_re: Array  #: Outputs per Re z (p, K).
    C_im: Array  #: Outputs per Im z (p, K).
    D: Array  #: Direct terms (p, m).
    steady: bool  #: Whether constant inputs have a unique steady state, according to `kernel.equilibrium`.

    def __post_init__(self) -> None:
        """Make the arrays read-only."""
        for name in ("sigma", "omega", "B_re", "B_im", "C_re", "C_im", "D"):
            array = np.array(getattr(self, name), dtype=np.float64, order="C") + 0.0  # no negative zeros
            array.setflags(write=False)
            object.__setattr__(self, name, array)

    @property
    def pairs(self) -> int:
        """Number of modes that are pairs of eigenvalues; they come first."""
        return int(np.count_nonzero(self.omega))

    @property
    def eigenvalues(self) -> Complex:
        """Eigenvalues, one per mode (K,) [1/s]; for a pair the one with positive imaginary part."""
        return np.asarray(self.sigma + 1j * self.omega)


def modal_form(model: StateSpace) -> ModalForm:
    """Return the complete modal form of a continuous model; equal models give bitwise equal results.

    Parts of the model that do not act on each other are separated first, so that they remain exactly uncoupled and may
    have equal eigenvalues. Each part is balanced, `A V = V Lambda` gives its modes, and `V^-1 B`, `C V` its inputs
    and outputs. The phase of an eigenvector is chosen so that its largest entry is real and positive.

    Raises:
        ParameterError: The model is discrete, or eigenvalues (nearly) coincide and share an eigenvector, so that
            outputs would not have the accuracy `ACCURACY`.

    Source: G. H. Golub, C. F. Van Loan, "Matrix Computations", 4th ed., 2013, chapter 7 (diagonal form, condition of
    eigenvectors, balancing).
    """
    if model.dt is not None:
        raise ParameterError(f"{model.name}: a discrete model has no modal form; convert it to continuous time first")
    modes = [mode for states in _separate_parts(model.A) for mode in _part_modes(model, _diagonalise(model, states))]
    modes.sort(key=lambda mode: (mode.eigenvalue.imag == 0.0, abs(mode.eigenvalue)))
    return _collected(model, modes)


@dataclass(frozen=True, slots=True)
class _Mode:
    """Scaled mode: `z' = eigenvalue z + b u`, with the contribution `Re(c z)` to the outputs."""

    eigenvalue: complex
    b: Complex
    c: Complex


@dataclass(frozen=True, slots=True)
class _Part:
    """Uncoupled part of a model: its states, and eigenvalues and eigenvectors of its balanced state matrix."""

    states: NDArray[np.intp]
    scaling: Array
    eigenvalues: Complex
    vectors: Complex


def _separate_parts(A: Array) -> list[NDArray[np.intp]]:
    """Return the states of each uncoupled part of the model, in increasing order."""
    if not len(A):
        return []
    count, label = connected_components(A != 0.0, directed=False)
    return [np.flatnonzero(label == k) for k in range(count)]


def _diagonalise(model: StateSpace, states: NDArray[np.intp]) -> _Part:
    balanced, scaling = kernel.balance(model.A[np.ix_(states, states)])
    eigenvalues, vectors = np.linalg.eig(balanced)
    eigenvalues, vectors = eigenvalues.astype(np.complex128), vectors.astype(np.complex128)
    condition = float(np.linalg.cond(vectors))
    if not condition <= WORST_CONDITION:
        raise ParameterError(_why_defective(model.name, eigenvalues, vectors, condition))
    return _Part(states, scaling, eigenvalues, vectors)


def _why_defective(name: str, eigenvalues: Complex, vectors: Complex, condition: float) -> str:
    similarity = np.triu(np.abs(vectors.conj().T @ vectors), 1)
    first, second = (int(k) for k in np.unravel_index(int(np.argmax(similarity)), similarity.shape))
    return (
        f"{name}: the eigenvalues {_text(eigenvalues[first])} and {_text(eigenvalues[second])} 1/s nearly coincide and "
        f"share an eigenvector (condition {condition:.2g}, above {WORST_CONDITION:.2g}), so the model has no modal "
        f"form with an accuracy of {ACCURACY:g}; build it with --target python, which needs no modes, or change a "
        "parameter slightly"
    )


def _text(value: complex) -> str:
    return f"{value.real:.6g}" if value.imag == 0.0 else f"{value.real:.6g}{value.imag:+.6g}j"


def _part_modes(model: StateSpace, part: _Part) -> list[_Mode]:
    """Return the modes of one part; a pair has its upper eigenvalue, which contributes `Re(2 C v z)` to the outputs."""
    upper = part.eigenvalues.imag >= 0.0
    vectors = _phased(part.vectors[:, upper])
    pair = part.eigenvalues[upper].imag > 0.0
    B = _modal_inputs(vectors, pair, model.B[part.states] / part.scaling[:, None])
    shares = np.where(pair, 2.0 * vectors, vectors.real)
    C = np.asarray((model.C[:, part.states] * part.scaling) @ shares, dtype=np.complex128)
    return [_scaled(complex(e), B[k], C[:, k]) for k, e in enumerate(part.eigenvalues[upper])]


def _phased(vectors: Complex) -> Complex:
    """Rotate each eigenvector (n, K) so that its largest entry is real and positive; in a tie, the first of them."""
    sizes = np.abs(vectors)
    chosen = np.argmax(sizes >= _TIE * sizes.max(axis=0), axis=0)
    leading = np.take_along_axis(vectors, chosen[None, :], axis=0)
    return np.asarray(vectors * (leading.conj() / np.abs(leading)))


def _modal_inputs(vectors: Complex, pair: NDArray[np.bool_], B: Array) -> Complex:
    """Return `V^-1 B` (K, m) with real arithmetic; a pair adds 2 Re v Re z - 2 Im v Im z to x, a real mode adds v z."""
    basis = np.concatenate([np.where(pair, 2.0, 1.0) * vectors.real, -2.0 * vectors.imag[:, pair]], axis=1)
    solved = np.linalg.solve(basis, B)
    modal = solved[: len(pair)].astype(np.complex128)
    modal[pair] += 1j * solved[len(pair) :]
    return modal


def _scaled(eigenvalue: complex, b: Complex, c: Complex) -> _Mode:
    """Scale z by a power of two so that the largest entries of b and c have about the same size."""
    largest_b, largest_c = float(np.abs(b).max(initial=0.0)), float(np.abs(c).max(initial=0.0))
    if largest_b == 0.0 or largest_c == 0.0:
        return _Mode(eigenvalue, b, c)
    factor = 2.0 ** round(0.5 * np.log2(largest_c / largest_b))
    return _Mode(eigenvalue, b * factor, c / factor)


def _collected(model: StateSpace, modes: Sequence[_Mode]) -> ModalForm:
    eigenvalues = np.array([mode.eigenvalue for mode in modes], dtype=np.complex128)
    b = np.array([mode.b for mode in modes], dtype=np.complex128).reshape(len(modes), len(model.inputs))
    c = np.array([mode.c for mode in modes], dtype=np.complex128).reshape(len(modes), len(model.outputs)).T
    return ModalForm(
        eigenvalues.real,
        eigenvalues.imag,
        b.real,
        b.imag,
        c.real,
        -c.imag,
        model.D,
        steady=_has_steady_state(model),
    )


def _has_steady_state(model: StateSpace) -> bool:
    try:
        kernel.equilibrium(model.A, model.B, np.zeros(len(model.inputs)))
    except ValueError:
        return False
    return True
