"""Simulation of many setups of a vehicle on one drive, and free-running simulation of rig tests."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import astuple, dataclass, replace
from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray
from scipy.fft import next_fast_len
from scipy.signal import lfilter, resample

from eightpost.array_types import Array, Complex
from eightpost.cache import kept
from eightpost.corners import channel
from eightpost.errors import EightpostError, InputError, ParameterError, StepError
from eightpost.ident.vehicle.experiment import quantity
from eightpost.ident.vehicle.stability import closed_loop_stability
from eightpost.shock import ShockLaw
from eightpost.shock.compiled import LAW_FILES, law_numbers, law_step
from eightpost.shock.curve import KNOTS, StaticCurve
from eightpost.shock.polylinear import Polylinear
from eightpost.signals import TimeSeries
from eightpost.vehicle import Friction, IdentifiedVehicle, StateSpace, add_port_damping
from eightpost.vehicle.compiled import BRISTLE_FILE, deflection_after

# ==== Many setups ====================================================================================================

Whole = NDArray[np.intp]


# ---- Compiled loop of `many_setups`, which simulates one setup over all samples of a drive --------------------------
# Loops over elements in place of whole arrays: numba compiles those for seconds each.

_MAX_ITERATIONS = 60
#: Change of the forces [N] at which the iteration has converged.
_CLOSE = 1e-3


def _compiled(function: Callable[..., Any]) -> Callable[..., Any]:
    found: Callable[..., Any] = kept(numba.njit(nogil=True, error_model="numpy")(function), LAW_FILES + BRISTLE_FILE)
    return found


@_compiled
def _add_outputs(C: Any, rows: Any, x: Any, y: Any) -> None:
    """Add `Re C_i x` to y_i for the given rows i."""
    for i in range(rows.size):
        for m in range(x.size):
            y[i] += (C[rows[i], m] * x[m]).real


@_compiled
def _add_inputs(x: Any, weight: Any, change: Any) -> None:
    """Add `weight change` to the modes."""
    for m in range(x.size):
        for j in range(change.size):
            x[m] += weight[m, j] * change[j]


@_compiled
def _add_response(C: Any, rows: Any, weight: Any, j: int, gain: Any) -> None:
    """Add the response of the outputs of the given rows to input j to column j of a gain."""
    for i in range(rows.size):
        for m in range(weight.shape[0]):
            gain[i, j] += (C[rows[i], m] * weight[m, j]).real


@_compiled
def _outputs(C: Any, D: Any, x: Any, change: Any, y: Any) -> None:
    """Write the outputs due to modes and force differences to y."""
    for i in range(y.size):
        y[i] = 0.0
        for j in range(change.size):
            y[i] += D[i, j] * change[j]
        for m in range(x.size):
            y[i] += (C[i, m] * x[m]).real


@_compiled
def _solve_forces(model: Any, laws: Any, friction: Any, ports: Any, step: float) -> bool:
    """Find the force differences at the end of a step by iteration; return whether they converged.

    `ports` has the velocities without the forces of the step, the displacements, the force differences (on entry: the
    initial guess), and the states of the shocks, the deflections of the bristles and the velocities before the step (on
    return: after it). The first sample has a step of 0.
    """
    gain, damping = model
    free, place, change, states, bend, before = ports
    count = free.size
    v, force, after, bent = np.empty(count), np.empty(count), np.empty((count, 2)), np.empty(count)
    for iteration in range(_MAX_ITERATIONS):
        error = 0.0
        for i in range(count):
            v[i] = free[i]
            if step > 0.0:
                for j in range(count):
                    v[i] += gain[i, j] * change[j]
            moved, force[i] = law_step(laws[i], (states[i, 0], states[i, 1]), before[i], v[i], place[i], step)
            after[i, 0], after[i, 1] = moved
            rub = friction[i, 0] * math.tanh(v[i] / friction[i, 1]) if friction[i, 0] else 0.0
            bent[i] = bend[i]
            if friction[i, 2]:
                mean, law = 0.5 * (before[i] + v[i]), friction[i, 3:6]
                bent[i] = deflection_after(bend[i], mean, step, law[0], law[1], law[2])
                rub += friction[i, 2] / law[0] * bent[i]
            rub += friction[i, 6] * place[i] * place[i]
            force[i] += rub - damping[i] * v[i]
        for i in range(count):
            error = max(error, abs(force[i] - change[i]))
            change[i] = force[i] if iteration < _MAX_ITERATIONS // 2 else 0.5 * (force[i] + change[i])
        if error <= _CLOSE:
            for i in range(count):
                states[i, 0], states[i, 1], bend[i], before[i] = after[i, 0], after[i, 1], bent[i], v[i]
            return True
    return False


@_compiled
def _compiled_march(modes: Any, rows: Any, driven: Any, shocks: Any, step: float, every: int, out: Any) -> Any:
    """Simulate one setup.

    Args:
        modes: Decay (n,), weights of the force at the start and the end of a step (n, P), C (p, n), D (p, P), baseline
            damping (P,).
        rows: Indices of the velocities (P,) and displacements (P or 0,) among the outputs.
        driven: Outputs due to the drive alone (p, N).
        shocks: Laws of the ports as records (P,) of `LAW_NUMBERS`, and friction of each port (P, 7), see
            `friction_rows`.
        step: Step of the drive [s].
        every: Interval of the output samples, in samples of the drive.
        out: Array for the outputs (p, kept).

    Returns:
        -1, or the index of the sample at which the forces did not converge.
    """
    decay, held, ramp, C, D, damping = modes
    (velocities, displacements), (laws, friction) = rows, shocks
    count = damping.size
    x, gain = np.zeros(decay.size, dtype=np.complex128), np.zeros((count, count))
    free, place, y = np.zeros(count), np.zeros(count), np.zeros(C.shape[0])
    change, last, states, before = np.zeros(count), np.zeros(count), np.zeros((count, 2)), np.zeros(count)
    bend = np.zeros(count)
    for j in range(count):
        _add_response(C, velocities, ramp, j, gain)
    for k in range(driven.shape[1]):
        if k:
            for m in range(x.size):
                x[m] *= decay[m]
            _add_inputs(x, held, change)
        for i in range(count):
            free[i] = driven[velocities[i], k]
            place[i] = driven[displacements[i], k] if displacements.size else 0.0
            last[i], change[i] = change[i], 2.0 * change[i] - last[i]
        _add_outputs(C, velocities, x, free)
        _add_outputs(C, displacements, x, place)
        ports = (free, place, change, states, bend, before)
        if not _solve_forces((gain, damping), laws, friction, ports, step if k else 0.0):
            return k
        if k:
            _add_inputs(x, ramp, change)
        if k % every == 0:
            _outputs(C, D, x, change, y)
            for i in range(y.size):
                out[i, k // every] = driven[i, k] + y[i]
    return -1


# ---- Simulation of many setups of an identified vehicle on one drive ------------------------------------------------


def friction_rows(vehicle: IdentifiedVehicle, ports: Sequence[str]) -> Array:
    """Return F_f, v_f, F_s, z_s, rho, v_s and k2 of the ports (P, 7); see `eightpost.vehicle.Friction`."""
    laws = [vehicle.friction.get(port, Friction()) for port in ports]
    return np.array([[law.force, law.velocity, *astuple(law.bristle), law.spring] for law in laws]).reshape(-1, 7)


@dataclass(frozen=True, slots=True, eq=False)
class ManySetups:
    """Simulation of the setups of a vehicle with shocks from a bank, on one drive."""

    vehicle: IdentifiedVehicle  #: Identified continuous vehicle with the friction of its ports.
    #: Shock laws that setups choose from; their gas preload has no effect, as the vehicle moves about rest.
    bank: Sequence[ShockLaw]
    #: Evenly sampled inputs of the rig by name; missing ones are zero. Its sample rate is that of the simulation.
    drive: TimeSeries
    every: int = 1  #: Interval of the output samples, in samples of the drive.

    def run(self, setups: Sequence[Sequence[int]]) -> Array:
        """Simulate setups from rest.

        Args:
            setups: Bank indices of the shocks of each setup, in the order of the vehicle's ports.

        Returns:
            Outputs of the vehicle (setups, p, output samples).

        Raises:
            InputError: The drive or a setup does not match the vehicle.
            StepError: The forces of a step do not converge, as the shocks are too stiff for it.
        """
        plant = _Plant.of(self.vehicle, self.drive)
        chosen = np.asarray(setups, dtype=np.intp)
        if chosen.ndim != 2 or chosen.shape[1] != len(plant.ports):
            raise InputError(f"each setup needs one shock for each of {', '.join(plant.ports) or 'one port'}")
        laws = law_numbers(self.bank)
        laws["port"]["gas_preload"] = 0.0
        return plant.march(laws, friction_rows(self.vehicle, plant.ports), chosen, self.every)


@dataclass(frozen=True, slots=True, eq=False)
class _Plant:
    """Linear model in modal coordinates: n modes driven by P forces, and the response to the drive alone."""

    ports: tuple[str, ...]
    damping: Array
    decay: Complex
    held: Complex
    ramp: Complex
    C: Complex
    D: Array
    driven: Array
    velocities: list[int]
    displacements: list[int]
    step: float

    @classmethod
    def of(cls, vehicle: IdentifiedVehicle, drive: TimeSeries) -> _Plant:
        model, step = vehicle.state_space, 1.0 / drive.sample_rate
        if model.dt is not None:
            raise ParameterError(f"{model.name}: the model is discrete; setups are simulated with a continuous one")
        unknown = [name for name in drive.names if name not in model.input_names]
        if unknown:
            raise InputError(f"the drive has {', '.join(unknown)}, which {model.name} does not have as inputs")
        ports = tuple(vehicle.baseline_damping)
        poles, V = np.linalg.eig(model.A)
        B, C = np.linalg.solve(V, model.B.astype(np.complex128)), model.C @ V
        upper = poles.imag >= 0.0
        weight = np.where(poles.imag[upper] > 0.0, 2.0, 1.0)
        poles, B, C = poles[upper], B[upper], C[:, upper] * weight
        decay, held, ramp = _first_order(poles, step)
        forces = [model.input_names.index(channel(port, "force")) for port in ports]
        rows = [model.output_names.index(channel(port, "velocity")) for port in ports]
        places = [channel(port, "displacement") for port in ports]
        at = [model.output_names.index(n) for n in places] if set(places) <= set(model.output_names) else []
        return cls(
            ports,
            np.array([vehicle.baseline_damping[port] for port in ports]),
            decay,
            held[:, None] * B[:, forces],
            ramp[:, None] * B[:, forces],
            C,
            model.D[:, forces],
            _driven(model, drive, (decay, held, ramp), (B, C)),
            rows,
            at,
            step,
        )

    def march(self, laws: NDArray[np.void], friction: Array, chosen: Whole, every: int) -> Array:
        """Return the outputs (S, p, kept) of S setups; `chosen` (S, P) has the bank index of each port's shock."""
        kept = len(range(0, self.driven.shape[1], every))
        found = np.empty((len(chosen), len(self.C), kept))
        for one, places in zip(found, chosen, strict=True):
            shocks = laws[places], friction
            failed = _compiled_march(self.modes, self.rows, self.driven, shocks, self.step, every, one)
            if failed >= 0:
                raise StepError(
                    f"the shock forces at sample {failed} do not converge with steps of {self.step:g} s; resample the "
                    "drive at a higher rate"
                )
        return found

    @property
    def modes(self) -> tuple[Array | Complex, ...]:
        """Matrices of the model for the loop."""
        return self.decay, self.held, self.ramp, self.C, self.D, self.damping

    @property
    def rows(self) -> tuple[Whole, Whole]:
        """Indices of the velocities and displacements among the outputs."""
        return np.array(self.velocities, dtype=np.intp), np.array(self.displacements, dtype=np.intp)


def _first_order(poles: Complex, step: float) -> tuple[Complex, Complex, Complex]:
    """Return the decay, and the weights of the input at the start and at the end of a step with a linear input."""
    z = poles * step
    small = np.abs(z) < 1e-3
    safe = np.where(small, 1.0, z)
    decay = np.exp(z)
    mean = np.where(small, 1.0 + z / 2.0 + z**2 / 6.0, (decay - 1.0) / safe)
    ramp = np.where(small, 0.5 + z / 6.0 + z**2 / 24.0, (mean - 1.0) / safe)
    return np.asarray(decay), np.asarray(step * (mean - ramp)), np.asarray(step * ramp)


def _driven(
    model: StateSpace,
    drive: TimeSeries,
    stepping: tuple[Complex, Complex, Complex],
    modal: tuple[Complex, Complex],
) -> Array:
    """Return the outputs due to the drive alone without its means (p, N)."""
    columns = [model.input_names.index(name) for name in drive.names]
    u = drive.values - drive.values.mean(axis=1, keepdims=True)
    y = model.D[:, columns] @ u
    for decay, held, ramp, b, c in zip(*stepping, modal[0][:, columns], modal[1].T, strict=True):
        w = b @ u
        forcing = np.concatenate(([0.0], held * w[:-1] + ramp * w[1:]))
        y += np.real(c[:, None] * lfilter([1.0], [1.0, -decay], forcing)[None])
    return np.asarray(y)


# ==== Tests of the identification, with their own shocks in the loop =================================================


@dataclass(frozen=True, slots=True)
class ClosedLoop:
    """Simulation of a test with its own shocks in the loop.

    The shock force of the test is split into a line and a rest: F = c v + (F - c v), where c is the slope of the
    measured force over the measured velocity. The line follows the simulated velocity, and the rest is an input. For
    linear dampers nothing but the rig drives the simulation; friction at the ports always follows the simulation.
    """

    seconds: float = 60.0  #: Longest part of a test that is simulated, from its start [s].
    settling: float = 4.0  #: Time at the start that is left out, because the simulation starts at rest [s].
    rate: float = 1000.0  #: Minimum sample rate of the simulation [Hz].

    def outputs(self, vehicle: IdentifiedVehicle, test: TimeSeries) -> tuple[Array, Array]:
        """Return the simulated and the measured outputs of a test (p, N), without means, in the model's order.

        Args:
            vehicle: Continuous vehicle.
            test: Record with the velocity and force of every port and the outputs; missing inputs of the rig are zero.

        Raises:
            StepError: The simulation does not converge.
        """
        part, slopes = self._part(vehicle, test)
        ports = tuple(slopes)
        forces = tuple(channel(port, "force") for port in ports)
        names = [n for n in vehicle.state_space.input_names if n in part and n not in forces]
        rows = [part[name] for name in names]
        rest = [part[force] - slopes[p] * part[channel(p, "velocity")] for p, force in zip(ports, forces, strict=True)]
        finer = max(1, int(np.ceil(self.rate / part.sample_rate)))
        values = resample(np.stack([*rows, *rest]), finer * len(part), axis=1)
        units = (*(part.unit(name) for name in names), *("N",) * len(ports))
        time = np.arange(values.shape[1]) / (finer * part.sample_rate)
        drive = TimeSeries(time, values, (*names, *forces), units)
        closed = ManySetups(_around(vehicle, slopes), (_NO_SHOCK,), drive, finer).run([[0] * len(ports)])[0]
        kept = slice(self._first_sample(part), None)
        measured = np.stack([part[name] for name in vehicle.state_space.output_names])
        return _without_mean(closed[:, kept]), _without_mean(measured[:, kept])

    def closed(self, vehicle: IdentifiedVehicle, test: TimeSeries) -> tuple[StateSpace, dict[str, float], TimeSeries]:
        """Return the model with the lines of a test's shocks, their slopes [N.s/m] by port, and the settled record."""
        part, slopes = self._part(vehicle, test)
        return _around(vehicle, slopes).state_space, slopes, _samples(part, slice(self._first_sample(part), None))

    def _part(self, vehicle: IdentifiedVehicle, test: TimeSeries) -> tuple[TimeSeries, dict[str, float]]:
        part = _samples(test, slice(0, round(self.seconds * test.sample_rate)))
        return part, {port: port_slope(part, port) for port in vehicle.baseline_damping}

    def _first_sample(self, test: TimeSeries) -> int:
        return round(self.settling * test.sample_rate)


def _samples(test: TimeSeries, samples: slice) -> TimeSeries:
    return TimeSeries(test.time[samples], test.values[:, samples], test.names, test.units)


def port_slope(test: TimeSeries, port: str) -> float:
    """Return the slope of a port's measured force over its measured velocity [N.s/m]."""
    v, force = (_without_mean(test[channel(port, quantity)]) for quantity in ("velocity", "force"))
    return float(v @ force / (v @ v))


def _without_mean(values: Array) -> Array:
    return np.asarray(values - values.mean(axis=-1, keepdims=True))


def _around(vehicle: IdentifiedVehicle, slopes: Mapping[str, float]) -> IdentifiedVehicle:
    """Return the vehicle with linear dampers at its ports; its inputs are the forces beyond them."""
    more = {port: slopes[port] - rate for port, rate in vehicle.baseline_damping.items()}
    model = add_port_damping(vehicle.state_space, more)
    return replace(vehicle, state_space=model, baseline_damping=dict.fromkeys(slopes, 0.0))


_PLACES = tuple(float(k - KNOTS // 2) for k in range(KNOTS))
_NO_SHOCK = Polylinear(curve=StaticCurve.through_knots(_PLACES, (0.0,) * KNOTS, (0.0,) * KNOTS))


# ==== A vehicle judged against a test, and checked for faults ========================================================

#: Rate of the simulation, at least [Hz].
_RATE = 1250.0

#: Law without force: the dampers are part of the model.
_NOTHING = Polylinear(StaticCurve((0.0,) * 15, (0.0,) * 4, (0.0,) * 4, 0.1, 0.01, 1.0, 1.0, 0.0, 0.0))


def with_dampers(vehicle: IdentifiedVehicle, drive: TimeSeries, damping: Mapping[str, float], every: int = 1) -> Array:
    """Return the outputs (p, N / every) of a vehicle with linear dampers, from rest.

    Args:
        vehicle: Continuous vehicle with friction and springs at its ports.
        drive: Inputs of the vehicle without means; `force` of a port acts in addition to its damper.
        damping: Damping of every port [N.s/m].
        every: Interval of the output samples, in samples of the drive.

    Raises:
        StepError: The forces of a step do not converge.
    """
    added = {port: rate - vehicle.baseline_damping.get(port, 0.0) for port, rate in damping.items()}
    model = add_port_damping(vehicle.state_space, added)
    car = replace(vehicle, state_space=model, baseline_damping=dict.fromkeys(damping, 0.0))
    outputs: Array = ManySetups(car, [_NOTHING], drive, every).run([[0] * len(damping)])[0]
    return outputs


def free_running(vehicle: IdentifiedVehicle, record: TimeSeries, ports: Sequence[str]) -> TimeSeries:
    """Return the outputs of a vehicle with the shocks of a test, at the times of the test, from rest.

    The shocks of the test are linear dampers c, its forces over its velocities, in the simulation, and the rest of
    their measured force, F - c v, as an input. Nothing else is fed back from the measurement.

    Args:
        vehicle: Continuous vehicle with friction and springs at its ports.
        record: Evenly sampled test without means.
        ports: Ports of the vehicle.

    Raises:
        StepError: The forces of a step do not converge.
    """
    damping = {port: _slope(record, port) for port in ports}
    finer = max(1, int(np.ceil(_RATE / record.sample_rate - 1e-9)))
    channels = {}
    for name in vehicle.state_space.input_names:
        if name not in record:
            continue
        values = record[name]
        if (port := name.removesuffix("force").rstrip(".")) in damping and quantity(name) == "force":
            values = values - damping[port] * record[channel(port, "velocity")]
        channels[name] = (record.unit(name), _finer(values, finer))
    count = finer * (len(record) - 1) + 1
    time = np.arange(count) / (finer * record.sample_rate)
    outputs = with_dampers(vehicle, TimeSeries.from_channels(time, channels), damping, finer)
    names = {c.name: (c.unit, row) for c, row in zip(vehicle.state_space.outputs, outputs, strict=True)}
    return TimeSeries.from_channels(record.time[: outputs.shape[1]], names)


def _finer(values: Array, finer: int) -> Array:
    """Return values (finer (N - 1) + 1,) at a finer rate, about the straight line through the ends, without aliases."""
    count = values.size
    line = np.linspace(values[0], values[-1], count)
    padded = np.zeros(next_fast_len(count, real=True))
    padded[:count] = values - line
    fine = resample(padded, padded.size * finer)[: finer * (count - 1) + 1]
    return np.asarray(fine + np.linspace(values[0], values[-1], fine.size), dtype=np.float64)


def _slope(record: TimeSeries, port: str) -> float:
    v, force = (record[channel(port, name)] for name in ("velocity", "force"))
    v = v - v.mean()
    return float(np.sum(v * (force - force.mean())) / np.sum(v**2))


# ---- Faults that appear with other shocks only ----------------------------------------------------------------------

#: Duration of the simulation [s].
_SECONDS = 20.0

#: Dampers relative to the baseline that are tried, with the largest RMS of an output relative to that in the first
#: test [1]: this has the baseline dampers, and with 0.4 times the damping a car moves up to about twice as fast.
_LARGEST = {1.0: 1.5, 0.4: 6.0, 2.5: 6.0}


def fault_in_simulation(vehicle: IdentifiedVehicle, tests: Sequence[TimeSeries]) -> str | None:
    """Return why a vehicle cannot be simulated with its port laws and other dampers; None if it can.

    Args:
        vehicle: Continuous vehicle with friction and springs at its ports.
        tests: Records of its tests, the baseline first, which drives it.
    """
    stability = closed_loop_stability(vehicle)
    if not stability.stable:
        return stability.summary()
    samples = round(_SECONDS * tests[0].sample_rate)
    test = tests[0].window(float(tests[0].time[0]), float(tests[0].time[min(samples, len(tests[0]) - 1)]))
    drive, finer = _rig_drive(vehicle, test)
    names = vehicle.state_space.output_names
    measured = np.array([max(float(test[name].std()), 1e-300) for name in names])
    for part, largest in _LARGEST.items():
        dampers = {port: part * rate for port, rate in vehicle.baseline_damping.items()}
        try:
            size = with_dampers(vehicle, drive, dampers, finer).std(axis=1) / measured
        except EightpostError as error:
            return f"its simulation with {part:g} times the baseline damping fails: {error}"
        worst = int(np.argmax(np.where(np.isfinite(size), size, np.inf)))
        if not size[worst] <= largest:
            return (
                f"in its simulation with {part:g} times the baseline damping, the RMS of {names[worst]} is "
                f"{size[worst]:.3g} times that of the baseline test"
            )
    return None


def _rig_drive(vehicle: IdentifiedVehicle, test: TimeSeries) -> tuple[TimeSeries, int]:
    """Return the inputs of the rig without means at a higher rate, and the ratio of the rates."""
    rig = [name for name in vehicle.state_space.input_names if quantity(name) != "force" and name in test]
    finer = max(1, int(np.ceil(_RATE / test.sample_rate - 1e-9)))
    drive = {name: (test.unit(name), _finer(test[name] - test[name].mean(), finer)) for name in rig}
    time = np.arange(finer * (len(test) - 1) + 1) / (finer * test.sample_rate)
    return TimeSeries.from_channels(time, drive), finer
