"""A run's guard: FMUs that this project did not build are named if they end the process or change what all share."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext

from cosim.fmu_component import FmuComponent
from cosim.session.setup import Setup
from cosim.surroundings import Surroundings
from cosim.watch import watching

#: After so many steps of the compiled loop it is looked at what an FMU may have changed.
CHUNK = 1000


def guarded(setup: Setup) -> dict[str, FmuComponent]:
    """Return the components of a run that are watched."""
    parts = setup.system.components.items()
    return {name: part for name, part in parts if isinstance(part, FmuComponent) and part.is_guarded}


def watched(setup: Setup) -> AbstractContextManager[None]:
    """Watch a run, where there is what to watch."""
    if not guarded(setup):
        return nullcontext()
    parts = setup.layout.parts
    return watching(parts, [f"{name!r} ({setup.system.components[name].source})" for name in parts])


def undoing(setup: Setup, progress: Callable[[float], None]) -> Callable[[float], None]:
    """Return `progress`, which then also undoes what FMUs have changed while the loop ran, and notes it with them."""
    parts, before = guarded(setup), Surroundings.now()
    if not parts:
        return progress

    def look(share: float) -> None:
        for changed in before.restore():
            for name, part in parts.items():
                others = [f"{other!r}" for other in parts if other != name]
                part.blame(f"{changed} while stepping" + (f", or {' or '.join(others)} did" if others else ""))
        progress(share)

    return look
