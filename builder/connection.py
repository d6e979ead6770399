"""The two ends of a connection between an output and an input of two components."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Ends:
    """An output and the input that it is connected to.

    Args:
        source: The output, as `component.variable`.
        target: The input, as `component.variable`.
    """

    source: str
    target: str

    @property
    def places(self) -> tuple[tuple[str, str], tuple[str, str]]:
        """Component and variable of the source, then of the target."""
        (from_component, _, output), (to_component, _, into) = self.source.partition("."), self.target.partition(".")
        return (from_component, output), (to_component, into)
