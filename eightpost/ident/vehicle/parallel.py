"""Linear model of many single paths in parallel, and its reduction by balanced truncation.

154 path fits of order eight have 1200 states, while the car itself has 14 to 20. As the poles are known, both Gramians
have a closed form in modal coordinates,

    W_c = -b_i b_j* / (p_i + p_j*),     W_o = -c_i* c_j / (p_i* + p_j)

and the states that are weakly controllable or weakly observable are removed. The direct terms do not change.

Source: B. C. Moore, "Principal component analysis in linear systems", IEEE Trans. Autom. Control 26 (1981) 17-32, doi
10.1109/TAC.1981.1102568.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eigh, svd
from scipy.sparse import coo_array, csr_array

from eightpost.array_types import Array, Complex
from eightpost.errors import ParameterError
from eightpost.ident.vehicle.rational_fit import TransferFunction
from eightpost.vehicle.statespace import Channel, StateSpace


def parallel_model(
    paths: Mapping[tuple[str, str], TransferFunction],
    inputs: Sequence[Channel],
    outputs: Sequence[Channel],
    *,
    name: str = "parallel",
) -> StateSpace:
    """Return the linear model whose paths are the given transfer functions; each path has its own poles.

    Args:
        paths: Transfer function by (output, input); missing paths are zero.
        inputs: Inputs of the model.
        outputs: Outputs of the model.
        name: Name of the model.

    Raises:
        ParameterError: There is no path, or both continuous and discrete ones are given.
    """
    rates = {path.dt for path in paths.values()}
    if len(rates) != 1:
        raise ParameterError(
            f"all paths must have the same sample time; the given ones have {sorted(map(str, rates)) or 'none'}"
        )
    rows, columns = [channel.name for channel in outputs], [channel.name for channel in inputs]
    n = sum(path.order for path in paths.values())
    A, B = np.zeros((n, n)), np.zeros((n, len(columns)))
    C, D = np.zeros((len(rows), n)), np.zeros((len(rows), len(columns)))
    at = 0
    for (output, source), path in paths.items():
        i, j, part = rows.index(output), columns.index(source), slice(at, at + path.order)
        sections = path.sections()
        A[part, part], B[part, j], C[i, part], D[i, j] = sections[0], sections[1][:, 0], sections[2][0], path.direct
        at += path.order
    return StateSpace(A, B, C, D, tuple(inputs), tuple(outputs), rates.pop(), name)


# ---- Balanced truncation --------------------------------------------------------------------------------------------

#: Eigenvalue of a Gramian, relative to the largest, below which it is a rounding error [1].
_ROUNDING = 1e-14


class _BalancedModel(NamedTuple):
    """A model in balanced coordinates, most important state first."""

    model: StateSpace  #: Balanced model, without states at the level of rounding errors.
    hankel: Array  #: Hankel singular values of the scaled model (n,).

    def truncated(self, states: int) -> StateSpace:
        """Return the model of the first `states`; it is stable if the full model is."""
        model, n = self.model, min(states, self.hankel.size)
        return replace(model, A=model.A[:n, :n], B=model.B[:n], C=model.C[:, :n])


def balance(model: StateSpace, input_sizes: Array, output_sizes: Array) -> _BalancedModel:
    """Balance a stable continuous model of first- and second-order sections, such as `parallel_model` returns.

    Args:
        model: Model whose state matrix has blocks of one state and of two states `((re, -im), (im, re))`.
        input_sizes: Typical sizes of the inputs (m,).
        output_sizes: Typical sizes of the outputs (p,); both sizes scale the model before balancing.
    """
    modal = _modal_basis(model.A)
    poles = _poles(model.A)
    real = _inverse(modal)
    B, C = modal @ (model.B * input_sizes), (model.C / output_sizes[:, None]) @ real
    reach = real @ (-(B @ B.conj().T) / (poles[:, None] + poles.conj()[None, :])) @ real.conj().T
    sight = modal.conj().T @ (-(C.conj().T @ C) / (poles.conj()[:, None] + poles[None, :])) @ modal
    # Scale each state to be equally controllable and observable, as newtons and metres differ by orders of magnitude.
    units = (np.diag(sight).real / np.diag(reach).real) ** 0.25
    reached = _factor(reach * np.outer(units, units)) / units[:, None]
    seen = _factor(sight / np.outer(units, units)) * units[:, None]
    left, hankel, right = svd(seen.T @ reached, full_matrices=False)
    kept = hankel > np.sqrt(_ROUNDING) * hankel[0]
    root = 1.0 / np.sqrt(hankel[kept])
    to = reached @ (right[kept].T * root)
    back = (seen @ (left[:, kept] * root)).T
    A = back @ (csr_array(model.A) @ to)
    return _BalancedModel(replace(model, A=A, B=back @ model.B, C=model.C @ to), hankel[kept])


def _pairs(A: Array) -> NDArray[np.intp]:
    """Return the index of the first state of every section of two states."""
    return np.flatnonzero(np.diag(A, 1))


def _poles(A: Array) -> Complex:
    """Return the poles (n,); the two poles of a section of two states are adjacent."""
    poles = np.diag(A).astype(np.complex128)
    first = _pairs(A)
    imaginary = A[first + 1, first]
    poles[first] += 1j * imaginary
    poles[first + 1] -= 1j * imaginary
    return poles


def _modal_basis(A: Array) -> csr_array:
    """Return T (n, n), which gives the modal state `xi = x_1 + i x_2` and its conjugate for sections of two states."""
    first = _pairs(A)
    ones = np.ones(len(A), dtype=np.complex128)
    ones[first + 1] = -1j
    rows = np.concatenate((np.arange(len(A)), first, first + 1))
    columns = np.concatenate((np.arange(len(A)), first + 1, first))
    values = np.concatenate((ones, np.full(first.size, 1j), np.ones(first.size)))
    return csr_array(coo_array((values, (rows, columns)), shape=A.shape))


def _inverse(modal: csr_array) -> csr_array:
    """Return the inverse of T; for a block ((1, i), (1, -i)) it is half the conjugate transpose."""
    sizes = np.asarray(abs(modal).sum(axis=1)).ravel()
    return csr_array(modal.conj().T.multiply(1.0 / sizes[None, :]))


def _factor(gramian: Complex) -> Array:
    """Return a factor F of the Gramian `F F^T`."""
    values, vectors = eigh(0.5 * (gramian + gramian.conj().T).real)
    kept = values > _ROUNDING * values[-1]
    return np.asarray(vectors[:, kept] * np.sqrt(values[kept]))
