"""Validation of fitted shocks on other records (3.4): random, sine, static and bump tests."""

from eightpost.ident.validation.bump import BumpEvent, BumpValidation, validate_bump
from eightpost.ident.validation.evaluation import (
    RandomValidation,
    Residual,
    Validation,
    evaluate,
    residual_of,
    validate_random,
)
from eightpost.ident.validation.record import Kind, Recognition, Record, configuration_of, recognise, record_of
from eightpost.ident.validation.sine import Loop, SineValidation, validate_sine
from eightpost.ident.validation.static import Hold, StaticValidation, validate_static
from eightpost.ident.validation.study import Case, ValidationStudy, validate
from eightpost.ident.validation.verdict import notes_on, validation_verdict

__all__ = [
    "BumpEvent",
    "BumpValidation",
    "Case",
    "Hold",
    "Kind",
    "Loop",
    "RandomValidation",
    "Recognition",
    "Record",
    "Residual",
    "SineValidation",
    "StaticValidation",
    "Validation",
    "ValidationStudy",
    "configuration_of",
    "evaluate",
    "notes_on",
    "recognise",
    "record_of",
    "residual_of",
    "validate",
    "validate_bump",
    "validate_random",
    "validate_sine",
    "validate_static",
    "validation_verdict",
]
