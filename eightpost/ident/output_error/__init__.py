"""Output-error identification: model, declared parameters and records in; estimate, covariance and gate out."""

from eightpost.ident.output_error.band import Band
from eightpost.ident.output_error.fit import OutputError, OutputErrorFit, Shooting, simulate
from eightpost.ident.output_error.gate import Gate, OutputGate, Tolerance, residual_gate
from eightpost.ident.output_error.model import Model, Record, SteppedModel, derivative_function
from eightpost.ident.output_error.parameters import Parameter, ParameterTable

__all__ = [
    "Band",
    "Gate",
    "Model",
    "OutputError",
    "OutputErrorFit",
    "OutputGate",
    "Parameter",
    "ParameterTable",
    "Record",
    "Shooting",
    "SteppedModel",
    "Tolerance",
    "derivative_function",
    "residual_gate",
    "simulate",
]
