"""Result of a run: series, status and statistics from the loop's arrays."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from cosim.conversion import to_si
from cosim.difference import judged_by
from cosim.energy import BondEnergy
from cosim.engine.plan import ITERATIONS, LOOSE, REJECTED, STEPS, STOPPED, STUCK
from cosim.equilibrium import Equilibrium
from cosim.notes import notes_of
from cosim.recorder import recorded_series
from cosim.result import Coupled, Result, held_direct_outputs
from cosim.session.running import Ending, Running
from cosim.session.setup import Setup
from cosim.system import Connection
from cosim.validity import models_of

#: Directions of a bond.
_WAYS = ("velocity", "force")


class _End(NamedTuple):
    """Values for one direction of a bond: root mean square of its local error, standard deviation, SI unit of both."""

    error: float
    spread: float
    unit: str


@dataclass(frozen=True)
class Outcome:
    """A run that has ended.

    Args:
        setup: Setup of the run.
        running: State in which the loop left the run.
        equilibrium: Status of the equilibrium start.
        ending: Ending of the loop.
        seconds: Wall time before the steps and of the steps [s].
    """

    setup: Setup
    running: Running
    equilibrium: Equilibrium
    ending: Ending
    seconds: tuple[float, float]

    def result(self) -> Result:
        """Return the result.

        Raises:
            StepError: A recorded value is not a number.
        """
        setup, counts, watched = self.setup, self.running.memory.counts, self.running.memory.watched.tolist()
        components, energy, coupled = setup.system.components, self._energy(), self._coupled()
        return Result(
            series=recorded_series(setup.system, setup.names, self.running.tape, setup.discrete.rows),
            converged=bool(self.equilibrium.converged and self.ending.why != STUCK and counts[LOOSE] == 0),
            notes=notes_of(setup.system, setup.coupling, setup.algorithm, self.equilibrium, self._troubles()),
            algorithm=setup.algorithm.name,
            order=setup.layout.parts,
            step=self.ending.least,
            steps=int(counts[STEPS]),
            seconds=sum(self.seconds),
            stepping_seconds=self.seconds[1],
            equilibrium_sweeps=self.equilibrium.sweeps,
            energy=energy,
            coupled=coupled,
            iterations=int(counts[ITERATIONS]),
            rejected_steps=int(counts[REJECTED]),
            unsettled_steps=int(counts[LOOSE]),
            steps_of_all_runs=int(counts[STEPS]),
            largest_step=self.ending.largest,
            partial=self.ending.why in (STOPPED, STUCK),
            ended_by=self.ending.ended_by,
            ended_at=self.ending.time if self.ending.ended_by else None,
            held_direct=held_direct_outputs(setup.system, setup.coupling.held_inputs(), setup.names),
            identities={name: component.identity for name, component in components.items()},
            sources={name: component.source for name, component in components.items()},
            parameters={name: dict(values) for name, values in setup.system.parameters.items() if values},
            settling=setup.scenario.settling,
            share_beyond_fit=setup.limits.beyond_fit(watched),
            share_tire_off=setup.limits.tire_off(watched),
            decisive=setup.system.decisive,
            models=models_of(setup.system, setup.names),
        )

    def _energy(self) -> dict[str, BondEnergy]:
        m = self.running.memory
        return {
            bond.name: BondEnergy(float(m.residual[k]), float(m.transferred[k]))
            for k, bond in enumerate(self.setup.system.bonds)
        }

    def _coupled(self) -> dict[str, Coupled]:
        """Return the local errors of each bond over the whole run, in SI."""
        ends = {(bond.name, way): self._end(k, way) for k, bond in enumerate(self.setup.system.bonds) for way in _WAYS}
        scale = judged_by({key: end.spread for key, end in ends.items()}, {key: end.unit for key, end in ends.items()})
        return {
            bond.name: Coupled(
                *(x for way in _WAYS for x in ends[bond.name, way][:2]), *(scale[bond.name, way] for way in _WAYS)
            )
            for bond in self.setup.system.bonds
        }

    def _end(self, number: int, way: str) -> _End:
        """Return the local error and the spread of one direction of a bond."""
        connection: Connection = getattr(self.setup.system.bonds[number], way)
        m, term = self.running.memory, int(getattr(self.running.plan.bonds, way)[number])
        conversion, unit = to_si(self.setup.system.output(connection.target))
        time = float(m.duration[0]) or 1.0
        variance = m.squares[term] / time - (m.total[term] / time) ** 2
        share = self.setup.accuracy_of(connection.target).share
        return _End(
            share * float(np.sqrt(m.defect[term] / time)) * conversion.factor,
            float(np.sqrt(max(variance, 0.0))) * conversion.factor,
            unit,
        )

    def _troubles(self) -> Iterator[str]:
        counts, ending = self.running.memory.counts, self.ending
        if counts[LOOSE]:
            yield (
                f"{counts[LOOSE]} of {counts[STEPS]} steps did not converge: use a smaller coupling step, and do "
                "not use this result"
            )
        if ending.why == STUCK:
            yield (
                f"the coupling step reached its minimum at {ending.time:g} s without meeting the "
                "tolerance: the run ends there; allow a smaller step or a larger tolerance"
            )
        if name := ending.ended_by:
            source, stop = self.setup.system.components[name].source, self.setup.scenario.stop
            yield (
                f"component {name!r} ({source}) ended the simulation at {ending.time:g} s of {stop:g} s "
                "(fmi2Terminated): the result ends there"
            )
        if ending.why == STOPPED:
            yield "the run was interrupted: the result contains what was computed until then"
