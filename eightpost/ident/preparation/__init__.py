"""Preparation of recorded rig tests: checks, synchronisation, removal of means and decimation to a model's rate."""

from eightpost.ident.preparation.channel_faults import (
    Lag,
    advance_channels,
    check_lost_channels,
    drifts,
    drive_lag,
    record_lags,
)
from eightpost.ident.preparation.preparation import Decimation, Preparation, Prepared, prepare, read_preparation

__all__ = [
    "Decimation",
    "Lag",
    "Preparation",
    "Prepared",
    "advance_channels",
    "check_lost_channels",
    "drifts",
    "drive_lag",
    "prepare",
    "read_preparation",
    "record_lags",
]
