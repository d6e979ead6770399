"""Notes for the reader of a result, in sentences."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from cosim.algorithm import Algorithm
from cosim.coupling import Coupling
from cosim.equilibrium import Equilibrium
from cosim.system import System


def notes_of(
    system: System,
    coupling: Coupling,
    algorithm: Algorithm,
    equilibrium: Equilibrium,
    troubles: Iterable[str],
) -> tuple[str, ...]:
    """Return all notes of a run, the most important first."""
    return (
        *troubles,
        *_equilibrium_notes(equilibrium),
        *_order_notes(coupling, algorithm),
        *_held_notes(system, algorithm),
        *_unit_notes(system),
        *_gas_notes(system),
        *(f"{name}: {message}" for name, c in system.components.items() for message in c.messages),
    )


def _equilibrium_notes(equilibrium: Equilibrium) -> Iterator[str]:
    if not equilibrium.converged:
        yield (
            f"the start is not an equilibrium: a connection still changes by {equilibrium.residual:.1e} of its size; "
            "the beginning of the result contains a transient"
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
        yield f"no unit stated, values used without conversion: {', '.join(unstated)}"


def _gas_notes(system: System) -> Iterator[str]:
    """Note that a gas force may be counted twice: in the static loads of the car and in a shock's own preload."""
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
            f"the car has static tire forces, and {', '.join(shocks)} have a gas preload of their own: if the static "
            "state includes the gas force, it counts twice (fit with --gas included, or set gas_preload = 0)"
        )


def _held_notes(system: System, algorithm: Algorithm) -> Iterator[str]:
    """Note the components that hold their inputs although the algorithm ramps coupling values."""
    held = sorted(name for name, c in system.components.items() if not c.capabilities.interpolates_inputs)
    if held and getattr(algorithm, "values", "") != "held":
        yield f"{', '.join(held)} cannot interpolate inputs (canInterpolateInputs): they are held over each step"
