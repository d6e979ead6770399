"""Preparation: from rig tests as recorded to records at a model's rate, checked, in step, without means."""

from eightpost.ident.preparation.decimation import Decimation
from eightpost.ident.preparation.lags import Lag, drifts, drive_lag, record_lags, shifted, time_lag
from eightpost.ident.preparation.lost_channels import check_lives
from eightpost.ident.preparation.preparation import Preparation, prepare
from eightpost.ident.preparation.preparation_file import read_preparation
from eightpost.ident.preparation.prepared import Prepared

__all__ = [
    "Decimation",
    "Lag",
    "Preparation",
    "Prepared",
    "check_lives",
    "drifts",
    "drive_lag",
    "prepare",
    "read_preparation",
    "record_lags",
    "shifted",
    "time_lag",
]
