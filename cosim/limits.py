"""Limits checked at every step: a shock beyond its fitted velocities, a tire off the ground."""

from __future__ import annotations

from collections.abc import Sequence

from cosim.system import System


class LimitWatch:
    """Signals that are watched at every step after settling, and the share of time beyond their limits.

    The names are those of docs/ports.md: `beyond_fit`, and outputs ending in `tire_force`.
    """

    def __init__(self, system: System) -> None:
        self._flags = tuple(
            f"{name}.{variable}"
            for name, component in system.components.items()
            for variable in component.variables
            if variable.rpartition(".")[2] == "beyond_fit"  # each shock of an assembly has one
        )
        self._tires = {
            f"{name}.{v.name}": _static_load(system, name, v.name) != 0.0
            for name, component in system.components.items()
            for v in component.variables.values()
            if v.causality == "output" and v.name.endswith("tire_force")
        }

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the variables to read after every step."""
        return (*self._flags, *self._tires)

    @property
    def watched(self) -> tuple[tuple[str, bool], ...]:
        """The same names, each with whether it counts above one half (true) or below zero (false)."""
        return (*((name, True) for name in self._flags), *((name, False) for name in self._tires))

    def beyond_fit(self, times: Sequence[float]) -> dict[str, float]:
        """Return the share of time, per shock, in which its damper velocity was outside its fitted range.

        Args:
            times: Time beyond each limit, in the order of `watched`, followed by the total time [s].
        """
        return {
            name.rpartition(".")[0]: _share(time, times[-1]) for name, time in zip(self._flags, times, strict=False)
        }

    def tire_off(self, times: Sequence[float]) -> dict[str, float | None]:
        """Return the share of time below zero load per tire force; None if no static load is given."""
        rows = zip(self._tires.items(), times[len(self._flags) :], strict=False)
        return {name: _share(time, times[-1]) if known else None for (name, known), time in rows}


def _share(time: float, total: float) -> float:
    return time / total if total else 0.0


def _static_load(system: System, component: str, output: str) -> float:
    parameter = output.replace("tire_force", "static_tire_force")
    known = system.components[component].variables.get(parameter)
    value = system.parameters.get(component, {}).get(parameter, known.start if known else 0.0)
    return float(value or 0.0)
