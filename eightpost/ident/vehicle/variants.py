"""Effect of a parameter of a structural vehicle on its frequency responses and modes (4.1.2, 5.1.2)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from eightpost.errors import InputError
from eightpost.ident.vehicle.frequency_response import FrequencyResponse, response_of
from eightpost.vehicle import IdentifiedVehicle, Mode, StateSpace, Vehicle
from eightpost.vehicle.structural import scaled

#: Number of frequencies in a response file and in a picture.
_POINTS = 800


class Variant(NamedTuple):
    """Response and modes of a vehicle, with its dampers."""

    response: FrequencyResponse
    modes: tuple[Mode, ...]


def frequencies_to(high: float) -> NDArray[np.float64]:
    """Return the frequencies [Hz] of a response file and of a picture, up to `high`; InputError: it is not possible."""
    if not 0.0 < high < 1e4:
        raise InputError(f"--set high={high:g}: give a frequency between 0 and 10000 Hz")
    return np.linspace(high / _POINTS, high, _POINTS)


def variants_of(
    vehicle: Vehicle, parameter: str | None, factors: Sequence[float], frequency: NDArray[np.float64]
) -> dict[str, Variant]:
    """Return a vehicle as it is, or with a parameter multiplied by each factor, by a label for tables and pictures.

    A parameter with a value per corner is multiplied at all four corners. The frequencies (K,) are in Hz.

    Raises:
        InputError: The vehicle is an identified model, has no such parameter, or the parameter has no value.
        ParameterError: A factor takes the parameter out of its range.
    """
    if parameter is None:
        return {"as given": _variant(vehicle.with_damper(), frequency)}
    if isinstance(vehicle, IdentifiedVehicle):
        raise InputError(
            f"{vehicle.name} is an identified model, which has no {parameter} to vary; give a .toml vehicle"
        )
    names = [declared.name for declared in fields(vehicle.parameters)]
    if parameter not in names:
        raise InputError(f"the vehicle has no parameter {parameter!r}; its parameters are {', '.join(names)}")
    if getattr(vehicle.parameters, parameter) is None:
        what = f"{parameter} has no value in this vehicle, so it cannot be varied; add it to the vehicle file"
        raise InputError(what)
    models = {factor: scaled(vehicle.parameters, parameter, factor).with_damper() for factor in factors}
    return {f"{parameter} x {factor:g}": _variant(model, frequency) for factor, model in models.items()}


def _variant(model: StateSpace, frequency: NDArray[np.float64]) -> Variant:
    return Variant(response_of(model, frequency), model.modes())
