"""A place of a source where something can be changed."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

#: Takes a source, returns it with the change; None where the change cannot be made.
Change = Callable[[str], str | None]


class Site(NamedTuple):
    """A place and the changes that can be made there, one at a time.

    Args:
        line: Line number, from 1.
        column: Column number, from 0.
        changes: Changes, each of which makes a mutant.
    """

    line: int
    column: int
    changes: tuple[Change, ...]
