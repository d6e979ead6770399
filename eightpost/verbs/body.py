"""The body of a verb. It is imported when the verb is called, because its libraries take seconds to load."""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from importlib import import_module
from typing import Any


def body(verb: Callable[[], None]) -> Callable[..., Any]:
    """Decorate a verb so that it calls the function of the same name in `eightpost.commands` with its options."""

    @wraps(verb)
    def call(**options: Any) -> Any:
        return getattr(import_module(f"eightpost.commands.{verb.__name__}"), verb.__name__)(**options)

    return call
