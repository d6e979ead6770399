"""The master: start, step, record, end. Readable first; it is the reference for every faster loop."""

from __future__ import annotations

import time as clock
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from cosim.algorithm import Algorithm, GaussSeidel
from cosim.conversion import to_si
from cosim.coupling import Coupling
from cosim.energy import EnergyMeter
from cosim.equilibrium import Equilibrium, solve_equilibrium
from cosim.result import Result, held_direct_outputs
from cosim.scenario import Scenario
from cosim.system import System
from eightpost.errors import InputError, StepError
from eightpost.signals import TimeSeries

#: A coupling step that suits race cars and their shocks (docs/coupling.md).
DEFAULT_STEP = 1e-3


def run(
    system: System,
    scenario: Scenario,
    *,
    algorithm: Algorithm | None = None,
    step: float = DEFAULT_STEP,
    progress: Callable[[float], None] | None = None,
) -> Result:
    """Run a system once; its components are used up by it.

    Args:
        system: Components and connections.
        scenario: Drive, duration, what to record.
        algorithm: A strategy object; GaussSeidel() by default.
        step: Coupling step [s]; the last one is shortened to land on the stop time.
        progress: Called now and then with the share done, 0 to 1.

    Returns:
        Recorded series in SI, status and statistics. A start that did not converge is in its status.

    Raises:
        WiringError: System and scenario do not fit together.
        InputError: The coupling step does not fit.
        StepError: A component failed; the message names it, the time and what it said.
    """
    algorithm = algorithm or GaussSeidel()
    try:
        recorder = _Recorder(system, scenario, _record_stride(scenario, step))
        meters = {bond.name: EnergyMeter(bond, system) for bond in system.bonds}
        coupling = Coupling(system, scenario, frozenset(recorder.names))
        order = algorithm.order(coupling)
        times = coupling_times(scenario.stop, step)
        coupling.prepare(times)
        began = clock.perf_counter()
        equilibrium = _start(system, coupling, order, scenario)
        _loop(coupling, algorithm, order, times, recorder, meters, progress)
    finally:
        for component in system.components.values():
            component.finish()
    notes = _notes(coupling, equilibrium, algorithm)
    return Result(
        series=recorder.series(),
        converged=equilibrium.converged,
        notes=notes,
        algorithm=algorithm.name,
        order=order,
        step=step,
        steps=times.size - 1,
        seconds=clock.perf_counter() - began,
        equilibrium_sweeps=equilibrium.sweeps,
        energy={name: meter.total for name, meter in meters.items()},
        held_direct=held_direct_outputs(system, coupling.held_inputs(), recorder.names),
        identities={name: component.identity for name, component in system.components.items()},
        settling=scenario.settling,
        share_beyond_fit=recorder.shares_beyond_fit(),
        share_tire_off=recorder.shares_tire_off(system),
    )


def _start(system: System, coupling: Coupling, order: tuple[str, ...], scenario: Scenario) -> Equilibrium:
    for name, component in system.components.items():
        component.begin(0.0, scenario.stop, system.parameters.get(name, {}))
    equilibrium = solve_equilibrium(coupling, order)
    for name in order:
        system.components[name].end_initialization()
        coupling.now.update(coupling.read(name))
    return equilibrium


def coupling_times(stop: float, step: float) -> NDArray[np.float64]:
    """Return the coupling points (K+1,) [s]: whole multiples of the step, so that they do not drift, and the stop."""
    count = max(1, int(np.ceil(stop / step * (1.0 - 1e-12))))
    times: NDArray[np.float64] = np.arange(count + 1, dtype=np.float64) * step
    times[-1] = stop
    return times


def _loop(
    coupling: Coupling,
    algorithm: Algorithm,
    order: tuple[str, ...],
    times: NDArray[np.float64],
    recorder: _Recorder,
    meters: Mapping[str, EnergyMeter],
    progress: Callable[[float], None] | None,
) -> None:
    points = times.tolist()
    recorder.add(0, points[0], coupling)
    for k, (start, end) in enumerate(pairwise(points)):
        before = dict(coupling.now)
        algorithm.step(coupling, order, start, end - start)
        _check_finite(coupling, end)
        for meter in meters.values():
            meter.add(coupling, before, end - start)
        recorder.add(k + 1, end, coupling)
        if progress and k % 200 == 0:
            progress((k + 1) / (len(points) - 1))
    if progress:
        progress(1.0)


def _check_finite(coupling: Coupling, time: float) -> None:
    for name, value in coupling.now.items():
        if not -1e15 < value < 1e15:
            raise StepError(
                f"the coupling diverged: {name} is {value:g} at {time:g} s; take a smaller coupling step, or "
                "gauss-seidel instead of jacobi (docs/coupling.md)"
            )


def _record_stride(scenario: Scenario, step: float) -> int:
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


def _notes(coupling: Coupling, equilibrium: Equilibrium, algorithm: Algorithm) -> tuple[str, ...]:
    notes = []
    if not equilibrium.converged:
        notes.append(
            f"the start is not an equilibrium: a connection still changes by {equilibrium.residual:.1e} of its size; "
            "the beginning of the result rings"
        )
    if not coupling.order()[1]:
        notes.append(
            "the declared direct terms form a loop between components: "
            f"{algorithm.name} steps through it with a lag of one step"
        )
    unstated = sorted(
        f"{name}.{v.name}"
        for name, component in coupling.components.items()
        for v in component.variables.values()
        if v.unit is None and v.type == "Real" and v.causality in ("input", "output")
    )
    if unstated:
        notes.append(f"no unit stated, values taken as they are: {', '.join(unstated)}")
    return tuple(notes)


@dataclass
class _Recorder:
    """Keeps the recorded variables in SI, and watches what results should warn about."""

    system: System
    scenario: Scenario
    stride: int
    names: tuple[str, ...] = ()
    times: list[float] = field(default_factory=list)
    rows: list[list[float]] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.kept = self.scenario.record or tuple(
            f"{name}.{v.name}"
            for name, component in self.system.components.items()
            for v in component.variables.values()
            if v.causality == "output" and v.type == "Real"
        )
        self.flags = tuple(
            f"{name}.beyond_fit" for name, c in self.system.components.items() if "beyond_fit" in c.variables
        )
        for name in self.kept:
            self.system.output(name)
        self.names = tuple(dict.fromkeys((*self.kept, *self.flags)))

    def add(self, index: int, time: float, coupling: Coupling) -> None:
        """Keep the values at a coupling point if it is one to record."""
        if index % self.stride == 0 or time == self.scenario.stop:
            values = coupling.read_watched()
            self.times.append(time)
            self.rows.append([values[name] for name in self.names])

    def series(self) -> TimeSeries:
        """Return what was asked for, in SI."""
        conversions = [to_si(self.system.output(name)) for name in self.kept]
        values = [c.factor * self._column(n) + c.offset for n, (c, _) in zip(self.kept, conversions, strict=True)]
        channels = {n: (unit, v) for n, (_, unit), v in zip(self.kept, conversions, values, strict=True)}
        return TimeSeries.from_channels(np.array(self.times), channels)

    def shares_beyond_fit(self) -> dict[str, float]:
        """Return per shock the share of time that its damper velocity was outside its fitted range."""
        return {name.partition(".")[0]: float(np.mean(self._column(name) > 0.5)) for name in self.flags}

    def shares_tire_off(self, system: System) -> dict[str, float | None]:
        """Return per recorded tire force the share of time below zero load; None where no static load is given."""
        return {
            name: float(np.mean(self._column(name) < 0.0)) if _static_load(system, name) else None
            for name in self.kept
            if name.endswith("tire_force")
        }

    def _column(self, name: str) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
        index = self.names.index(name)
        return np.array([row[index] for row in self.rows])


def _static_load(system: System, name: str) -> float:
    component, _, variable = name.partition(".")
    parameter = variable.replace("tire_force", "static_tire_force")
    known = system.components[component].variables.get(parameter)
    value = system.parameters.get(component, {}).get(parameter, known.start if known else 0.0)
    return float(value or 0.0)
