"""The dissertation's models: one transfer function per input and output, with poles of its own (5.3.3, 6.3.3)."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from eightpost.errors import InputError, ParameterError
from eightpost.ident.response import FrequencyResponse
from eightpost.ident.vehicle.parallel import parallel_model
from eightpost.ident.vehicle.rational_fit import RationalFit
from eightpost.ident.vehicle.weights import AEROLOADERS, WHEELLOADERS, BandWeights

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from eightpost.ident.vehicle.transfer_function import TransferFunction
    from eightpost.vehicle.statespace import StateSpace

    Array = NDArray[np.float64]
    Complex = NDArray[np.complex128]


#: Orders to fall back to where all that were asked for give artificial fits.
_LAST_ORDERS = (7, 6, 5, 4, 3, 2)


#: A higher order that leaves more than this part of the error is fitting noise.
_NO_BETTER = 0.9


class PathFit(NamedTuple):
    """What came out for one path."""

    model: TransferFunction
    error: float
    """Weighted RMS of the misfit over that of the response [1]."""
    lightest: float
    """Smallest damping ratio of its poles [1]."""
    excess: float
    """Its largest response below and above the weighted band over the largest inside [1]."""
    fastest: float
    """Its fastest pole over the end of the weighted band [1]."""


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


def may_have_direct_term(output: str, source: str) -> bool:
    """Say whether an input may act on an output at once in a car of any kind: solid axles, tires with damping.

    Shock velocities and displacements answer nothing at once; ride heights only the roads that they are measured from.
    """
    kind = source.rpartition(".")[2]
    if output.endswith(("velocity", "displacement")):
        return False
    return kind == "road" if output.endswith("ride_height") else True


@dataclass(frozen=True, slots=True)
class SisoFits:
    """How each path is fitted: "denominators from 4 up until acceptable, without artificial modes" (6.3.3).

    A fit is artificial where it has a mode next to no damping, answers more outside the weighted band than inside
    (there it was free), or has a pole so fast that it is a direct term in disguise. Such a fit is taken only where no
    order, down to 2, has an honest one.

    Attributes:
        orders: Denominator degrees to try, in this order: the first that errs by less than `tolerance` is taken, else
            the best; no further ones once a higher order is hardly better.
        tolerance: Accepted error of a path [1].
        least_damping: A fit with a mode below this damping ratio is artificial.
        most_excess: A fit is artificial that answers so many times more outside the weighted band than inside [1].
        most_fastest: A fit is artificial that has a pole so many times beyond the end of the weighted band [1].
        dt: Sample time of discrete models [s] (invfreqz), or None for continuous ones (invfreqs).
        weights: By input; inputs that are not there have `AEROLOADERS` where their name says so, else `WHEELLOADERS`.
        direct: Says which paths (output, input) have a direct term.
    """

    orders: tuple[int, ...] = (4, 6, 8)
    tolerance: float = 0.02
    least_damping: float = 0.01
    most_excess: float = 2.0
    most_fastest: float = 10.0
    dt: float | None = None
    weights: Mapping[str, BandWeights] = field(default_factory=dict)
    direct: Callable[[str, str], bool] = has_direct_term

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
                    direct = self.direct(output, source)
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
            found += self._fit_order(order, (frequency, H, weight), direct)
            if found and found[-1].error <= self.tolerance and self._is_honest(found[-1]):
                return found[-1]
            if len(found) > 1 and self._is_honest(found[-2]) and found[-1].error > _NO_BETTER * found[-2].error:
                break
        for order in _LAST_ORDERS:
            if any(map(self._is_honest, found)):
                break
            found += self._fit_order(order, (frequency, H, weight), direct)
        honest = [fit for fit in found if self._is_honest(fit)]
        return min(honest or found, key=lambda fit: fit.error)

    def _fit_order(self, order: int, data: tuple[Array, Complex, Array], direct: bool) -> list[PathFit]:
        """Return the fit, or none where two of its poles fall together."""
        try:
            model = RationalFit(order, order if direct else order - 1, self.dt).fit(*data)
        except ParameterError:
            return []
        return [_judged(model, *data)]

    def _is_honest(self, fit: PathFit) -> bool:
        calm = fit.excess <= self.most_excess and fit.fastest <= self.most_fastest
        return calm and fit.lightest >= self.least_damping


@dataclass(frozen=True, slots=True, eq=False)
class SisoModels:
    """Fitted paths.

    Attributes:
        model: All of them as one linear model, with the baseline damping in it.
        paths: What came out, by (output, input).
    """

    model: StateSpace
    paths: Mapping[tuple[str, str], PathFit]

    def response(self, frequency: Array) -> FrequencyResponse:
        """Return the model's response at frequencies (K,) [Hz], path by path: as one model it has a thousand states."""
        inputs, outputs = self.model.inputs, self.model.outputs
        rows, columns = [channel.name for channel in outputs], [channel.name for channel in inputs]
        H = np.zeros((len(rows), len(columns), frequency.size), dtype=np.complex128)
        for (output, source), fit in self.paths.items():
            H[rows.index(output), columns.index(source)] = fit.model.frequency_response(frequency)
        return FrequencyResponse(frequency, H, inputs, outputs)


def _known(response: FrequencyResponse, i: int, j: int) -> Array:
    """Return 1 (K,) where the input had power, else 0; residual fits fill what lies between."""
    if response.variance is None:
        return np.ones_like(response.frequency)
    return np.asarray(np.isfinite(response.variance[i, j]) | (np.abs(response.H[i, j]) > 0.0), dtype=np.float64)


def _judged(model: TransferFunction, frequency: Array, H: Complex, weight: Array) -> PathFit:
    used = weight > 0.0
    wrong = np.sum(weight[used] * np.abs(model.frequency_response(frequency[used]) - H[used]) ** 2)
    whole = np.sum(weight[used] * np.abs(H[used]) ** 2)
    modes = model.modes()
    return PathFit(
        model,
        float(np.sqrt(wrong / whole)),
        min(mode.damping_ratio for mode in modes),
        _excess(model, frequency[used], H[used]),
        max(mode.frequency_hz for mode in modes) / float(frequency[used][-1]),
    )


def _excess(model: TransferFunction, frequency: Array, H: Complex) -> float:
    """Return how far a fit goes beyond its data outside the band (K,) of them: down to 0 and up to four times it."""
    low, high = float(frequency[0]), float(frequency[-1])
    outside = np.concatenate(([0.0], np.geomspace(1e-3 * low, low, 30), np.geomspace(high, 4.0 * high, 60)))
    if model.dt is not None:
        outside = outside[outside < 0.5 / model.dt]
    return float(np.abs(model.frequency_response(outside)).max() / np.abs(H).max())
