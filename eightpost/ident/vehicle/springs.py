"""Nonlinear springs at the ports: their test, and the coefficient of the port springs that represent them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from eightpost.corners import channel
from eightpost.ident.response.records import gather
from eightpost.ident.vehicle.experiment import Experiment
from eightpost.ident.vehicle.projection import bands, solve_forces
from eightpost.ident.vehicle.trust import ForceEstimate
from eightpost.signals import TimeSeries
from eightpost.vehicle import IdentifiedVehicle, LinearStepper, add_port_stiffness, friction

#: Sentences on the springs of a model.
_LINEAR = "The model has linear springs; it is valid for travel as in the tests."
MODELLED = "The vehicle has these forces at its ports (k2 d^2)."


@dataclass(frozen=True, slots=True)
class SpringSearch:
    """Settings of the test for nonlinear springs."""

    seconds: float = 100.0  #: Duration of each record that is used [s].
    low: float = 0.3  #: Lowest frequency [Hz].
    high: float = 16.0  #: Highest frequency [Hz].
    iterations: int = 4  #: Number of Gauss-Newton steps.

    def find(self, tests: Sequence[TimeSeries], experiment: Experiment) -> Mapping[str, ForceEstimate]:
        """Return F_2 by port, or an empty mapping if the records have no travel of the ports.

        Args:
            tests: Records with the channels of the experiment and friction included in the forces, all at one sample
                rate.
            experiment: Inputs, shock forces and outputs of the tests.

        Raises:
            TooShortError: The records have too few frequency bins.
        """
        if not all(channel(port, "displacement") in test for test in tests for port in experiment.ports):
            return {}
        samples = round(self.seconds * tests[0].sample_rate)
        sizes = mean_squares(tests[0], experiment.ports)
        marked = [_with_squares(test, sizes, samples) for test in tests]
        squares = [channel(port, "travel_squared") for port in experiment.ports]
        records = gather(marked, [*experiment.inputs, *squares], experiment.outputs, experiment.baseline_damping)
        count = len(experiment.inputs)
        found = solve_forces(
            list(bands(records, low=self.low, high=self.high, inputs=count)), count, iterations=self.iterations
        )
        return found.estimates(experiment.ports)


def mean_squares(series: TimeSeries, ports: Sequence[str]) -> dict[str, float]:
    """Return the mean square of every port's travel about its mean [m2]."""
    return {port: max(float(np.var(series[channel(port, "displacement")])), 1e-300) for port in ports}


def port_springs(
    springs: Mapping[str, ForceEstimate], tests: Sequence[TimeSeries], ports: Sequence[str]
) -> dict[str, float]:
    """Return the coefficient k2 [N/m2] of the ports' springs `k2 d^2` whose force is significant, by port.

    Args:
        springs: Estimate of `SpringSearch`.
        tests: Records of the estimate.
        ports: Ports of the car.
    """
    found = {port: force.value for port, force in springs.items() if force.is_significant}
    sizes = mean_squares(tests[0], [port for port in ports if port in found])
    return {port: found[port] / size for port, size in sizes.items()}


def about_tests(vehicle: IdentifiedVehicle, loads: Mapping[str, float]) -> IdentifiedVehicle:
    """Return a vehicle whose port springs have the mean travel of its tests.

    It is unchanged if it has no steady state without loads.

    Args:
        vehicle: Vehicle about the mean of its tests.
        loads: Mean loads on the chassis in the tests [N, N.m], by input.
    """
    try:
        without = _travel(vehicle, {load: -mean for load, mean in loads.items()})
    except ValueError:
        return vehicle
    laws = {p: law._replace(mean_travel=-without[p]) if p in without else law for p, law in vehicle.friction.items()}
    return replace(vehicle, friction=laws) if without else vehicle


def about_loads(vehicle: IdentifiedVehicle, loads: Mapping[str, float]) -> IdentifiedVehicle:
    """Return a vehicle about the state with the mean loads of a drive, for simulations of the drive without its means.

    Args:
        vehicle: Vehicle that knows the mean travel of its tests.
        loads: Mean loads of the drive [N, N.m], by input.

    Raises:
        ValueError: There is no steady state with these loads.
    """
    unloaded = vehicle.unloaded()
    stiffer = {port: 2.0 * vehicle.friction[port].spring * d for port, d in _travel(unloaded, loads).items()}
    return replace(unloaded, state_space=add_port_stiffness(unloaded.state_space, stiffer), validity=None)


def _travel(vehicle: IdentifiedVehicle, loads: Mapping[str, float]) -> dict[str, float]:
    """Return the displacements at constant loads by port with a spring [m]; ValueError: there is no steady state."""
    springs = [port for port, law in vehicle.friction.items() if law.spring]
    if not springs:
        return {}
    model = vehicle.state_space
    stepper = LinearStepper(model.A, model.B, model.C, model.D)
    names = [channel(port, "") for port in springs]
    ports = friction.named_ports(stepper, (model.input_names, model.output_names), names, names)
    none, k2 = np.zeros(len(springs)), np.array([vehicle.friction[port].spring for port in springs])
    u = np.array([loads.get(name, 0.0) for name in model.input_names])
    x = friction.equilibrium(stepper, friction.PortFriction(ports, none, none + 1.0, spring=k2), u)
    return dict(zip(springs, (ports.displacement @ x).tolist(), strict=True))


def nonlinear_spring_sentence(springs: Mapping[str, ForceEstimate], *, held: str = _LINEAR) -> str | None:
    """Return a sentence on the nonlinear springs, or None if no force is significant.

    Args:
        springs: Estimate of `SpringSearch`.
        held: Sentence on the springs of the model.
    """
    found = {port: force for port, force in springs.items() if force.is_significant}
    if not found:
        return None
    listed = ", ".join(f"{port or 'port'} {f.text}" for port, f in found.items())
    return (
        "Springs or stops are not linear. Forces that grow with the square of the travel, at the RMS travel (+- two "
        f"standard deviations): {listed}. {held}"
    )


def _with_squares(series: TimeSeries, sizes: Mapping[str, float], samples: int) -> TimeSeries:
    """Return the first samples of a record with `s^2 / s_rms^2` of every port in the channel `travel_squared`.

    The mean squares `sizes` [m2] are the same for all records, so that one force belongs to all of them.
    """
    if len(series) > samples:
        series = series.window(float(series.time[0]), float(series.time[samples]))
    for port, size in sizes.items():
        travel = series[channel(port, "displacement")]
        squared = np.square(travel - travel.mean()) / size
        series = series.with_channel(channel(port, "travel_squared"), "1", squared)
    return series
