"""The report of a validation as one self-contained page."""

from eightpost.ident.validation.report.page import write_validation_report

__all__ = ["write_validation_report"]
