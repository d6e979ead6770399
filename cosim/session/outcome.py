"""What a run leaves as its result: series, status and statistics from the loop's arrays."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from cosim.conversion import to_si
from cosim.energy import BondEnergy
from cosim.engine.plan import ITERATIONS, LOOSE, REJECTED, STEPS, STOPPED, STUCK, Memory
from cosim.equilibrium import Equilibrium
from cosim.notes import notes_of
from cosim.recorder import recorded_series
from cosim.result import Coupled, Result, held_direct_outputs
from cosim.session.running import Ending, Running
from cosim.session.setup import Setup


@dataclass(frozen=True)
class Outcome:
    """A run that ended.

    Args:
        setup: What was run.
        running: As the loop left it.
        equilibrium: How it started.
        ending: How it ended.
        seconds: Wall time before the steps and of the steps [s].
    """

    setup: Setup
    running: Running
    equilibrium: Equilibrium
    ending: Ending
    seconds: tuple[float, float]

    def result(self) -> Result:
        """Return its result.

        Raises:
            StepError: What was recorded is not a number.
        """
        setup, counts, watched = self.setup, self.running.memory.counts, self.running.memory.watched.tolist()
        components, energy, coupled = setup.system.components, self._energy(), self._coupled()
        return Result(
            series=recorded_series(setup.system, setup.names, self.running.tape),
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
        )

    def _energy(self) -> dict[str, BondEnergy]:
        m = self.running.memory
        return {
            bond.name: BondEnergy(float(m.residual[k]), float(m.transferred[k]))
            for k, bond in enumerate(self.setup.system.bonds)
        }

    def _coupled(self) -> dict[str, Coupled]:
        """What the ends of each bond assumed of each other, over the whole run, in SI."""
        system, m, share = self.setup.system, self.running.memory, self.setup.accuracy.share
        numbers = self.running.plan.bonds
        found = {}
        for k, bond in enumerate(system.bonds):
            to_velocity, to_force = (to_si(system.output(end.target))[0].factor for end in (bond.velocity, bond.force))
            found[bond.name] = Coupled(
                *_way(m, int(numbers.velocity[k]), to_velocity, share),
                *_way(m, int(numbers.force[k]), to_force, share),
            )
        return found

    def _troubles(self) -> Iterator[str]:
        counts, ending = self.running.memory.counts, self.ending
        if counts[LOOSE]:
            yield (
                f"{counts[LOOSE]} of {counts[STEPS]} steps did not converge: take a smaller coupling step, and do "
                "not use this result"
            )
        if ending.why == STUCK:
            yield (
                f"the coupling step went down to its least at {ending.time:g} s without meeting the "
                "tolerance: the run ends there; allow a smaller step or a larger tolerance"
            )
        if name := ending.ended_by:
            source, stop = self.setup.system.components[name].source, self.setup.scenario.stop
            yield (
                f"component {name!r} ({source}) ended the simulation at {ending.time:g} s of {stop:g} s "
                "(fmi2Terminated): the result ends there"
            )
        if ending.why == STOPPED:
            yield "the run was interrupted: this is what was computed until then"


def _way(m: Memory, term: int, factor: float, share: float) -> tuple[float, float]:
    """Local error and spread of what a term gives, root mean squares."""
    time = float(m.duration[0]) or 1.0
    spread = m.squares[term] / time - (m.total[term] / time) ** 2
    return share * float(np.sqrt(m.defect[term] / time)) * factor, float(np.sqrt(max(spread, 0.0))) * factor
