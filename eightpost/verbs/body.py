"""A verb's body, which is imported when the verb is called: its libraries take seconds to load."""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from importlib import import_module
from typing import Any


def body(verb: Callable[[], None]) -> Callable[..., Any]:
    """Make a verb call the function of its name in `eightpost.commands` with its options."""

    @wraps(verb)
    def call(**options: Any) -> Any:
        return getattr(import_module(f"eightpost.commands.{verb.__name__}"), verb.__name__)(**options)

    return call
