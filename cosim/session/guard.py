"""Guard of a run: names FMUs that this project did not build if they end the process or change shared state."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext

from cosim.fmu_component import FmuComponent
from cosim.session.setup import Setup
from cosim.surroundings import Surroundings
from cosim.watch import watching

#: Number of steps of the compiled loop between checks of shared state.
CHUNK = 1000


def guarded(setup: Setup) -> dict[str, FmuComponent]:
    """Return the components of a run that are checked."""
    parts = setup.system.components.items()
    return {name: part for name, part in parts if isinstance(part, FmuComponent) and part.is_guarded}


def watched(setup: Setup) -> AbstractContextManager[None]:
    """Return a context that watches the run if it has components to check."""
    if not guarded(setup):
        return nullcontext()
    parts = setup.layout.parts
    return watching(parts, [f"{name!r} ({setup.system.components[name].source})" for name in parts])


def undoing(setup: Setup, progress: Callable[[float], None]) -> Callable[[float], None]:
    """Return `progress`, extended to undo changes that FMUs made while the loop ran, and to record them as notes."""
    parts, before = guarded(setup), Surroundings.now()
    if not parts:
        return progress

    def check(share: float) -> None:
        for changed in before.restore():
            for name, part in parts.items():
                others = [f"{other!r}" for other in parts if other != name]
                part.blame(f"{changed} while stepping" + (f", or {' or '.join(others)} did" if others else ""))
        progress(share)

    return check
