"""Simulation of many setups of an identified vehicle on one drive."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numba
import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from eightpost.array_types import Array, Complex
from eightpost.errors import InputError, ParameterError, StepError
from eightpost.ident.vehicle.experiment import channel
from eightpost.shock import Lpf1, Lpnl2, Polylinear
from eightpost.vehicle import Friction as VehicleFriction

if TYPE_CHECKING:
    from eightpost.signals import TimeSeries as SignalsTimeSeries
    from eightpost.vehicle import IdentifiedVehicle, StateSpace

    Whole = NDArray[np.intp]


# ---- Compiled loop of `many_setups`, which simulates one setup over all samples of a drive --------------------------

#: Highest port velocity of the force tables [m/s], and their spacing [m/s].
FASTEST, SPACING = 6.0, 2.5e-4
_MIDDLE = round(FASTEST / SPACING)
_MANY_SETUPS_LOOP_MAX_ITERATIONS = 60
#: Change of the forces [N] at which the iteration has converged.
_MANY_SETUPS_LOOP_CLOSE = 1e-3


def _compiled(function: Callable[..., Any]) -> Callable[..., Any]:
    found: Callable[..., Any] = numba.njit(nogil=True, error_model="numpy")(function)
    return found


@_compiled
def _static(table: Any, v: float) -> Any:
    """Return a static force [N] by linear interpolation in its table."""
    at = min(max(v / SPACING, -float(_MIDDLE)), _MIDDLE - 1.0)
    left = math.floor(at)
    place = int(left) + _MIDDLE
    return (1.0 - (at - left)) * table[place] + (at - left) * table[place + 1]


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
def _lag(laws: Any, i: int, lagged: Any, old: Any, static: float) -> Any:
    """Return the lagged force [N] of a port after a step with a linear static force."""
    late = laws[2][i] * (static - old[i])
    return static - late + (lagged[i] - old[i] + late) * laws[1][i]


@_compiled
def _force(laws: Any, friction: Any, i: int, motion: Any, lag: float, static: float) -> Any:
    """Return the whole force [N] of a port; `motion` is its velocity and displacement."""
    low, high, gas = laws[3][i], laws[4][i], laws[5][i]
    weight = min(max((high - abs(static)) / (high - low), 0.0), 1.0)
    rub = friction[i, 0] * math.tanh(motion[0] / friction[i, 1]) if friction[i, 0] else 0.0
    return weight * lag + (1.0 - weight) * static + rub + gas * motion[1]


@_compiled
def _solve_forces(model: Any, laws: Any, friction: Any, ports: Any, moves: bool) -> bool:
    """Find the force differences at the end of a step by iteration; return whether they converged.

    `ports` has the velocities without the forces of the step, the displacements, the force differences (on entry: the
    initial guess), and the lagged and static forces before the step (on return: after it).
    """
    gain, damping = model
    free, place, change, lagged, old = ports
    count = free.size
    v, force, static, lag = np.empty(count), np.empty(count), np.empty(count), np.empty(count)
    for iteration in range(_MANY_SETUPS_LOOP_MAX_ITERATIONS):
        error = 0.0
        for i in range(count):
            v[i] = free[i]
            if moves:
                for j in range(count):
                    v[i] += gain[i, j] * change[j]
            static[i] = _static(laws[0][i], v[i])
            lag[i] = _lag(laws, i, lagged, old, static[i]) if moves else lagged[i]
            force[i] = _force(laws, friction, i, (v[i], place[i]), lag[i], static[i]) - damping[i] * v[i]
        for i in range(count):
            error = max(error, abs(force[i] - change[i]))
            change[i] = force[i] if iteration < _MANY_SETUPS_LOOP_MAX_ITERATIONS // 2 else 0.5 * (force[i] + change[i])
        if error <= _MANY_SETUPS_LOOP_CLOSE:
            lagged[:], old[:] = lag, static
            return True
    return False


@_compiled
def compiled_march(modes: Any, rows: Any, driven: Any, laws: Any, friction: Any, every: int, out: Any) -> Any:
    """Simulate one setup.

    Args:
        modes: Decay (n,), weights of the force at the start and the end of a step (n, P), C (p, n), D (p, P), baseline
            damping (P,).
        rows: Indices of the velocities (P,) and displacements (P or 0,) among the outputs.
        driven: Outputs due to the drive alone (p, N).
        laws: Parameters by port: force table, exp(-h / tau), tau / h, static forces at which the lag starts to fade and
            has faded, gas stiffness.
        friction: Friction force F_c and velocity v_f of each port (P, 2).
        every: Interval of the output samples, in samples of the drive.
        out: Array for the outputs (p, kept).

    Returns:
        -1, or the index of the sample at which the forces did not converge.
    """
    decay, held, ramp, C, D, damping = modes
    velocities, displacements = rows
    count, everything = damping.size, np.arange(C.shape[0])
    x, gain = np.zeros(decay.size, dtype=np.complex128), np.zeros((count, count))
    free, place = np.zeros(count), np.zeros(count)
    change, before, lagged, old = np.zeros(count), np.zeros(count), np.zeros(count), np.zeros(count)
    for j in range(count):
        _add_outputs(C, velocities, ramp[:, j].copy(), gain[:, j])
    for k in range(driven.shape[1]):
        if k:
            x *= decay
            _add_inputs(x, held, change)
        for i in range(count):
            free[i] = driven[velocities[i], k]
            place[i] = driven[displacements[i], k] if displacements.size else 0.0
            before[i], change[i] = change[i], 2.0 * change[i] - before[i]
        _add_outputs(C, velocities, x, free)
        _add_outputs(C, displacements, x, place)
        if not _solve_forces((gain, damping), laws, friction, (free, place, change, lagged, old), k > 0):
            return k
        if k:
            _add_inputs(x, ramp, change)
        if k % every == 0:
            y = driven[:, k] + D @ change
            _add_outputs(C, everything, x, y)
            out[:, k // every] = y
    return -1


# ---- Simulation of many setups of an identified vehicle on one drive ------------------------------------------------

Law = Polylinear | Lpf1 | Lpnl2


@dataclass(frozen=True, slots=True, eq=False)
class ManySetups:
    """Simulation of the setups of a vehicle with shocks from a bank, on one drive.

    Attributes:
        vehicle: Identified continuous vehicle with the friction of its ports.
        bank: Shock laws that setups choose from.
        drive: Evenly sampled inputs of the rig by name; missing ones are zero. Its sample rate is that of the
            simulation.
        every: Interval of the output samples, in samples of the drive.
    """

    vehicle: IdentifiedVehicle
    bank: Sequence[Law]
    drive: SignalsTimeSeries
    every: int = 1

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
        friction = [self.vehicle.friction.get(port, VehicleFriction(0.0, 1.0)) for port in plant.ports]
        return plant.march(_ManySetupsShocks(self.bank, friction, plant.step), chosen, self.every)


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
    def of(cls, vehicle: IdentifiedVehicle, drive: SignalsTimeSeries) -> _Plant:
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

    def march(self, shocks: _ManySetupsShocks, chosen: Whole, every: int) -> Array:
        """Return the outputs (S, p, kept) of S setups; `chosen` (S, P) has the bank index of each port's shock."""
        kept = len(range(0, self.driven.shape[1], every))
        found = np.empty((len(chosen), len(self.C), kept))
        for one, places in zip(found, chosen, strict=True):
            laws = tuple(np.ascontiguousarray(row[places]) for row in shocks.laws)
            failed = compiled_march(self.modes, self.rows, self.driven, laws, shocks.friction, every, one)
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


class _ManySetupsShocks:
    """Bank in the form that the loop uses: fine tables of the static forces, and the other parameters of the laws."""

    def __init__(self, bank: Sequence[Law], friction: Sequence[VehicleFriction], step: float) -> None:
        """Compute the tables and parameters."""
        count = round(FASTEST / SPACING)
        velocities = (SPACING * np.arange(-count, count + 1)).tolist()
        tables = np.array([[law.static_force(v) for v in velocities] for law in bank])
        tau, low, high = np.array([_lag_of(law) for law in bank]).T
        gas = np.array([law.port.motion_ratio**2 * law.port.gas_stiffness for law in bank])
        self.laws = (tables, np.exp(-step / tau), tau / step, low, high, gas)
        self.friction = np.array([[rub.force, rub.velocity] for rub in friction])


def _lag_of(law: Law) -> tuple[float, float, float]:
    """Return tau and the static forces at which the lag starts to fade and has faded; Polylinear has almost no lag."""
    if isinstance(law, Lpnl2):
        return law.time_constant, law.lag_full_force, law.lag_zero_force
    if isinstance(law, Lpf1):
        return law.time_constant, 1e11, 1e12
    if isinstance(law, Polylinear):
        return 1e-9, 1e11, 1e12
    raise InputError(
        f"setups are simulated with polylinear, lpf1 and lpnl2; simulate {type(law).__name__} with simulate_with_shocks"
    )


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
    drive: SignalsTimeSeries,
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
