"""Reason why a study cannot run as a batch."""

from __future__ import annotations


class NotInBatchError(Exception):
    """Reason, as a clause, why setups run through the FMUs instead of a batch."""
