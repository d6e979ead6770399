"""States of the law `hysteresis` over whole records: the lagged velocity and the travel of the stop."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from eightpost.array_types import Array
from eightpost.ident.shock.knots import KnotBasis
from eightpost.ident.shock.runs import Runs
from eightpost.ident.shock.simulation import Pieces
from eightpost.shock import Hysteresis, StaticCurve, Valve
from eightpost.shock.compiled import stepped_states
from eightpost.shock.curve import KNOTS

#: Number of time constants.
_TAUS = 3

#: Change of a logarithm for derivatives by differences.
_STEP = 1e-4


@dataclass(frozen=True, eq=False)
class States:
    """States over all N samples of runs, as a function of their parameters."""

    runs: Runs  #: Records.
    basis: KnotBasis  #: Basis of the curve, whose range determines the nodes of ln tau.
    parameters: Array  #: ln tau at the nodes (3,), then ln of yield travel and time constant if there is a stop.
    is_fine: bool = True  #: Whether intervals with a large change of velocity are divided, as in the law.

    @cached_property
    def velocity(self) -> Array:
        """Lagged velocity u (N,) [m/s]."""
        return self._followed[0]

    def columns(self) -> Array:
        """Return the columns (N, K) of f1, and that of the stop if there is one: their weights are forces [N]."""
        found = self.basis.design(self.velocity) / self.basis.speed
        return np.column_stack([found, self._followed[1]]) if self.parameters.size > _TAUS else found

    def derivatives(self, slopes: Array, stop: Array) -> Array:
        """Return the derivatives of the force (N, s) [N] by the parameters.

        Args:
            slopes: Slopes (K,) of f1 times the highest speed of the basis [N].
            stop: Force of the stop at its yield travel (1,) [N]; (0,) without a stop.
        """
        slope = np.interp(self.velocity, self.basis.knots, slopes / self.basis.speed)
        found = []
        for number, step in enumerate(_STEP * np.eye(self.parameters.size)):
            velocity, travel = self._states_of(self.parameters + step)
            found.append(slope * (velocity - self.velocity) if number < _TAUS else stop * (travel - self._followed[1]))
        return np.array(found).T / _STEP

    @cached_property
    def _followed(self) -> tuple[Array, Array]:
        return self._states_of(self.parameters)

    def _states_of(self, parameters: Array) -> tuple[Array, Array]:
        """Return u (N,) [m/s] and the travel of the stop over its yield travel (N,) [1]."""
        stop = np.exp(parameters[_TAUS:]).tolist() or (1.0, 1.0)
        own = (*np.zeros(KNOTS).tolist(), *np.exp(parameters[:_TAUS]).tolist(), 1.0, *stop)
        zero = (0.0,) * KNOTS
        valve = Valve(StaticCurve.through_knots(self.basis.knots, zero, zero).numbers(), 1.0, 1.0)
        pairs = zip(self.runs.prepared, self.runs.parts, strict=True)
        found = [self._run(valve, own, self.runs.velocity[part], p.step) for p, part in pairs]
        velocity, travel = np.concatenate(found).T
        return velocity, travel / stop[0]

    def _run(self, valve: Valve, own: tuple[float, ...], velocity: Array, step: float) -> Array:
        """Return the states (M, 2) over one run."""
        steps = np.full(velocity.size - 1, step)
        if not self.is_fine:
            return stepped_states(Hysteresis, valve, own, velocity, steps)
        pieces = Pieces.of(velocity, steps, 1.0)
        return pieces.at_samples(stepped_states(Hysteresis, valve, own, pieces.velocity, pieces.step))
