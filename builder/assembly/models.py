"""The parts as models of the library, read from the contents of their FMUs, for pictures and reference results."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from builder.assembly.parts import Part
from builder.assembly.plan import Assembly
from builder.interface import friction_ports
from eightpost.shock import LAWS, Port, ShockLaw, StaticCurve
from eightpost.vehicle import LinearStepper
from eightpost.vehicle.friction import PortFriction, ports_of

Array = NDArray[np.float64]


def start_values(assembly: Assembly, part: Part) -> dict[str, float | bool]:
    """Return the start values of a part's variables in the assembly, by their names in the part."""
    own = {v.name: v.start for v in part.interface.variables if v.start is not None}
    return {name: assembly.starts.get(f"{part.name}.{name}", value) for name, value in own.items()}


def shock_law(assembly: Assembly, part: Part) -> ShockLaw:
    """Return a shock's law with its start values."""
    values = {name: float(value) for name, value in start_values(assembly, part).items()}
    law = LAWS[part.kind.removeprefix("shock_")]
    lists: dict[str, tuple[float, ...]] = {}
    for name, value in values.items():
        if found := re.fullmatch(r"curve\.(\w+)\[\d+\]", name):
            lists[found[1]] = (*lists.get(found[1], ()), value)
    scalars = {name.removeprefix("curve."): value for name, value in values.items() if name.startswith("curve.")}
    curve = {f.name: lists.get(f.name, scalars.get(f.name)) for f in dataclasses.fields(StaticCurve)}
    port = Port(**{f.name: values[f.name] for f in dataclasses.fields(Port)})
    own = {f.name: values[f.name] for f in dataclasses.fields(law) if f.name not in ("curve", "port")}
    return law(curve=StaticCurve(**curve), port=port, **own)  # type: ignore[arg-type]


@dataclass(frozen=True, slots=True, eq=False)
class VehicleModel:
    """A vehicle: its linear model in modal coordinates, its friction, and the offsets of its outputs."""

    stepper: LinearStepper
    friction: PortFriction
    offsets: Array
    starts_at_equilibrium: bool


def vehicle_model(assembly: Assembly) -> VehicleModel:
    """Return the vehicle with its start values."""
    part = assembly.vehicle
    values, data, named = start_values(assembly, part), _Data(part.data), part.interface
    inputs, outputs = named.names("input"), named.names("output")
    stepper = LinearStepper(*data.state_space(len(inputs), len(outputs)))
    ports = friction_ports(named)
    friction = PortFriction(
        ports_of(stepper, [inputs.index(f"{p}force") for p in ports], [outputs.index(f"{p}velocity") for p in ports]),
        np.array([float(values[f"{p}friction_force"]) for p in ports]),
        np.array([float(values[f"{p}friction_velocity"]) for p in ports]),
    )
    offsets = np.zeros(len(outputs))
    added = [v.name for v in named.variables if v.causality == "parameter" and v.type == "Real"]
    added = [name for name in added if not name.rpartition(".")[2].startswith("friction")]
    for output, place in enumerate(data.integers("OFFSET_OF")):
        offsets[output] = float(values[added[place]]) if place >= 0 else 0.0
    return VehicleModel(stepper, friction, offsets, bool(values["start_at_equilibrium"]))


class _Data:
    """The constants of a vehicle_data.h that builder/native/vehicle_data.py has written."""

    def __init__(self, text: str) -> None:
        text = re.sub(r"/\*.*?\*/", "", text, flags=re.DOTALL)
        self._arrays = {
            name: [float(cell) for cell in re.findall(r"[^{},\s]+", cells)]
            for name, cells in re.findall(r"static const \w+ (\w+)\[[^;]*?\] = \{(.*?)\};", text, flags=re.DOTALL)
        }
        self._counts: Mapping[str, int] = {name: int(n) for name, n in re.findall(r"\b([A-Z_]+) = (\d+)", text)}

    def integers(self, name: str) -> list[int]:
        return [int(value) for value in self._arrays[name]]

    def state_space(self, inputs: int, outputs: int) -> tuple[Array, Array, Array, Array]:
        """Return A (n, n), B (n, m), C (p, n), D (p, m); the state is all real parts, then the imaginary parts."""
        modes, pairs, room = (self._counts[name] for name in ("MODE_COUNT", "PAIR_COUNT", "MODES"))
        used = np.concatenate([np.arange(modes), room + np.arange(pairs)])
        sigma, omega = (np.array(self._arrays[name])[:modes] for name in ("SIGMA", "OMEGA"))
        A = np.diag(np.concatenate([sigma, sigma[:pairs]]))
        for k in range(pairs):
            A[k, modes + k], A[modes + k, k] = -omega[k], omega[k]
        blocks = np.array(self._arrays["B"]).reshape(-1, inputs, self._counts["BLOCK"])
        B = blocks.transpose(0, 2, 1).reshape(-1, inputs)[used]
        C = np.array(self._arrays["C"]).reshape(outputs, -1)[:, used]
        return A, B, C, self._direct(inputs, outputs)

    def _direct(self, inputs: int, outputs: int) -> Array:
        begins, columns, terms = (
            self.integers("DIRECT_BEGIN"),
            self.integers("DIRECT_INPUT"),
            self._arrays["DIRECT_TERM"],
        )
        D = np.zeros((outputs, inputs))
        for row in range(outputs):
            for k in range(begins[row], begins[row + 1]):
                D[row, columns[k]] = terms[k]
        return D
