"""Signals: time series, drive files, filters, checks for faults, and file formats."""

from eightpost.signals.csv_file import write_csv
from eightpost.signals.drivefile import Drivefile
from eightpost.signals.filters import derivative, lowpass, velocity_from_displacement
from eightpost.signals.formats import read_record, read_records, read_series, write_series
from eightpost.signals.mat_file import write_mat
from eightpost.signals.parquet_file import parquet_header, write_parquet
from eightpost.signals.raw_record import ChannelMap, MappedChannel
from eightpost.signals.timeseries import Recording, TimeSeries

__all__ = [
    "ChannelMap",
    "Drivefile",
    "MappedChannel",
    "Recording",
    "TimeSeries",
    "derivative",
    "lowpass",
    "parquet_header",
    "read_record",
    "read_records",
    "read_series",
    "velocity_from_displacement",
    "write_csv",
    "write_mat",
    "write_parquet",
    "write_series",
]
