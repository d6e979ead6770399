"""Validation of fitted shocks on other records (3.4): random, sine, static and bump tests."""

from eightpost.ident.validation.bump import BumpEvent, BumpValidation, validate_bump
from eightpost.ident.validation.configuration import configuration_of
from eightpost.ident.validation.evaluation import Validation, evaluate
from eightpost.ident.validation.kinds import Kind, Recognition, recognise
from eightpost.ident.validation.notes import notes_on
from eightpost.ident.validation.random import RandomValidation, validate_random
from eightpost.ident.validation.record import Record, record_of
from eightpost.ident.validation.residual import Residual, residual_of
from eightpost.ident.validation.sine import Loop, SineValidation, validate_sine
from eightpost.ident.validation.static import Hold, StaticValidation, validate_static
from eightpost.ident.validation.study import Case, ValidationStudy, validate
from eightpost.ident.validation.verdict import validation_verdict

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
