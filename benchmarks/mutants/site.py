"""A place in a source that can be changed."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

#: Function of a source that returns the changed source, or None if the change cannot be made.
Change = Callable[[str], str | None]


class Site(NamedTuple):
    """A place and the changes that can be made there, one at a time."""

    line: int  #: Line number, from 1.
    column: int  #: Column number, from 0.
    changes: tuple[Change, ...]  #: Changes, each of which gives a mutant.
