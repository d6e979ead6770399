"""Free-running simulation of a vehicle on rig tests: judged against a test, and checked for faults."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from scipy.fft import next_fast_len
from scipy.signal import resample

from eightpost.array_types import Array
from eightpost.corners import channel
from eightpost.errors import EightpostError
from eightpost.ident.vehicle.experiment import quantity
from eightpost.ident.vehicle.many_setups import with_dampers
from eightpost.ident.vehicle.simulation import series_of
from eightpost.ident.vehicle.stability import closed_loop_stability
from eightpost.signals import TimeSeries
from eightpost.vehicle import IdentifiedVehicle

#: Rate of the simulation, at least [Hz].
_RATE = 1250.0


def free_running(vehicle: IdentifiedVehicle, record: TimeSeries, ports: Sequence[str]) -> TimeSeries:
    """Return the outputs of a vehicle with the shocks of a test, at the times of the test, from rest.

    The shocks of the test are linear dampers c, its forces over its velocities, in the simulation, and the rest of
    their measured force, F - c v, as an input. Nothing else is fed back from the measurement.

    Args:
        vehicle: Continuous vehicle with friction and springs at its ports.
        record: Evenly sampled test.
        ports: Ports of the vehicle.

    Raises:
        StepError: The forces of a step do not converge.
    """
    damping = {port: port_slope(record, port) for port in ports}
    inputs = {name: record[name] for name in vehicle.state_space.input_names if name in record}
    for port, rate in damping.items():
        inputs[channel(port, "force")] = record[channel(port, "force")] - rate * record[channel(port, "velocity")]
    drive, finer = _drive(record, inputs)
    return series_of(vehicle.state_space, record.time, with_dampers(vehicle, drive, damping, finer))


def _drive(record: TimeSeries, inputs: Mapping[str, Array]) -> tuple[TimeSeries, int]:
    """Return inputs (N,) at the times of a record at a higher rate, and the ratio of the rates."""
    finer = max(1, int(np.ceil(_RATE / record.sample_rate - 1e-9)))
    time = np.arange(finer * (len(record) - 1) + 1) / (finer * record.sample_rate)
    fine = {name: (record.unit(name), _finer(values, finer)) for name, values in inputs.items()}
    return TimeSeries.from_channels(time, fine), finer


def _finer(values: Array, finer: int) -> Array:
    """Return values (finer (N - 1) + 1,) at a finer rate, about the straight line through the ends, without aliases."""
    count = values.size
    line = np.linspace(values[0], values[-1], count)
    padded = np.zeros(next_fast_len(count, real=True))
    padded[:count] = values - line
    fine = resample(padded, padded.size * finer)[: finer * (count - 1) + 1]
    return np.asarray(fine + np.linspace(values[0], values[-1], fine.size), dtype=np.float64)


def port_slope(record: TimeSeries, port: str) -> float:
    """Return the slope of a port's measured force over its measured velocity [N.s/m]."""
    v, force = (record[channel(port, name)] - record[channel(port, name)].mean() for name in ("velocity", "force"))
    return float(v @ force / (v @ v))


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
    rig = [name for name in vehicle.state_space.input_names if quantity(name) != "force" and name in test]
    drive, finer = _drive(test, {name: test[name] for name in rig})
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
