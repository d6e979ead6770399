"""Reading and writing of vehicle files (.toml and .json)."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from eightpost.errors import FileFormatError
from eightpost.vehicle.exchange import read_json, write_json
from eightpost.vehicle.parameters import read_toml, write_toml
from eightpost.vehicle.vehicles import IdentifiedVehicle, StructuralVehicle, Vehicle


def read_vehicle(path: str | Path) -> Vehicle:
    """Read a vehicle: parameters from a .toml file, an identified model from a .json file.

    >>> read_vehicle(shipped("seven_dof")).model
    'seven_dof'

    Raises:
        FileFormatError: The file does not have the format of its suffix.
        ParameterError: A key or a value is invalid.
        UnknownUnitError: A unit is unknown or has the wrong dimension.
    """
    suffix = Path(path).suffix.lower()
    if suffix == ".toml":
        return read_toml(path)
    if suffix == ".json":
        return read_json(path)
    raise FileFormatError("a vehicle is a .toml file (parameters) or a .json file (identified model)", path=path)


def write_vehicle(path: str | Path, vehicle: Vehicle) -> None:
    """Write a vehicle; an existing file is replaced only when the new one is complete.

    Raises:
        FileFormatError: The suffix does not match the vehicle: .toml for parameters, .json for an identified model.
    """
    suffix = Path(path).suffix.lower()
    if isinstance(vehicle, StructuralVehicle) and suffix == ".toml":
        write_toml(path, vehicle)
    elif isinstance(vehicle, IdentifiedVehicle) and suffix == ".json":
        write_json(path, vehicle)
    else:
        needed = ".toml" if isinstance(vehicle, StructuralVehicle) else ".json"
        raise FileFormatError(f"the vehicle {vehicle.name!r} ({vehicle.model}) must be written as {needed}", path=path)


def shipped(model: Literal["quarter_car", "seven_dof"]) -> Path:
    """Return the path of the file with the dissertation's Table 4.1 (quarter car) or Table 5.1 (seven-DOF car)."""
    return Path(__file__).with_name(f"{model}.toml")
