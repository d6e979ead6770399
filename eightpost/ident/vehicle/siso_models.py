"""Models of single responses, all of them in parallel, and the reduction of that model by balanced truncation.

154 path fits of order eight have 1200 states, while the car itself has 14 to 20. As the poles are known, both Gramians
have a closed form in modal coordinates,

    W_c = -b_i b_j* / (p_i + p_j*),     W_o = -c_i* c_j / (p_i* + p_j)

and the states that are weakly controllable or weakly observable are removed. The direct terms do not change.

Source: B. C. Moore, "Principal component analysis in linear systems", IEEE Trans. Autom. Control 26 (1981) 17-32, doi
10.1109/TAC.1981.1102568.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eigh, svd
from scipy.sparse import coo_array, csr_array

from eightpost.array_types import Array, Complex
from eightpost.errors import InputError, ParameterError
from eightpost.ident.response import FrequencyResponse
from eightpost.ident.vehicle.rational_fit import AEROLOADERS, WHEELLOADERS, BandWeights, RationalFit, TransferFunction
from eightpost.progress import parts
from eightpost.vehicle.statespace import Channel, StateSpace

#: Orders to try if all requested orders give artificial fits.
_LAST_ORDERS = (7, 6, 5, 4, 3, 2)

#: Ratio of the error to that of the next lower order above which a higher order only fits noise [1].
_NO_BETTER = 0.9

#: Limits of a fit that is not artificial: damping ratio of a mode, response outside the weighted band over that inside,
#: and frequency of a pole over the end of the weighted band [1].
_LIGHTEST, _EXCESS, _FASTEST = 0.01, 2.0, 10.0


class PathFit(NamedTuple):
    """Fit of one path."""

    model: TransferFunction
    error: float
    """Weighted RMS of the misfit relative to that of the response [1]."""
    lightest: float
    """Smallest damping ratio of the poles [1]."""
    excess: float
    """Largest response outside the weighted band relative to the largest inside [1]."""
    fastest: float
    """Frequency of the fastest pole relative to the upper end of the weighted band [1]."""

    @property
    def is_acceptable(self) -> bool:
        """Whether the fit is not artificial; see `SisoFits`."""
        return self.excess <= _EXCESS and self.fastest <= _FASTEST and self.lightest >= _LIGHTEST


def has_direct_term(output: str, source: str) -> bool:
    """Return whether an input has a direct term in an output, judged by the channels' names (Eq 4.6, 5.20 to 5.23).

    Tire forces have a direct term in the road of their corner, ride heights in every road, hub accelerations in the
    road and the force of their corner, other accelerations in every force and moment; shock velocities and
    displacements have none.
    """
    kind, place = source.rpartition(".")[2], source.rpartition(".")[0]
    if output.endswith("tire_force"):
        return kind == "road" and output.rpartition(".")[0] == place
    if output.endswith("ride_height"):
        return kind == "road"
    if output.endswith("hub_acceleration"):
        return kind in ("road", "force") and output.rpartition(".")[0] == place
    if output.endswith("acceleration"):
        return kind != "road"
    return False


def may_have_direct_term(output: str, source: str) -> bool:
    """Return whether an input may have a direct term in an output of any car, e.g. with solid axles and damped tires.

    Shock velocities and displacements have no direct terms; ride heights have them only in the roads, from which they
    are measured.
    """
    kind = source.rpartition(".")[2]
    if output.endswith(("velocity", "displacement")):
        return False
    return kind == "road" if output.endswith("ride_height") else True


@dataclass(frozen=True, slots=True)
class SisoFits:
    """Settings of the path fits: "denominators from 4 up until acceptable, without artificial modes" (6.3.3).

    A fit is artificial if it has a mode with almost no damping, a much larger response outside the weighted band than
    inside, or a pole so fast that it acts as a direct term. Such a fit is used only if no order down to 2 gives a
    better one.
    """

    #: Denominator degrees to try, in this order. The first one with an error below `tolerance` is used, else the best
    #: one; the search stops when a higher order is barely better.
    orders: tuple[int, ...] = (4, 6, 8)
    tolerance: float = 0.02  #: Accepted error of a path [1].
    #: Weights by input; other inputs have `AEROLOADERS` if their name is that of a load, else `WHEELLOADERS`.
    weights: Mapping[str, BandWeights] = field(default_factory=dict)
    #: Function that returns whether a path (output, input) has a direct term.
    direct: Callable[[str, str], bool] = has_direct_term

    def fit(self, response: FrequencyResponse) -> SisoModels:
        """Fit every path that is not zero.

        Raises:
            InputError: All paths are zero in their weighted bands.
        """
        paths = {}
        weights = [self._weights(source).at(response.frequency) for source in response.input_names]
        sources, outputs = enumerate(response.input_names), enumerate(response.output_names)
        for (j, source), (i, output) in parts(product(sources, outputs)):
            counted = weights[j] * _known(response, i, j)
            if np.abs(response.H[i, j] * counted).any():
                direct = self.direct(output, source)
                paths[output, source] = self._fit_path(response.frequency, response.H[i, j], counted, direct)
        if not paths:
            raise InputError(
                "every path is zero in its weighted band, so there is nothing to fit; check the inputs of the tests"
            )
        model = parallel_model(
            {k: fit.model for k, fit in paths.items()}, response.inputs, response.outputs, name="siso"
        )
        return SisoModels(model, paths)

    def _weights(self, source: str) -> BandWeights:
        aero = any(word in source for word in ("heave", "roll", "pitch", "warp", "aero"))
        return self.weights.get(source, AEROLOADERS if aero else WHEELLOADERS)

    def _fit_path(self, frequency: Array, H: Complex, weight: Array, direct: bool) -> PathFit:
        found = []
        for order in self.orders:
            found += self._fit_order(order, (frequency, H, weight), direct)
            if found and found[-1].error <= self.tolerance and found[-1].is_acceptable:
                return found[-1]
            if len(found) > 1 and found[-2].is_acceptable and found[-1].error > _NO_BETTER * found[-2].error:
                break
        for order in _LAST_ORDERS:
            if any(fit.is_acceptable for fit in found):
                break
            found += self._fit_order(order, (frequency, H, weight), direct)
        acceptable = [fit for fit in found if fit.is_acceptable]
        return min(acceptable or found, key=lambda fit: fit.error)

    def _fit_order(self, order: int, data: tuple[Array, Complex, Array], direct: bool) -> list[PathFit]:
        """Return the fit in a list, which is empty if the fit has a double pole."""
        try:
            model = RationalFit(order, order if direct else order - 1).fit(*data)
        except ParameterError:
            return []
        return [_path_fit(model, *data)]


@dataclass(frozen=True, slots=True, eq=False)
class SisoModels:
    """Models of all paths."""

    model: StateSpace  #: Linear model of all paths, including the baseline damping.
    paths: Mapping[tuple[str, str], PathFit]  #: Path fits by (output, input).

    def response(self, frequency: Array) -> FrequencyResponse:
        """Return the response at frequencies [Hz] (K,), path by path, as the whole model has a thousand states."""
        inputs, outputs = self.model.inputs, self.model.outputs
        rows, columns = [channel.name for channel in outputs], [channel.name for channel in inputs]
        H = np.zeros((len(rows), len(columns), frequency.size), dtype=np.complex128)
        for (output, source), fit in self.paths.items():
            H[rows.index(output), columns.index(source)] = fit.model.frequency_response(frequency)
        return FrequencyResponse(frequency, H, inputs, outputs)


def _known(response: FrequencyResponse, i: int, j: int) -> Array:
    """Return 1 (K,) where the input had power or the response was filled in by a residual fit, else 0."""
    if response.variance is None:
        return np.ones_like(response.frequency)
    return np.asarray(np.isfinite(response.variance[i, j]) | (np.abs(response.H[i, j]) > 0.0), dtype=np.float64)


def _path_fit(model: TransferFunction, frequency: Array, H: Complex, weight: Array) -> PathFit:
    used = weight > 0.0
    misfit = np.sum(weight[used] * np.abs(model.frequency_response(frequency[used]) - H[used]) ** 2)
    total = np.sum(weight[used] * np.abs(H[used]) ** 2)
    modes = model.modes()
    return PathFit(
        model,
        float(np.sqrt(misfit / total)),
        min(mode.damping_ratio for mode in modes),
        _excess(model, frequency[used], H[used]),
        max(mode.frequency_hz for mode in modes) / float(frequency[used][-1]),
    )


def _excess(model: TransferFunction, frequency: Array, H: Complex) -> float:
    """Return the largest response outside the band, from 0 to four times its end, relative to that of the data."""
    low, high = float(frequency[0]), float(frequency[-1])
    outside = np.concatenate(([0.0], np.geomspace(1e-3 * low, low, 30), np.geomspace(high, 4.0 * high, 60)))
    return float(np.abs(model.frequency_response(outside)).max() / np.abs(H).max())


# ---- All paths in parallel, and the reduction -----------------------------------------------------------------------


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
    """
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
    return StateSpace(A, B, C, D, tuple(inputs), tuple(outputs), name=name)


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
