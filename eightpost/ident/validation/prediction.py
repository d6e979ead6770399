"""Prediction of a rig record by an identified vehicle that is driven by the record's roads and loads."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from scipy.sparse import csr_array

from eightpost.array_types import Array
from eightpost.corners import channel
from eightpost.errors import StepError
from eightpost.ident.vehicle import simulate_with_shocks
from eightpost.ident.vehicle.friction import with_friction
from eightpost.ident.vehicle.many_setups import ManySetups
from eightpost.ident.vehicle.stability import discretise_by_parts
from eightpost.shock import ShockLaw
from eightpost.signals import TimeSeries
from eightpost.vehicle import IdentifiedVehicle, StateSpace

#: Subdivisions of the step that are tried if a steep law prevents the solution of a step.
_FINER = (1, 2, 4, 8)


def ports_of(model: StateSpace) -> tuple[str, ...]:
    """Return the ports of a vehicle, in the order of its inputs."""
    names = (name.removesuffix("force").rstrip(".") for name in model.input_names if name.endswith("force"))
    return tuple(port for port in names if channel(port, "force") in model.input_names
                 and channel(port, "velocity") in model.output_names)  # fmt: skip


def open_at_ports(vehicle: IdentifiedVehicle, record: TimeSeries) -> TimeSeries:
    """Return the vehicle's outputs under a record's roads, loads and shock forces, from rest.

        dF = F + F_f tanh(v / v_f) - c v

    with the measured force F and the measured velocity v.

    Args:
        vehicle: Identified vehicle.
        record: Record without means; inputs of the vehicle that are not in it are zero.
    """
    model = vehicle.state_space
    whole = with_friction(record, vehicle.friction)
    u = np.zeros((len(record), len(model.inputs)))
    for j, name in enumerate(model.input_names):
        if name in whole:
            u[:, j] = whole[name]
    for port in ports_of(model):
        rate = vehicle.baseline_damping.get(port, 0.0)
        u[:, model.input_names.index(channel(port, "force"))] -= rate * record[channel(port, "velocity")]
    return _named(model, record.time, _respond(model, u, 1.0 / record.sample_rate))


def closed_at_ports(vehicle: IdentifiedVehicle, record: TimeSeries, laws: Mapping[str, ShockLaw]) -> TimeSeries:
    """Return the vehicle's outputs with shock laws at its ports, under a record's roads and loads, from rest.

    Args:
        vehicle: Identified vehicle, with the friction at its ports.
        record: Record without means.
        laws: Shock law of every port.
    """
    model, ports = vehicle.state_space, ports_of(vehicle.state_space)
    drive = record.select(n for n in model.input_names if n in record and n not in {channel(p, "force") for p in ports})
    quick = [law for law in laws.values() if _is_plain(law)]
    can = model.dt is None and len(quick) == len(laws)
    if can and set(vehicle.baseline_damping) == set(laws):
        bank = list({id(law): law for law in quick}.values())
        places = [next(k for k, law in enumerate(bank) if law is laws[port]) for port in vehicle.baseline_damping]
        return _named(model, record.time, ManySetups(vehicle, bank, drive).run([places])[0])
    return port_by_port(vehicle, drive, laws)


def port_by_port(vehicle: IdentifiedVehicle, drive: TimeSeries, laws: Mapping[str, ShockLaw]) -> TimeSeries:
    """Return the vehicle's outputs with arbitrary shock laws, at the drive's samples.

    Args:
        vehicle: Identified vehicle, with the friction at its ports.
        drive: Roads and loads without means.
        laws: Shock law of every port.

    Raises:
        StepError: The laws are too stiff even for an eighth of the drive's step.
    """
    for finer in _FINER:
        fine = drive if finer == 1 else drive.resample(finer * drive.sample_rate)
        try:
            outputs = simulate_with_shocks(vehicle, laws, fine).select(vehicle.state_space.output_names)
        except StepError:
            if finer == _FINER[-1]:
                raise
            continue
        channels = {n: (u, np.interp(drive.time, fine.time, row))
                    for n, u, row in zip(outputs.names, outputs.units, outputs.values, strict=True)}  # fmt: skip
        return TimeSeries.from_channels(drive.time, channels)
    raise AssertionError("one of the steps was the last")


def _is_plain(law: ShockLaw) -> bool:
    """Return whether the compiled loop supports the law's port."""
    return law.port.motion_ratio == 1.0 and law.port.seal_friction == 0.0


def _respond(model: StateSpace, u: Array, step: float) -> Array:
    """Return the outputs (p, N) for inputs (N, m), interpolated linearly, or held if the model is discrete."""
    if model.dt is None:
        found = discretise_by_parts(model.A, model.B, step)
        A, pushed = csr_array(found.Ad), u[:-1] @ found.B0.T + u[1:] @ found.B1.T
    else:
        A, pushed = csr_array(model.A), u[:-1] @ model.B.T
    C, x, y = csr_array(model.C), np.zeros(len(model.A)), u @ model.D.T
    for k, push in enumerate(pushed, start=1):
        x = A @ x + push
        y[k] += C @ x
    return np.asarray(y.T)


def _named(model: StateSpace, time: Array, outputs: Array) -> TimeSeries:
    channels = {c.name: (c.unit, row) for c, row in zip(model.outputs, outputs, strict=True)}
    return TimeSeries.from_channels(time, channels)
