"""The master: start, step, record, end. Readable first; it is the reference for every faster loop."""

from __future__ import annotations

import time as clock
from collections.abc import Callable, Iterator, Mapping
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from cosim.algorithm import Algorithm, GaussSeidel
from cosim.coupling import Coupling
from cosim.energy import DOUBTFUL, BondEnergy, EnergyMeter
from cosim.equilibrium import Equilibrium, solve_equilibrium
from cosim.interrupt import interrupts_deferred
from cosim.limits import LimitWatch
from cosim.recorder import Recorder
from cosim.result import Result, held_direct_outputs
from cosim.scenario import Scenario
from cosim.system import System
from eightpost.errors import StepError, WiringError

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
    """Run a system once. Ctrl-C ends it between two steps.

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
    session = _Session(system, scenario, algorithm or GaussSeidel(), step)
    try:
        with interrupts_deferred() as raise_if_interrupted:
            return session.run(raise_if_interrupted, progress)
    finally:
        for component in system.components.values():
            component.finish()


class _Session:
    """One run: everything resolved and checked before the first component begins."""

    def __init__(self, system: System, scenario: Scenario, algorithm: Algorithm, step: float) -> None:
        self._system, self._scenario, self._algorithm, self._step = system, scenario, algorithm, step
        self._recorder = Recorder(system, scenario, step)
        self._limits = LimitWatch(system, scenario.settling)
        self._coupling = Coupling(system, scenario, every_step=self._limits.names, recorded=self._recorder.names)
        self._meters = {bond.name: EnergyMeter(bond, system, self._coupling) for bond in system.bonds}
        self._order = algorithm.order(self._coupling)
        self._times = coupling_times(scenario.stop, step)
        _check_variable_step(system, self._times, step)
        self._coupling.prepare(self._times)

    def run(self, raise_if_interrupted: Callable[[], None], progress: Callable[[float], None] | None) -> Result:
        began = clock.perf_counter()
        equilibrium = self._start()
        self._loop(raise_if_interrupted, progress or (lambda _: None))
        energy = {name: meter.total for name, meter in self._meters.items()}
        return Result(
            series=self._recorder.series(),
            converged=equilibrium.converged,
            notes=self._notes(equilibrium, energy),
            algorithm=self._algorithm.name,
            order=self._order,
            step=self._step,
            steps=self._times.size - 1,
            seconds=clock.perf_counter() - began,
            equilibrium_sweeps=equilibrium.sweeps,
            energy=energy,
            held_direct=held_direct_outputs(self._system, self._coupling.held_inputs(), self._recorder.names),
            identities={name: component.identity for name, component in self._system.components.items()},
            sources={name: component.source for name, component in self._system.components.items()},
            parameters={name: dict(values) for name, values in self._system.parameters.items() if values},
            settling=self._scenario.settling,
            share_beyond_fit=self._limits.beyond_fit(),
            share_tire_off=self._limits.tire_off(),
        )

    def _start(self) -> Equilibrium:
        coupling = self._coupling
        for name, component in self._system.components.items():
            component.begin(0.0, self._scenario.stop, self._system.parameters.get(name, {}))
        equilibrium = solve_equilibrium(coupling, self._order)
        for name in self._order:
            self._system.components[name].end_initialization()
            coupling.now.update(coupling.read(name))
        return equilibrium

    def _loop(self, raise_if_interrupted: Callable[[], None], progress: Callable[[float], None]) -> None:
        coupling, points = self._coupling, self._times.tolist()
        self._recorder.add(0, points[0], coupling)
        for k, (start, end) in enumerate(pairwise(points)):
            before = dict(coupling.now)
            self._algorithm.step(coupling, self._order, start, end - start)
            raise_if_interrupted()
            _check_finite(coupling, end)
            for meter in self._meters.values():
                meter.add(coupling, before, end - start)
            self._limits.add(end, end - start, coupling.now)
            self._recorder.add(k + 1, end, coupling)
            if k % 200 == 0:
                progress((k + 1) / (len(points) - 1))
        progress(1.0)

    def _notes(self, equilibrium: Equilibrium, energy: Mapping[str, BondEnergy]) -> tuple[str, ...]:
        return (
            *_equilibrium_notes(equilibrium),
            *_energy_notes(energy),
            *_order_notes(self._coupling, self._algorithm),
            *_unit_notes(self._system),
            *_gas_notes(self._system),
            *(f"{name} said: {said}" for name, c in self._system.components.items() for said in c.messages),
        )


def coupling_times(stop: float, step: float) -> NDArray[np.float64]:
    """Return the coupling points (K+1,) [s]: whole multiples of the step, so that they do not drift, and the stop."""
    count = max(1, int(np.ceil(stop / step * (1.0 - 1e-12))))
    times: NDArray[np.float64] = np.arange(count + 1, dtype=np.float64) * step
    times[-1] = stop
    return times


def _check_variable_step(system: System, times: NDArray[np.float64], step: float) -> None:
    """Refuse a shortened last step for a component that takes none."""
    if abs(times[-1] - times[-2] - step) <= 1e-9 * step:
        return
    for name, component in system.components.items():
        if not component.capabilities.variable_step:
            raise WiringError(
                f"{name} takes steps of one size only, and the stop time is not a whole number of coupling steps of "
                f"{step} s; change one of them"
            )


def _check_finite(coupling: Coupling, time: float) -> None:
    for name, value in coupling.now.items():
        if not -1e15 < value < 1e15:
            raise StepError(
                f"the coupling diverged: {name} is {value:g} at {time:g} s; take a smaller coupling step, or "
                "gauss-seidel instead of jacobi (docs/coupling.md)"
            )


def _equilibrium_notes(equilibrium: Equilibrium) -> Iterator[str]:
    if not equilibrium.converged:
        yield (
            f"the start is not an equilibrium: a connection still changes by {equilibrium.residual:.1e} of its size; "
            "the beginning of the result rings"
        )


def _energy_notes(energy: Mapping[str, BondEnergy]) -> Iterator[str]:
    for name, bond in energy.items():
        if not bond.acceptable:
            yield (
                f"bond {name}: {abs(bond.relative):.0%} of the energy through it is lost or made by the coupling: take "
                "a smaller coupling step, and do not use this result"
            )
        elif abs(bond.relative) > DOUBTFUL:
            yield (
                f"bond {name}: {abs(bond.relative):.2%} of the energy through it is lost or made by the coupling; "
                "sound runs stay under 1 %: halve the coupling step and compare"
            )


def _order_notes(coupling: Coupling, algorithm: Algorithm) -> Iterator[str]:
    if not coupling.order()[1]:
        yield (
            "the declared direct terms form a loop between components: "
            f"{algorithm.name} steps through it with a lag of one step"
        )


def _unit_notes(system: System) -> Iterator[str]:
    unstated = sorted(
        f"{name}.{v.name}"
        for name, component in system.components.items()
        for v in component.variables.values()
        if v.unit is None and v.type == "Real" and v.causality in ("input", "output")
    )
    if unstated:
        yield f"no unit stated, values taken as they are: {', '.join(unstated)}"


def _gas_notes(system: System) -> Iterator[str]:
    """Static loads hold the car up with the gas force in them; a shock's own preload then counts it again."""
    values = {
        f"{name}.{v.name}": system.parameters.get(name, {}).get(v.name, v.start)
        for name, component in system.components.items()
        for v in component.variables.values()
        if v.name == "gas_preload" or v.name.endswith("static_tire_force")
    }
    given = [name for name, value in values.items() if float(value or 0.0) != 0.0]
    shocks = [name.partition(".")[0] for name in given if name.endswith("gas_preload")]
    if shocks and len(shocks) < len(given):
        yield (
            f"the car has static tire forces and {', '.join(shocks)} a gas preload of their own: if the static state "
            "was taken with the gas in the shocks, it counts twice (fit with --gas included, or set gas_preload = 0)"
        )
