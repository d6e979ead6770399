"""Definition of an identification: the channels of the rig tests that are inputs, shock forces and outputs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

from eightpost.errors import ParameterError

if TYPE_CHECKING:
    from collections.abc import Iterable


@dataclass(frozen=True, slots=True)
class Experiment:
    """Channels of an identification and the damping around which the model is identified.

    Attributes:
        name: Name of the vehicle.
        rig: Inputs of the rig: roads, aeroloaders or forces and moments on the chassis.
        forces: Shock forces: `force` of each port.
        outputs: Outputs of the model, which include the shock velocities of all ports.
        baseline_damping: Baseline damping C-bar [N.s/m] by port ("lf", ...; "" for a quarter car).
        static: Values of the static state by output, SI, as in `IdentifiedVehicle`.
        sources: SHA-256 digests of the files, by name.
        means: Means of the first test's outputs, SI, if they were removed from the records; used to detect tires that
            lift off.
    """

    name: str
    rig: tuple[str, ...]
    forces: tuple[str, ...]
    outputs: tuple[str, ...]
    baseline_damping: Mapping[str, float]
    static: Mapping[str, float] = field(default_factory=dict)
    sources: Mapping[str, str] = field(default_factory=dict)
    means: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Check that every port has a velocity and a damping."""
        for port in self.ports:
            if channel(port, "velocity") not in self.outputs:
                raise ParameterError(
                    f"{self.name}: {channel(port, 'velocity')} must be an output, as a shock law needs it"
                )
            if port not in self.baseline_damping:
                raise ParameterError(f"{self.name}: the port {port!r} has no baseline damping; specify one [N.s/m]")

    @property
    def inputs(self) -> tuple[str, ...]:
        """Inputs of the rig, then the shock forces."""
        return self.rig + self.forces

    @property
    def ports(self) -> tuple[str, ...]:
        """Ports in the order of the forces."""
        return tuple(name.removesuffix("force").rstrip(".") for name in self.forces)

    def of(self, *outputs: str) -> Experiment:
        """Return the experiment with the given outputs and the shock velocities only.

        Raises:
            ParameterError: The experiment has no such output.
        """
        unknown = [name for name in outputs if name not in self.outputs]
        if unknown:
            raise ParameterError(f"there is no output {', '.join(unknown)}; the outputs are {', '.join(self.outputs)}")
        kept = {channel(port, "velocity") for port in self.ports} | set(outputs)
        return replace(self, outputs=tuple(name for name in self.outputs if name in kept))


def channel(port: str, quantity: str) -> str:
    """Return the name of a port's channel: `lf.force`, or `force` for a quarter car."""
    return f"{port}.{quantity}" if port else quantity


def experiment_of(
    names: Iterable[str],
    baseline_damping: Mapping[str, float],
    *,
    name: str = "vehicle",
    sources: Mapping[str, str] | None = None,
) -> Experiment:
    """Return the experiment for records with the given channels: a quarter car, a seven-DOF car or an 8-post rig.

    Args:
        names: Names of the channels that all records have, as in docs/rig.md.
        baseline_damping: Baseline damping C-bar [N.s/m] by port.
        name: Name of the vehicle.
        sources: SHA-256 digests of the files, by name.

    Raises:
        ParameterError: The channels do not include the road and the force of each shock.
    """
    available = tuple(names)
    ports = ("",) if "road" in available else ("lf", "rf", "lr", "rr")
    roads, forces = (tuple(channel(port, quantity) for port in ports) for quantity in ("road", "force"))
    aero = tuple(n for n in (channel(port, "aero") for port in ports) if n in available)
    loads = aero or tuple(n for n in _LOADS if n in available)
    if not set(roads + forces) <= set(available):
        missing = ", ".join(sorted(set(roads + forces) - set(available)))
        raise ParameterError(
            f"{name}: the records lack {missing}; a rig test needs the road and the force of each shock"
        )
    outputs = tuple(channel(port, quantity) for quantity in _CORNER_OUTPUTS for port in ports)
    outputs = tuple(n for n in (*outputs, *_CAR_OUTPUTS) if n in available)
    return Experiment(name, roads + loads, forces, outputs, baseline_damping, {}, sources or {})


#: Loads on a chassis without aeroloaders.
_LOADS = ("aero_force", "heave_force", "roll_moment", "pitch_moment")
#: Outputs of Table 6.1 that the model has if the records have them.
_CORNER_OUTPUTS = ("velocity", "displacement", "tire_force", "hub_acceleration", "chassis_acceleration")
_CAR_OUTPUTS = ("ride_height", "front.ride_height", "rear.ride_height", "driver.acceleration")
