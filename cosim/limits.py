"""What a result should warn about: a shock beyond its fitted velocities, a tire off the ground; at every step."""

from __future__ import annotations

from collections.abc import Mapping

from cosim.system import System


class LimitWatch:
    """Counts the time, after settling, that each shock is beyond its fit and each tire below zero load.

    The names are those of docs/ports.md: `beyond_fit`, and outputs ending in `tire_force`.
    """

    def __init__(self, system: System, settling: float) -> None:
        self._settling = settling
        self._flags = tuple(
            f"{name}.beyond_fit" for name, c in system.components.items() if "beyond_fit" in c.variables
        )
        self._tires = {
            f"{name}.{v.name}": _static_load(system, name, v.name) != 0.0
            for name, component in system.components.items()
            for v in component.variables.values()
            if v.causality == "output" and v.name.endswith("tire_force")
        }
        self._watched_time = 0.0
        self._time = dict.fromkeys((*self._flags, *self._tires), 0.0)

    @property
    def names(self) -> tuple[str, ...]:
        """What it must see after every step."""
        return tuple(self._time)

    def add(self, time: float, step: float, values: Mapping[str, float]) -> None:
        """Look at the values at the end of the step that ends at `time` [s]."""
        if time <= self._settling:
            return
        self._watched_time += step
        for name in self._flags:
            self._time[name] += step * (values[name] > 0.5)
        for name in self._tires:
            self._time[name] += step * (values[name] < 0.0)

    def beyond_fit(self) -> dict[str, float]:
        """Return per shock the share of time that its damper velocity was outside its fitted range."""
        return {name.partition(".")[0]: self._share(name) for name in self._flags}

    def tire_off(self) -> dict[str, float | None]:
        """Return per tire force the share of time below zero load; None where no static load is given."""
        return {name: self._share(name) if known else None for name, known in self._tires.items()}

    def _share(self, name: str) -> float:
        return self._time[name] / self._watched_time if self._watched_time else 0.0


def _static_load(system: System, component: str, output: str) -> float:
    parameter = output.replace("tire_force", "static_tire_force")
    known = system.components[component].variables.get(parameter)
    value = system.parameters.get(component, {}).get(parameter, known.start if known else 0.0)
    return float(value or 0.0)
