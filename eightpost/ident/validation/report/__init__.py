"""A validation as one page that loads nothing."""

from eightpost.ident.validation.report.page import write_validation_report

__all__ = ["write_validation_report"]
