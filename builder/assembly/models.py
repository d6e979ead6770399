"""The parts' equations in the library's own terms, from what their FMUs carry: for pictures and reference results."""

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

_BLOCK = 8  # rows that lie side by side: builder/native/vehicle_data.py


def start_values(assembly: Assembly, part: Part) -> dict[str, float | bool]:
    """Return what a part's variables start with in the assembly, by the part's own names."""
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
    """A vehicle: its linear model in modal coordinates, its friction, and what is added to its outputs."""

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
    for output, place in zip(data.integers("OFFSET_OUTPUT"), data.integers("OFFSET_PLACE"), strict=True):
        offsets[output] = float(values[added[place]]) if added else 0.0  # there is a row where there is none
    return VehicleModel(stepper, friction, offsets, bool(values["start_at_equilibrium"]))


class _Data:
    """The constants of a vehicle_data.h."""

    def __init__(self, text: str) -> None:
        text = re.sub(r"/\*.*?\*/", "", text, flags=re.DOTALL)
        self._arrays = {
            name: [float(cell) for cell in re.split(r"[,\s]+", cells.strip().rstrip(",").strip()) if cell]
            for name, cells in re.findall(r"static const \w+ (\w+)\[[^\]]*\] = \{(.*?)\};", text, flags=re.DOTALL)
        }
        self._counts: Mapping[str, int] = {name: int(n) for name, n in re.findall(r"\b([A-Z_]+) = (\d+)", text)}

    def integers(self, name: str) -> list[int]:
        return [int(value) for value in self._arrays[name]]

    def state_space(self, inputs: int, outputs: int) -> tuple[Array, Array, Array, Array]:
        """Return A (n, n), B (n, m), C (p, n), D (p, m); the state is all real parts, then the imaginary parts."""
        modes, pairs = self._counts["MODE_COUNT"], self._counts["PAIR_COUNT"]
        sigma, omega = (np.array(self._arrays[name])[:modes] for name in ("SIGMA", "OMEGA"))
        A = np.diag(np.concatenate([sigma, sigma[:pairs]]))
        for k in range(pairs):
            A[k, modes + k], A[modes + k, k] = -omega[k], omega[k]
        D = np.zeros((outputs, inputs))
        for k in range(self._counts["DIRECT_COUNT"]):
            place = self.integers("DIRECT_OUTPUT")[k], self.integers("DIRECT_INPUT")[k]
            D[place] = self._arrays["DIRECT_TERM"][k]
        return A, self._matrix("B", modes + pairs, inputs), self._matrix("C", outputs, modes + pairs), D

    def _matrix(self, name: str, rows: int, columns: int) -> Array:
        blocks = np.array(self._arrays[name]).reshape(-1, columns, _BLOCK)
        return blocks.transpose(0, 2, 1).reshape(-1, columns)[:rows]
