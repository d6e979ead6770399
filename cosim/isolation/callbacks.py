"""Callbacks from the loop to a Python component that can save and restore its state."""

from __future__ import annotations

import ctypes
from contextlib import suppress
from itertools import count
from typing import Any, Protocol

from cosim.component import Component
from cosim.engine import calls
from cosim.functions import OK, Callbacks
from eightpost.errors import EightpostError


class Restorable(Component, Protocol):
    """Component that can return to earlier states."""

    def save(self) -> object:
        """Return the current state.

        Raises:
            StepError: The component cannot save it.
        """

    def restore(self, state: object) -> None:
        """Restore a state that `save` returned; the state remains valid.

        Raises:
            StepError: The state is not one of this run, or cannot be restored.
        """

    def free(self, state: object) -> None:
        """Free a state that is no longer needed."""


class StateCallbacks(Callbacks):
    """Callbacks including those for states: the loop identifies a state by a number, as an FMU's by an address.

    Args:
        component: Component to call; it must have begun before the loop calls.
    """

    def __init__(self, component: Restorable) -> None:
        super().__init__(component)
        self._restorable = component
        self._numbers = count(1)
        self._states: dict[int, object] = {}

    def _functions(self) -> dict[str, Any]:
        return super()._functions() | {
            "save": calls.SAVE(self._guarded(self._save)),
            "restore": calls.RESTORE(self._guarded(self._restore)),
            "free": calls.SAVE(self._free_quietly),
        }

    def _save(self, slot: int) -> None:
        number = ctypes.c_int64.from_address(slot)
        if number.value in self._states:
            self._restorable.free(self._states.pop(number.value))
        number.value = next(self._numbers)
        self._states[number.value] = self._restorable.save()

    def _restore(self, number: int) -> None:
        self._restorable.restore(self._states[number])

    def _free_quietly(self, _instance: Any, slot: int) -> int:
        """Free a state at the end of a run; errors are ignored, because a failure has been reported already."""
        state = self._states.pop(ctypes.c_int64.from_address(slot).value, None)
        if state is not None:
            with suppress(EightpostError):
                self._restorable.free(state)
        return OK
