"""What a parameter of a structural vehicle does to its frequency responses and modes (4.1.2, 5.1.2)."""

from __future__ import annotations

from dataclasses import fields, replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from eightpost.errors import InputError
from eightpost.ident.response import FrequencyResponse, response_of
from eightpost.vehicle import Corners

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from eightpost.vehicle import Mode, QuarterCar, SevenDof, StructuralVehicle


class Variant(NamedTuple):
    """A vehicle with one parameter changed."""

    factor: float
    """Of the parameter's own value [1]."""
    response: FrequencyResponse
    modes: tuple[Mode, ...]


def vary(
    vehicle: StructuralVehicle, parameter: str, factors: Sequence[float], frequency: NDArray[np.float64]
) -> tuple[Variant, ...]:
    """Return the vehicle with its dampers, a parameter times each factor; of a corner parameter, all four corners.

    Args:
        vehicle: The vehicle.
        parameter: A field of its parameters, such as `damping` or `suspension_stiffness`.
        factors: [1].
        frequency: (K,) [Hz].

    Raises:
        InputError: The vehicle has no such parameter, or not as a number.
        ParameterError: A factor takes the parameter out of its range.
    """
    return tuple(_variant(vehicle, parameter, factor, frequency) for factor in factors)


def _variant(vehicle: StructuralVehicle, parameter: str, factor: float, frequency: NDArray[np.float64]) -> Variant:
    changed = replace(vehicle, parameters=_scaled(vehicle.parameters, parameter, factor))
    model = changed.with_damper()
    return Variant(factor, response_of(model, frequency), model.modes())


def _scaled(parameters: QuarterCar | SevenDof, name: str, factor: float) -> QuarterCar | SevenDof:
    known = [declared.name for declared in fields(parameters)]
    if name not in known:
        raise InputError(f"the vehicle has no parameter {name!r}; it has {', '.join(known)}")
    value = getattr(parameters, name)
    if value is None:
        raise InputError(f"{name} is not given for this vehicle, so it cannot be varied")
    changed: dict[str, Any] = {
        name: Corners(*(factor * part for part in value)) if isinstance(value, Corners) else factor * value
    }
    return replace(parameters, **changed)
