"""A vehicle FMU as data of a batch: its modes, matrices and parameters."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from cosim.components.fmu_component import FmuComponent
from cosim.study.batch.reasons import NotInBatchError
from cosim.study.batch.sources import Constants, Sources
from cosim.study.study import Parameters
from eightpost.array_types import Array

#: Names of the sizes of vehicle_data.h that the library needs.
_SIZES = (
    "MODE_COUNT", "MODES", "PAIR_COUNT", "PAIRS", "COUPLED_COUNT", "COUPLED", "COUPLED_CELLS", "LANES", "STATE_COUNT",
    "BLOCK", "STATE_BLOCKS", "DIRECT_TERMS", "PORT_COUNT", "PORTS", "SPRING_COUNT", "SPRINGS",
)  # fmt: skip

#: Parameters of the ports, in the order of CarParameters in fmus/batch/car.h; the last one is that of springs.
_PORT = (
    "friction_force", "friction_velocity", "bristle_force", "bristle_reach", "bristle_static_ratio",
    "bristle_stribeck_velocity",
)  # fmt: skip
_SPRING = "port_spring"
_AT_EQUILIBRIUM = "start_at_equilibrium"

#: Constants that FMUs of older versions lack, which have no coupled states.
_NONE_COUPLED = """enum { COUPLED_COUNT = 0, COUPLED = 1, COUPLED_CELLS = 1 };
static const double COUPLING[COUPLED_CELLS] = {0.0};
static const double COUPLED_AT_REST[COUPLED_CELLS] = {0.0};
static const double FASTEST_COUPLED = 0.0;
"""


@dataclass(frozen=True, slots=True, eq=False)
class CarData:
    """A vehicle of a batch."""

    sizes: str  #: Content of sizes.h.
    data: bytes  #: Bytes of the structure Car of fmus/batch/car.h.
    inputs: tuple[str, ...]  #: Names of the inputs, in order.
    outputs: tuple[str, ...]  #: Names of the outputs, in order.


def read_car(component: FmuComponent, path: Path, given: Parameters, corners: int) -> CarData:
    """Return the data of a vehicle FMU.

    Args:
        component: FMU.
        path: FMU file.
        given: Values of parameters that differ from the FMU's.
        corners: Number of shocks.

    Raises:
        NotInBatchError: It is not a vehicle of this project, or contains no sources.
    """
    sources = Sources.of(component, path)
    if sources.kind != "vehicle_ss":
        raise NotInBatchError(f"{path.name} is not a vehicle but {sources.kind}")
    try:
        return _car(component, sources.files["vehicle_data.h"], given, corners)
    except (KeyError, ValueError) as error:
        raise NotInBatchError(f"{path.name} has other constants than this version knows: {error}") from error


def _car(component: FmuComponent, text: str, given: Parameters, corners: int) -> CarData:
    constants = Constants.of(_NONE_COUPLED + text)
    inputs, outputs = _names(component, "input"), _names(component, "output")
    sizes = {name: constants.sizes[name] for name in _SIZES}
    sizes |= {"INPUTS": len(inputs), "OUTPUTS": len(outputs), "CORNERS": corners}
    names = ", ".join(f"{name} = {size}" for name, size in sizes.items())
    header = f"#ifndef EIGHTPOST_SIZES_H\n#define EIGHTPOST_SIZES_H\n\nenum {{ {names} }};\n\n#endif\n"
    values = {v.name: v.start for v in component.variables.values() if v.causality == "parameter"} | dict(given)
    return CarData(header, _data(constants, sizes, values), inputs, outputs)


def _names(component: FmuComponent, causality: str) -> tuple[str, ...]:
    return tuple(v.name for v in component.variables.values() if v.causality == causality)


def _data(constants: Constants, sizes: Mapping[str, int], values: Mapping[str, object]) -> bytes:
    modes, ports, outputs = sizes["MODES"], sizes["PORTS"], sizes["OUTPUTS"]
    block = sizes["STATE_BLOCKS"] * sizes["INPUTS"] * sizes["BLOCK"]
    own = {name: _own(values, name) for name in (*_PORT, _SPRING)}
    rest = [float(v) for n, v in values.items() if _is_offset(n)]  # type: ignore[arg-type]
    places = constants.integers("OFFSET_OF", outputs)
    numbers = [
        constants.filled("SIGMA", modes),
        constants.filled("OMEGA", modes),
        constants.numbers["FASTEST"],
        constants.filled("COUPLING", sizes["COUPLED_CELLS"]),
        constants.filled("COUPLED_AT_REST", sizes["COUPLED_CELLS"]),
        constants.numbers["FASTEST_COUPLED"],
        constants.filled("B", block),
        constants.filled("C", outputs * sizes["STATE_COUNT"]),
        constants.filled("DIRECT_TERM", sizes["DIRECT_TERMS"]),
        constants.filled("MOBILITY", ports),
        np.array([rest[place] if place >= 0 else 0.0 for place in places]),
        *(_filled(own[name], ports) for name in _PORT),
        _filled(own[_SPRING], sizes["SPRINGS"]),
    ]
    integers = [
        constants.integers("DIRECT_BEGIN", outputs + 1),
        constants.integers("DIRECT_INPUT", sizes["DIRECT_TERMS"]),
        constants.integers("PORT_INPUT", ports),
        constants.integers("PORT_OUTPUT", ports),
        constants.integers("SPRING_PORT", sizes["SPRINGS"]),
        constants.integers("SPRING_OUTPUT", sizes["SPRINGS"]),
        np.array([int(_is_true(values.get(_AT_EQUILIBRIUM, True))), constants.sizes["HAS_EQUILIBRIUM"]]),
        (places >= 0).astype(np.int64),
    ]
    return np.concatenate(numbers).tobytes() + np.concatenate(integers).astype(np.int32).tobytes()


def _own(values: Mapping[str, object], name: str) -> list[float]:
    return [float(v) for n, v in values.items() if n.rpartition(".")[2] == name]  # type: ignore[arg-type]


def _is_offset(name: str) -> bool:
    return name.rpartition(".")[2] not in (*_PORT, _SPRING, _AT_EQUILIBRIUM)


def _is_true(value: object) -> bool:
    return value in (True, "true", "1")


def _filled(values: list[float], count: int) -> Array:
    return np.array([*values, *[0.0] * (count - len(values))])
