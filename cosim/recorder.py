"""Keeps the recorded variables of a run, at coupling points, in SI."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cosim.conversion import to_si
from cosim.coupling import Coupling
from cosim.scenario import Scenario
from cosim.system import System
from eightpost.errors import InputError, WiringError
from eightpost.signals import TimeSeries


class Recorder:
    """Records what the scenario asks for; without a wish, every real output.

    Raises:
        WiringError: A name is unknown or not a real variable.
        InputError: The record step is not a whole number of coupling steps.
    """

    def __init__(self, system: System, scenario: Scenario, step: float) -> None:
        self._system, self._stop = system, scenario.stop
        self._stride = _stride(scenario, step)
        self.names = tuple(dict.fromkeys(scenario.record)) or _every_output(system)
        self._times: list[float] = []
        self._rows: list[list[float]] = []
        for name in self.names:
            if system.output(name).type != "Real":
                raise WiringError(
                    f"{name} is a {system.output(name).type} and cannot be recorded; record real variables"
                )

    def add(self, index: int, time: float, coupling: Coupling) -> None:
        """Keep the values at a coupling point if it is one to record."""
        if index % self._stride == 0 or time == self._stop:
            values = coupling.read_recorded()
            self._times.append(time)
            self._rows.append([values[name] for name in self.names])

    def series(self) -> TimeSeries:
        """Return what was recorded, in SI."""
        channels = {}
        for index, name in enumerate(self.names):
            conversion, unit = to_si(self._system.output(name))
            column: NDArray[np.float64] = np.array([row[index] for row in self._rows])
            channels[name] = (unit, conversion.factor * column + conversion.offset)
        return TimeSeries.from_channels(np.array(self._times), channels)


def _every_output(system: System) -> tuple[str, ...]:
    return tuple(
        f"{name}.{v.name}"
        for name, component in system.components.items()
        for v in component.variables.values()
        if v.causality == "output" and v.type == "Real"
    )


def _stride(scenario: Scenario, step: float) -> int:
    if not (np.isfinite(step) and 0.0 < step <= scenario.stop):
        raise InputError(f"the coupling step must be positive and at most the run ({scenario.stop} s), not {step!r} s")
    if scenario.record_step is None:
        return 1
    stride = round(scenario.record_step / step)
    if stride < 1 or abs(stride * step - scenario.record_step) > 1e-9 * scenario.record_step:
        raise InputError(
            f"record_step {scenario.record_step} s is not a whole number of coupling steps of {step} s; change one"
        )
    return stride
