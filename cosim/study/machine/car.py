"""A vehicle FMU as matrices: x' = A x + B u, y = C x + D u, with friction and springs at its ports."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from cosim.components.fmu_component import FmuComponent
from cosim.study.definition import Parameters
from cosim.study.machine.sources import Constants, Sources
from eightpost.machine import NotInBatchError, Port, Vehicle

#: Parameters of the ports, in the order of PortFriction in fmus/machine/car.h; the last one is that of springs.
_FRICTION = (
    "friction_force", "friction_velocity", "bristle_force", "bristle_reach", "bristle_static_ratio",
    "bristle_stribeck_velocity",
)  # fmt: skip
_SPRING = "port_spring"
_AT_EQUILIBRIUM = "start_at_equilibrium"

#: Constants that FMUs of earlier versions lack, which have no coupled states.
_NONE_COUPLED = "enum { COUPLED_COUNT = 0 };\nstatic const double COUPLING[1] = {0.0};\n"


@dataclass(frozen=True, slots=True, eq=False)
class FmuVehicle(Vehicle):
    """A vehicle FMU."""

    inputs: tuple[str, ...]  #: Names of the inputs.
    outputs: tuple[str, ...]  #: Names of the outputs.
    ports: tuple[Port, ...]  #: Ports with friction or springs.


def read_vehicle(component: FmuComponent, path: Path, given: Parameters) -> FmuVehicle:
    """Return a vehicle FMU as matrices.

    Args:
        component: FMU.
        path: FMU file.
        given: Values of parameters that differ from the FMU's.

    Raises:
        NotInBatchError: It is not a vehicle of this project, or contains no sources.
    """
    sources = Sources.of(component, path)
    if sources.kind != "vehicle_ss":
        raise NotInBatchError(f"{path.name} is not a vehicle but {sources.kind}")
    values = {v.name: v.start for v in component.variables.values() if v.causality == "parameter"} | dict(given)
    try:
        return _vehicle(component, Constants.of(_NONE_COUPLED + sources.files["vehicle_data.h"]), values)
    except (KeyError, ValueError) as error:
        raise NotInBatchError(f"{path.name} has other constants than this version knows: {error}") from error


def _vehicle(component: FmuComponent, constants: Constants, values: Mapping[str, object]) -> FmuVehicle:
    sizes = constants.sizes
    inputs, outputs = _names(component, "input"), _names(component, "output")
    modes, pairs = sizes["MODE_COUNT"], sizes["PAIR_COUNT"]
    rows = np.r_[0:modes, sizes["MODES"] : sizes["MODES"] + pairs]  # real parts, imaginary parts of pairs; no padding
    A = np.diag(np.r_[constants.filled("SIGMA", modes), constants.filled("SIGMA", modes)[:pairs]])
    omega = constants.filled("OMEGA", modes)[:pairs]
    A[:pairs, modes:], A[modes:, :pairs] = np.diag(-omega), np.diag(omega)
    coupled = sizes["COUPLED_COUNT"]
    own = slice(modes - coupled, modes)
    A[own, own] += constants.filled("COUPLING", coupled**2).reshape(coupled, coupled)
    shape = sizes["STATE_BLOCKS"], len(inputs), sizes["BLOCK"]
    B = constants.filled("B", int(np.prod(shape))).reshape(shape).transpose(0, 2, 1).reshape(-1, len(inputs))
    C = constants.filled("C", len(outputs) * sizes["STATE_COUNT"]).reshape(len(outputs), -1)
    D = np.zeros((len(outputs), len(inputs)))
    begin = constants.integers("DIRECT_BEGIN", len(outputs) + 1)
    columns, terms = constants.integers("DIRECT_INPUT", sizes["DIRECT_TERMS"]), constants.numbers["DIRECT_TERM"]
    for k in range(len(outputs)):
        D[k, columns[begin[k] : begin[k + 1]]] = terms[begin[k] : begin[k + 1]]
    at_rest = values.get(_AT_EQUILIBRIUM, True) in (True, "true", "1")
    if at_rest and not sizes["HAS_EQUILIBRIUM"]:
        raise NotInBatchError("the vehicle has no unique steady state")
    places = constants.integers("OFFSET_OF", len(outputs))
    offsets = [float(v) for n, v in values.items() if _is_offset(n)]  # type: ignore[arg-type]
    offset = np.array([offsets[place] if place >= 0 else 0.0 for place in places])
    ports = tuple(_ports(constants, sizes, values))
    return FmuVehicle(A, B[rows], C[:, rows], D, offset, at_rest, inputs, outputs, ports)


def _ports(constants: Constants, sizes: Mapping[str, int], values: Mapping[str, object]) -> list[Port]:
    count, springs = sizes["PORT_COUNT"], sizes["SPRING_COUNT"]
    friction = np.array([_own(values, name) for name in _FRICTION]).reshape(len(_FRICTION), -1)
    stiffness = np.zeros(count)
    travel: list[int | None] = [None] * count
    of_port, output = constants.integers("SPRING_PORT", springs), constants.integers("SPRING_OUTPUT", springs)
    for port, place, own in zip(of_port, output, _own(values, _SPRING), strict=True):
        stiffness[port], travel[port] = own, int(place)
    inputs, velocities = constants.integers("PORT_INPUT", count), constants.integers("PORT_OUTPUT", count)
    return [
        Port(int(inputs[k]), int(velocities[k]), travel[k], (*friction[:, k].tolist(), float(stiffness[k])))
        for k in range(count)
    ]


def _names(component: FmuComponent, causality: str) -> tuple[str, ...]:
    return tuple(v.name for v in component.variables.values() if v.causality == causality)


def _own(values: Mapping[str, object], name: str) -> list[float]:
    return [float(v) for n, v in values.items() if n.rpartition(".")[2] == name]  # type: ignore[arg-type]


def _is_offset(name: str) -> bool:
    return name.rpartition(".")[2] not in (*_FRICTION, _SPRING, _AT_EQUILIBRIUM)
