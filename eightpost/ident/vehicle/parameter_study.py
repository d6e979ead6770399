"""Effect of a parameter of a structural vehicle on its frequency responses and modes (4.1.2, 5.1.2)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from eightpost.errors import InputError
from eightpost.ident.response import FrequencyResponse, response_of
from eightpost.vehicle import Corners, IdentifiedVehicle, Mode, QuarterCar, SevenDof, StructuralVehicle, Vehicle


class Variant(NamedTuple):
    """A vehicle with one parameter changed."""

    factor: float
    """Factor on the parameter's value [1]."""
    response: FrequencyResponse
    modes: tuple[Mode, ...]


#: Number of frequencies in a response file and in a picture.
_POINTS = 800


def frequencies_to(high: float) -> NDArray[np.float64]:
    """Return the frequencies [Hz] of a response file and of a picture, up to `high`.

    Raises:
        InputError: The highest frequency is not possible.
    """
    if not 0.0 < high < 1e4:
        raise InputError(f"--high {high:g}: give a frequency between 0 and 10000 Hz")
    return np.linspace(high / _POINTS, high, _POINTS)


def variants_of(
    vehicle: Vehicle, parameter: str | None, factors: Sequence[float], frequency: NDArray[np.float64]
) -> dict[str, Variant]:
    """Return a vehicle as it is, or with a parameter multiplied by each factor, by a label for tables and pictures.

    Raises:
        InputError: The vehicle is an identified model, which has no parameters.
    """
    if parameter is None:
        model = vehicle.with_damper()
        return {"as given": Variant(1.0, response_of(model, frequency), model.modes())}
    if isinstance(vehicle, IdentifiedVehicle):
        raise InputError(
            f"{vehicle.name} is an identified model, which has no {parameter} to vary; give a .toml vehicle"
        )
    return {f"{parameter} x {one.factor:g}": one for one in vary(vehicle, parameter, factors, frequency)}


def vary(
    vehicle: StructuralVehicle, parameter: str, factors: Sequence[float], frequency: NDArray[np.float64]
) -> tuple[Variant, ...]:
    """Return the vehicle with its dampers and one parameter multiplied by each factor.

    A parameter with a value per corner is multiplied at all four corners.

    Args:
        vehicle: Vehicle to vary.
        parameter: Name of the parameter, such as `damping` or `suspension_stiffness`.
        factors: Factors on the parameter's value [1].
        frequency: Frequencies of the responses [Hz] (K,).

    Raises:
        InputError: The vehicle has no such parameter, or it has no value.
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
        raise InputError(f"the vehicle has no parameter {name!r}; its parameters are {', '.join(known)}")
    value = getattr(parameters, name)
    if value is None:
        raise InputError(f"{name} has no value in this vehicle, so it cannot be varied; add it to the vehicle file")
    changed: dict[str, Any] = {
        name: Corners(*(factor * part for part in value)) if isinstance(value, Corners) else factor * value
    }
    return replace(parameters, **changed)
