"""Simulation of many setups of an identified vehicle on one drive.

The response to the drive alone is computed once. Per setup only the shock-force differences and their effect are
simulated, in modal coordinates, which takes a few operations per mode and step. `simulate_with_shocks` simulates one
setup with any law.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.signal import lfilter

from eightpost.errors import InputError, ParameterError, StepError
from eightpost.ident.vehicle.experiment import channel
from eightpost.ident.vehicle.many_setups_loop import FASTEST, SPACING, compiled_march
from eightpost.shock import Lpf1, Lpnl2, Polylinear
from eightpost.vehicle import Friction

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from eightpost.signals import TimeSeries
    from eightpost.vehicle import IdentifiedVehicle, StateSpace

    Array = NDArray[np.float64]
    Complex = NDArray[np.complex128]
    Whole = NDArray[np.intp]

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
    drive: TimeSeries
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
        friction = [self.vehicle.friction.get(port, Friction(0.0, 1.0)) for port in plant.ports]
        return plant.march(_Shocks(self.bank, friction, plant.step), chosen, self.every)


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

    def march(self, shocks: _Shocks, chosen: Whole, every: int) -> Array:
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


class _Shocks:
    """Bank in the form that the loop uses: fine tables of the static forces, and the other parameters of the laws."""

    def __init__(self, bank: Sequence[Law], friction: Sequence[Friction], step: float) -> None:
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
    model: StateSpace, drive: TimeSeries, stepping: tuple[Complex, Complex, Complex], modal: tuple[Complex, Complex]
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
