"""The dissertation's models: one transfer function per input and output, with poles of its own (5.3.3, 6.3.3)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from eightpost.errors import InputError
from eightpost.ident.vehicle.parallel import parallel_model
from eightpost.ident.vehicle.rational_fit import RationalFit
from eightpost.ident.vehicle.weights import AEROLOADERS, WHEELLOADERS, BandWeights

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from eightpost.ident.response import FrequencyResponse
    from eightpost.ident.vehicle.transfer_function import TransferFunction
    from eightpost.vehicle.statespace import StateSpace

    Array = NDArray[np.float64]
    Complex = NDArray[np.complex128]


class PathFit(NamedTuple):
    """What came out for one path."""

    model: TransferFunction
    error: float
    """Weighted RMS of the misfit over that of the response [1]."""
    lightest: float
    """Smallest damping ratio of its poles [1]."""


@dataclass(frozen=True, slots=True)
class SisoFits:
    """How each path is fitted: "denominators from 4 up until acceptable, without artificial modes" (6.3.3).

    Attributes:
        orders: Denominator degrees to try, in this order: the first that errs by less than `tolerance` is taken, else
            the best.
        tolerance: Accepted error of a path [1].
        least_damping: A fit with a mode below this damping ratio is artificial and taken only where there is no other.
        dt: Sample time of discrete models [s] (invfreqz), or None for continuous ones (invfreqs).
        weights: By input; inputs that are not there have `AEROLOADERS` where their name says so, else `WHEELLOADERS`.
    """

    orders: tuple[int, ...] = (4, 6, 8)
    tolerance: float = 0.02
    least_damping: float = 0.01
    dt: float | None = None
    weights: Mapping[str, BandWeights] = field(default_factory=dict)

    def fit(self, response: FrequencyResponse) -> SisoModels:
        """Fit every path that is not zero.

        Raises:
            InputError: All paths are zero in their weighted bands.
        """
        paths = {}
        for j, source in enumerate(response.input_names):
            weight = self._weights(source).at(response.frequency)
            for i, output in enumerate(response.output_names):
                counted = weight * _known(response, i, j)
                if np.abs(response.H[i, j] * counted).any():
                    direct = has_direct_term(output, source)
                    paths[output, source] = self._fit_path(response.frequency, response.H[i, j], counted, direct)
        if not paths:
            raise InputError("every path is zero where its weights are not; there is nothing to fit")
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
            model = RationalFit(order, order if direct else order - 1, self.dt).fit(frequency, H, weight)
            fit = _judged(model, frequency, H, weight)
            if fit.error <= self.tolerance and fit.lightest >= self.least_damping:
                return fit
            found.append(fit)
        honest = [fit for fit in found if fit.lightest >= self.least_damping]
        return min(honest or found, key=lambda fit: fit.error)


@dataclass(frozen=True, slots=True, eq=False)
class SisoModels:
    """Fitted paths.

    Attributes:
        model: All of them as one linear model, with the baseline damping in it.
        paths: What came out, by (output, input).
    """

    model: StateSpace
    paths: Mapping[tuple[str, str], PathFit]


def has_direct_term(output: str, source: str) -> bool:
    """Say whether an input acts on an output at once, from the channels' names (physics: Eq 4.6, 5.20 to 5.23).

    Tire forces answer their own road at once, ride heights every road, accelerations every force and moment; shock
    velocities and displacements nothing. Paths that pass through the chassis first have none.
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


def _known(response: FrequencyResponse, i: int, j: int) -> Array:
    """Return 1 (K,) where the input had power, else 0; residual fits fill what lies between."""
    if response.variance is None:
        return np.ones_like(response.frequency)
    return np.asarray(np.isfinite(response.variance[i, j]) | (np.abs(response.H[i, j]) > 0.0), dtype=np.float64)


def _judged(model: TransferFunction, frequency: Array, H: Complex, weight: Array) -> PathFit:
    used = weight > 0.0
    wrong = np.sum(weight[used] * np.abs(model.frequency_response(frequency[used]) - H[used]) ** 2)
    whole = np.sum(weight[used] * np.abs(H[used]) ** 2)
    return PathFit(model, float(np.sqrt(wrong / whole)), min(mode.damping_ratio for mode in model.modes()))
