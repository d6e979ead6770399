"""Callbacks from the loop to a Python component that can save and restore its state, too."""

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
    """A component that goes back to earlier states."""

    def save(self) -> object:
        """Return its state now.

        Raises:
            StepError: It fails to.
        """

    def restore(self, state: object) -> None:
        """Go back to a state that `save` returned; it stays good for more.

        Raises:
            StepError: The state is not one of this run, or it fails to.
        """

    def free(self, state: object) -> None:
        """Give back a state that is needed no more."""


class StateCallbacks(Callbacks):
    """Callbacks, and those for states: the loop knows a state by a number, as it knows an FMU's by an address.

    Args:
        component: What is called; it must have begun before the loop calls.
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
        """Free at the end of a run: what failed has been told, and with a component that ended its states did."""
        state = self._states.pop(ctypes.c_int64.from_address(slot).value, None)
        if state is not None:
            with suppress(EightpostError):
                self._restorable.free(state)
        return OK
