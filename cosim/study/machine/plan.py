"""A run of all setups of a study on one drive, on the machine."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cosim.session.setup import Setup, joined
from cosim.study.machine.car import FmuVehicle
from cosim.study.machine.wiring import WiredCar
from eightpost.array_types import Array
from eightpost.machine import SIGNALS, Drive, Limit, LinearCar, NotInBatchError, Quantity, Run


class Plan:
    """A run of all setups on one drive at one step.

    Args:
        setup: Run of one of the setups; its step divides the interval between records.
        name: Name of the vehicle's component.
        vehicle: Vehicle.
        damping: Linear damping at each shock's port, around which the ports are solved (C,) [N.s/m].
        quantities: Quantities whose statistics are needed.
        series: Names of the channels whose series are needed.
        width: Instruction set; None: the widest of this processor.

    Attributes:
        run: Run of the machine.
        rows: Times of the recorded rows (R,) [s].

    Raises:
        NotInBatchError: The run is not one of a vehicle with shocks at its ports.
        FmuError: There is no compiler, or it fails.
    """

    def __init__(
        self,
        setup: Setup,
        name: str,
        vehicle: FmuVehicle,
        damping: Array,
        quantities: Sequence[Quantity],
        series: Sequence[str],
        *,
        width: str | None = None,
    ) -> None:
        if setup.discrete.is_needed:
            raise NotInBatchError("components have connections besides their bonds")
        self._wired = WiredCar(setup.system, setup.coupling.feeds, name, vehicle)
        self.corners = self._wired.shocks
        car = LinearCar.of(vehicle, self._wired.ports, damping)
        drive = _drive(setup, self._wired)
        self.limits = tuple(limit for limit in setup.limits.watched if limit.signal.startswith(f"{name}."))
        names = {*series, *(channel for q in quantities for channel in q.channels)}
        self.run = Run(
            car,
            drive,
            {channel: self._channel(channel) for channel in names},
            quantities=quantities,
            limits=[Limit(limit.sign, limit.limit, self._wired.output(limit.signal)) for limit in self.limits],
            series=series,
            settling=int(np.searchsorted(drive.times[:: drive.every], setup.scenario.settling + 1e-9)),
            width=width,
        )
        self.rows, self.series = self.run.rows, self.run.series

    def _channel(self, name: str) -> tuple[int, int]:
        component, _, variable = name.partition(".")
        if component == self._wired.name:
            return -1, self._wired.output(name)
        if component not in self.corners or variable not in SIGNALS:
            raise NotInBatchError(f"{name} is not recorded in a batch")
        self._wired.check_si(name)
        return self.corners.index(component), SIGNALS.index(variable)


def _drive(setup: Setup, car: WiredCar) -> Drive:
    scenario, (times, every) = setup.scenario, _regular(setup)
    points = times
    if scenario.drive is not None:
        own = scenario.drive.series.time - scenario.drive_start
        points = joined(times, own[(own > 0.0) & (own < times[-1])])
    return Drive(times, every, points, car.inputs(scenario, points))


def _regular(setup: Setup) -> tuple[Array, int]:
    """Return equal steps (K + 1,) [s] up to the last record, and their number between records."""
    record = setup.scenario.record_step or setup.step
    every = max(1, round(record / setup.step))
    records = int(setup.times[-1] / record + 1e-9)
    if records < 1:
        raise NotInBatchError("the drive is shorter than the interval between records")
    return np.linspace(0.0, records * record, records * every + 1), every
