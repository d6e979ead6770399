"""Ctrl-C handling between steps: an interrupt during a component's step would leave the component in a bad state."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager


@contextmanager
def interrupts_deferred(pressed: Callable[[], None]) -> Iterator[None]:
    """Call `pressed` for Ctrl-C instead of raising KeyboardInterrupt. In other threads this does nothing."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    previous = signal.signal(signal.SIGINT, lambda _number, _frame: pressed())
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, previous)
