"""Reason why a study cannot run as a batch."""

from __future__ import annotations


class NotInBatchError(Exception):
    """Reason, as a clause, why setups run through the FMUs instead of a batch."""


class UnstableCarError(NotInBatchError):
    """The car's motion grows even with the mean damping of its shocks."""
