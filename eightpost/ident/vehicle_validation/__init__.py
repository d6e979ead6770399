"""Validation of identified vehicles on rig records that they were not fitted to (6.5)."""

from eightpost.ident.vehicle_validation.comparison import Comparison, Judging
from eightpost.ident.vehicle_validation.findings import Limits, validation_verdict
from eightpost.ident.vehicle_validation.prediction import closed_at_ports, open_at_ports
from eightpost.ident.vehicle_validation.record import Kind, Recognition, RigRecord, recognise, record_of
from eightpost.ident.vehicle_validation.responses import Path, VehicleMode, main_paths, modes_of
from eightpost.ident.vehicle_validation.study import Case, VehicleValidation, validate_vehicle
from eightpost.ident.vehicle_validation.trends import Trend

__all__ = [
    "Case",
    "Comparison",
    "Judging",
    "Kind",
    "Limits",
    "Path",
    "Recognition",
    "RigRecord",
    "Trend",
    "VehicleMode",
    "VehicleValidation",
    "closed_at_ports",
    "main_paths",
    "modes_of",
    "open_at_ports",
    "recognise",
    "record_of",
    "validate_vehicle",
    "validation_verdict",
]
