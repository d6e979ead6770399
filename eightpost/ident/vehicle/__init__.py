"""Identification of vehicle models from frequency responses, and simulation with these models."""

from eightpost.ident.vehicle.experiment import Experiment, experiment_of
from eightpost.ident.vehicle.rational_fit import (
    AEROLOADERS,
    QUARTER_CAR,
    SEVEN_DOF,
    WHEELLOADERS,
    BandWeights,
    RationalFit,
    TransferFunction,
)
from eightpost.ident.vehicle.simulation import simulate_with_shocks
from eightpost.ident.vehicle.siso_models import PathFit, SisoFits, SisoModels, has_direct_term, parallel_model
from eightpost.ident.vehicle.vehicle_fit import VehicleFit, read_fit, write_fit

__all__ = [
    "AEROLOADERS",
    "QUARTER_CAR",
    "SEVEN_DOF",
    "WHEELLOADERS",
    "BandWeights",
    "Experiment",
    "PathFit",
    "RationalFit",
    "SisoFits",
    "SisoModels",
    "TransferFunction",
    "VehicleFit",
    "experiment_of",
    "has_direct_term",
    "parallel_model",
    "read_fit",
    "simulate_with_shocks",
    "write_fit",
]
