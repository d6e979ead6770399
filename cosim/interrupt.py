"""Ctrl-C between steps: in the middle of a component's step it would leave the component broken."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager


@contextmanager
def interrupts_deferred(pressed: Callable[[], None]) -> Iterator[None]:
    """Call `pressed` for Ctrl-C instead of raising KeyboardInterrupt. In other threads: nothing."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    previous = signal.signal(signal.SIGINT, lambda _number, _frame: pressed())
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, previous)
