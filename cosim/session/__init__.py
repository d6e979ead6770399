"""One run of a system with one algorithm, from its setup to its result."""

from cosim.session.session import RunInterrupted, Session

__all__ = ["RunInterrupted", "Session"]
