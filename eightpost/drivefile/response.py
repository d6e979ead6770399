"""Response of the target channels to the commands of the rig, from an identified car or a car's parameters."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from eightpost.array_types import Array, Complex
from eightpost.corners import channel
from eightpost.drivefile.target import Target
from eightpost.errors import ParameterError
from eightpost.ident.response import FrequencyResponse
from eightpost.ident.vehicle.port_laws import bristle_force
from eightpost.shock import ShockLaw
from eightpost.signals.filters import velocity_from_displacement
from eightpost.vehicle import Friction, IdentifiedVehicle, StateSpace, StructuralVehicle, Vehicle, add_port_damping

#: Low-pass of displacements before differentiation, as for the rig's records [Hz].
_CUTOFF = 50.0


@dataclass(frozen=True, slots=True)
class ActuatorBands:
    """Control bandwidths of the rig's actuators, second-order Butterworth low-passes.

    Raises:
        ParameterError: A bandwidth is not above 0 Hz.
    """

    wheelloader: float = 125.0  #: Bandwidth of the wheelloaders [Hz]; 125 in 6.1.1.
    aeroloader: float = 9.0  #: Bandwidth of the aeroloaders [Hz]; 9 in 6.1.1.

    def __post_init__(self) -> None:
        if not (self.wheelloader > 0.0 and self.aeroloader > 0.0):
            raise ParameterError(f"{self}: the bandwidths must be above 0 Hz")

    def response(self, frequency: Array, units: tuple[str, ...]) -> Complex:
        """Return the actual value per command (K, m) for inputs with the given units at frequencies (K,) [Hz]."""
        bands = np.array([self.wheelloader if unit == "m" else self.aeroloader for unit in units])
        ratio = frequency[:, None] / bands
        return np.asarray(1.0 / (1.0 + np.sqrt(2.0) * 1j * ratio - ratio**2), dtype=np.complex128)


@dataclass(frozen=True, slots=True, eq=False)
class StartResponse:
    """Response that an iteration starts with."""

    #: Response from the commands to the target channels at the lines of a drive file, with the coherence of the
    #: identification.
    response: FrequencyResponse
    static: Array  #: Change of the target channels per steady input (p, m); zero in columns of roads.
    notes: tuple[str, ...] = ()  #: Notes for the user, one sentence each.


def start_response(
    vehicle: Vehicle,
    target: Target,
    *,
    shocks: Mapping[str, ShockLaw] | None = None,
    actuators: ActuatorBands | None = None,
    measured: FrequencyResponse | None = None,
) -> StartResponse:
    """Return the response of a car on the rig, about its motion on the track.

    Friction and shocks are replaced by the linear dampers that take up the same power at the velocities of the
    track record: c = <F v> / <v^2>.

    Args:
        vehicle: Identified or structural car.
        target: Target.
        shocks: Shock law on the car by corner; a corner without one has the damping of the identification.
        actuators: Bandwidths of the actuators; default those of 6.1.1.
        measured: Response of the identification, for its coherence; None if it is not known.

    Raises:
        ParameterError: The car lacks a target channel, or is not continuous.
    """
    model, notes = _about_the_track(vehicle, target, shocks or {})
    if missing := [name for name in target.names if name not in model.output_names]:
        raise ParameterError(
            f"the car {vehicle.name!r} lacks the outputs {', '.join(missing)}; identify it with these channels, or "
            "choose other channels with --channels"
        )
    rig = tuple(c for c in model.inputs if c.name.rpartition(".")[2] != "force")
    chosen = model.select(inputs=[c.name for c in rig], outputs=target.names)
    frequency = target.lines.frequency
    follows = (actuators or ActuatorBands()).response(frequency, tuple(c.unit for c in rig))
    H = chosen.frequency_response(frequency) * follows.T[None]
    coherence = _coherence(measured, target, frequency)
    return StartResponse(
        FrequencyResponse(frequency, H, rig, chosen.outputs, coherence), _static(chosen, notes), tuple(notes)
    )


def _about_the_track(vehicle: Vehicle, target: Target, shocks: Mapping[str, ShockLaw]) -> tuple[StateSpace, list[str]]:
    notes: list[str] = []
    if isinstance(vehicle, StructuralVehicle):
        if shocks:
            raise ParameterError(f"{vehicle.name} has its own dampers; omit --shock")
        return vehicle.with_damper(), notes
    added = {}
    for port in {**vehicle.baseline_damping, **vehicle.friction, **shocks}:
        velocity = _velocity(target, port)
        if velocity is None:
            notes.append(f"{channel(port, 'displacement')} is not a target, so friction and shock of this corner are "
                         "not converted to damping.")  # fmt: skip
            continue
        added[port] = _added_damping(vehicle, port, shocks.get(port), (velocity, target.rate))
    if unknown := [port for port in shocks if channel(port, "force") not in vehicle.state_space.input_names]:
        raise ParameterError(f"the car {vehicle.name!r} has no corner {unknown[0]!r}; correct --shock")
    return add_port_damping(vehicle.state_space, added), notes


def _velocity(target: Target, port: str) -> Array | None:
    """Return the shock velocity (N,) of a corner on the track, None if its displacement is not a target."""
    name = channel(port, "displacement")
    if name not in target.names:
        return None
    return velocity_from_displacement(target.series[name], target.rate, min(_CUTOFF, 0.4 * target.rate))


def _added_damping(vehicle: IdentifiedVehicle, port: str, law: ShockLaw | None, on_track: tuple[Array, float]) -> float:
    """Return the damping [N.s/m] of friction and shock at the track's velocities, minus the baseline damping.

    `on_track` has the velocities of the port [m/s] and their sample rate [Hz].
    """
    velocity, rate = on_track
    friction = vehicle.friction.get(port, Friction())
    force = friction.force * np.tanh(velocity / friction.velocity) + bristle_force(velocity, rate, friction.bristle)
    if law is not None:
        curve = np.array([law.static_force(float(v)) for v in np.linspace(velocity.min(), velocity.max(), 201)])
        force = force + np.interp(velocity, np.linspace(velocity.min(), velocity.max(), 201), curve)
        force = force - vehicle.baseline_damping.get(port, 0.0) * velocity
    return float(np.mean(force * velocity) / np.mean(velocity**2))


def _coherence(measured: FrequencyResponse | None, target: Target, frequency: Array) -> Array | None:
    """Return the coherence (p, K) of the identification at the lines; 0 above its band, its edge value below."""
    if measured is None or measured.coherence is None:
        return None
    if any(name not in measured.output_names for name in target.names):
        return None
    rows = measured.select(outputs=target.names).coherence
    if rows is None:
        return None
    return np.stack([np.interp(frequency, measured.frequency, row, right=0.0) for row in rows])


def _static(model: StateSpace, notes: list[str]) -> Array:
    """Return the static gain (p, m), with zero columns for roads."""
    try:
        gain = model.dc_gain()
    except ParameterError as error:
        notes.append(f"The means of the target are not reproduced: {error}.")
        return np.zeros((len(model.outputs), len(model.inputs)))
    loads = np.array([c.unit != "m" for c in model.inputs])
    return np.asarray(np.where(loads, gain, 0.0))
