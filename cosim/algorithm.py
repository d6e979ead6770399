"""Coupling algorithms: frozen strategies; changing the method never changes the call."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from cosim.coupling import Coupling
from eightpost.errors import WiringError


class Algorithm(Protocol):
    """How the components are stepped from one coupling point to the next."""

    @property
    def name(self) -> str:
        """As the command line writes it."""

    def order(self, coupling: Coupling) -> tuple[str, ...]:
        """Return the order in which it steps the components."""

    def step(self, coupling: Coupling, order: tuple[str, ...], time: float, step: float) -> None:
        """Step every component from `time` by `step` [s]."""


@dataclass(frozen=True, slots=True)
class Jacobi:
    """Every component steps with the others' outputs from the start of the step.

    The exchange that most tools do. At full damping in the shocks it needs small steps (docs/coupling.md).
    """

    name: str = "jacobi"

    def order(self, coupling: Coupling) -> tuple[str, ...]:
        """Any order gives the same."""
        return tuple(coupling.components)

    def step(self, coupling: Coupling, order: tuple[str, ...], time: float, step: float) -> None:
        """Step every component with what was at the start."""
        for name in order:
            coupling.step(name, time, step, newest=False)
        coupling.end_step()


@dataclass(frozen=True, slots=True)
class GaussSeidel:
    """Each component steps with the newest outputs of those before it.

    Args:
        sequence: The components in order; empty: from the declared dependencies, a component whose outputs follow
            an input without delay after the one that feeds it (the vehicle first, then its shocks).
    """

    sequence: tuple[str, ...] = ()
    name: str = "gauss-seidel"

    def order(self, coupling: Coupling) -> tuple[str, ...]:
        """Return the given sequence, or the one that the dependencies ask for."""
        if not self.sequence:
            return coupling.order()[0]
        if sorted(self.sequence) != sorted(coupling.components):
            raise WiringError(
                f"the sequence {', '.join(self.sequence)} must name every component once: "
                f"{', '.join(coupling.components)}"
            )
        return self.sequence

    def step(self, coupling: Coupling, order: tuple[str, ...], time: float, step: float) -> None:
        """Step the components in order with what is newest."""
        for name in order:
            coupling.step(name, time, step, newest=True)
        coupling.end_step()


ALGORITHMS: dict[str, Algorithm] = {"jacobi": Jacobi(), "gauss-seidel": GaussSeidel()}
