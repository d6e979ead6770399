"""The scenario of the matrix, and FMUs stepped directly: one call of the FMU's library for each call that is needed."""

from __future__ import annotations

import ctypes
import math
import tempfile
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Self

import fmpy
import numpy as np
from fmpy.fmi2 import FMU2Model, FMU2Slave
from fmpy.fmi3 import FMU3Model, FMU3Slave
from numpy.typing import NDArray

from eightpost.archive import extract_archive

Array = NDArray[np.float64]

#: Communication step [s]: exact in binary and in nanoseconds, so no tool's clock drifts.
STEP = 1 / 512
#: Step of forward Euler [s].
EULER_STEP = STEP / 16
#: Step of the classical Runge-Kutta method, against which integrators with error control are compared [s].
FINE_STEP = STEP / 8
#: Amplitude of an input by its unit [SI].
AMPLITUDES = {"m/s": 0.5, "m": 0.01, "N": 300.0, "N.m": 200.0}
#: Classical Runge-Kutta method: place of each stage in the step, and weight of its slope.
STAGES = ((0.0, 1.0), (0.5, 2.0), (0.5, 2.0), (1.0, 1.0))


@dataclass(frozen=True)
class Subject:
    """An FMU under test: its file and FMI version; sines at all inputs, zero at the start, in equilibrium there."""

    path: Path
    fmi: int
    #: Number of communication steps: 2 s.
    count: int = 1024

    @cached_property
    def description(self) -> Any:
        """Model description as read by FMPy."""
        return fmpy.read_model_description(str(self.path), validate=False)

    @cached_property
    def inputs(self) -> tuple[str, ...]:
        """Names of the inputs."""
        return tuple(v.name for v in self.description.modelVariables if v.causality == "input")

    @cached_property
    def outputs(self) -> tuple[str, ...]:
        """Names of the outputs."""
        return tuple(v.name for v in self.description.modelVariables if v.causality == "output")

    @cached_property
    def references(self) -> dict[str, int]:
        """Value references by name."""
        return {v.name: v.valueReference for v in self.description.modelVariables}

    @property
    def times(self) -> Array:
        """Communication points [s]."""
        return STEP * np.arange(self.count + 1)

    @cached_property
    def values(self) -> Array:
        """Inputs at the communication points (K+1, inputs)."""
        units = {v.name: v.unit for v in self.description.modelVariables}
        columns = [
            AMPLITUDES[units[name]] * np.sin(2.0 * math.pi * (1.0 + 0.7 * k) * self.times)
            for k, name in enumerate(self.inputs)
        ]
        return np.array(columns).T

    @cached_property
    def signals(self) -> Any:
        """Times and inputs as the structured array that FMPy takes."""
        kinds = [("time", float), *((name, float) for name in self.inputs)]
        return np.array([(t, *row) for t, row in zip(self.times, self.values, strict=True)], dtype=kinds)

    @property
    def held_signals(self) -> Any:
        """Inputs held over each step, as FMPy takes them: two rows at a communication point make an event there."""
        rows = np.repeat(self.signals, 2)[1:]
        for name in self.inputs:
            rows[name] = np.repeat(self.signals[name], 2)[:-1]
        return rows

    def at(self, time: float) -> Array:
        """Return the inputs, linear between the communication points."""
        place = min(int(time / STEP), self.count - 1)
        share = time / STEP - place
        ends: Array = self.values[place : place + 2]
        return (1.0 - share) * ends[0] + share * ends[1]


class Instance:
    """An instance of an FMU, initialized at time 0 with inputs of zero; the same methods for FMI 2.0 and 3.0."""

    def __init__(self, subject: Subject, *, exchange: bool) -> None:
        self.subject = subject
        self._folder = tempfile.TemporaryDirectory()
        extract_archive(subject.path, Path(self._folder.name))
        types = {2: (FMU2Slave, FMU2Model), 3: (FMU3Slave, FMU3Model)}
        description = subject.description
        self.fmu: Any = types[subject.fmi][exchange](
            guid=getattr(description, "instantiationToken", None)
            or description.guid,  # older versions of FMPy have guid only
            unzipDirectory=self._folder.name,
            modelIdentifier=description.coSimulation.modelIdentifier,
            instanceName="direct",
        )
        self._start(exchange=exchange)
        states = description.numberOfContinuousStates or 0
        self._x, self._dx = (ctypes.c_double * states)(), (ctypes.c_double * states)()

    def _start(self, *, exchange: bool) -> None:
        self.fmu.instantiate()
        if self.subject.fmi == 2:
            self.fmu.setupExperiment(startTime=0.0)
        self.fmu.enterInitializationMode()
        self.fmu.exitInitializationMode()
        if exchange:
            (self.fmu.newDiscreteStates if self.subject.fmi == 2 else self.fmu.updateDiscreteStates)()
            self.fmu.enterContinuousTimeMode()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.fmu.terminate()
        self.fmu.freeInstance()
        self._folder.cleanup()

    def set(self, values: Array) -> None:
        """Set the inputs."""
        setter = self.fmu.setReal if self.subject.fmi == 2 else self.fmu.setFloat64
        setter([self.subject.references[name] for name in self.subject.inputs], values.tolist())

    def get(self) -> list[float]:
        """Return the outputs."""
        getter = self.fmu.getReal if self.subject.fmi == 2 else self.fmu.getFloat64
        return list(getter([self.subject.references[name] for name in self.subject.outputs]))

    @property
    def state(self) -> Array:
        """Continuous states."""
        if len(self._x):
            self.fmu.getContinuousStates(self._x, len(self._x))
        return np.array(self._x)

    def slopes(self, time: float, state: Array, inputs: Array) -> Array:
        """Return the derivatives of the states."""
        self.fmu.setTime(time)
        self.set(inputs)
        if not len(self._x):
            return state
        self._x[:] = state.tolist()
        self.fmu.setContinuousStates(self._x, len(self._x))
        derivatives = self.fmu.getDerivatives if self.subject.fmi == 2 else self.fmu.getContinuousStateDerivatives
        derivatives(self._dx, len(self._dx))
        return np.array(self._dx)


def co_simulation(subject: Subject) -> Array:
    """Return the outputs (K+1, outputs) of co-simulation, with the inputs held from the start of each step."""
    with Instance(subject, exchange=False) as one:
        rows = [one.get()]
        for time, held in zip(subject.times[:-1].tolist(), subject.values, strict=False):
            one.set(held)
            one.fmu.doStep(time, STEP)
            rows.append(one.get())
    return np.array(rows)


def euler(subject: Subject) -> Array:
    """Return the outputs (K+1, outputs) of model exchange by forward Euler with linear inputs."""
    return _integrated(subject, EULER_STEP, STAGES[:1])


def exchange(subject: Subject) -> Array:
    """Return the outputs (K+1, outputs) of model exchange by the classical Runge-Kutta method with linear inputs."""
    return _integrated(subject, FINE_STEP, STAGES)


def exchange_held(subject: Subject) -> Array:
    """Return the same with inputs held from each communication point to the next, where outputs see the new inputs."""
    return _integrated(subject, FINE_STEP, STAGES, held=True)


def _integrated(subject: Subject, step: float, stages: tuple[tuple[float, float], ...], *, held: bool = False) -> Array:
    """Integrate model exchange by a method whose stages each use the slope of the one before."""
    total = sum(weight for _, weight in stages)
    with Instance(subject, exchange=True) as one:
        state, rows, each = one.state, [one.get()], round(STEP / step)
        for k in range(subject.count * each):
            slope = mean = np.zeros(state.size)
            for place, weight in stages:
                inputs = subject.values[k // each] if held else subject.at((k + place) * step)
                slope = one.slopes((k + place) * step, state + place * step * slope, inputs)
                mean = mean + weight / total * slope
            state = state + step * mean
            if (k + 1) % each == 0:
                one.slopes((k + 1) * step, state, subject.at((k + 1) * step))
                rows.append(one.get())
    return np.array(rows)


def difference(found: Array, expected: Array) -> float:
    """Return the largest difference relative to the largest change of the same output; 0 means equal bits.

    Raises:
        ValueError: The tool returned another number of rows or columns, or a value that is not finite.
    """
    if found.shape != expected.shape or not np.isfinite(found).all():
        raise ValueError(f"results of shape {found.shape} in place of {expected.shape}, or values that are not finite")
    sizes = np.abs(expected - expected[0]).max(axis=0)
    return float((np.abs(found - expected) / np.where(sizes > 0.0, sizes, 1.0)).max())
