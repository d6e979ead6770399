"""One run as one HTML page that needs no network."""

from cosim.report.page import write_report

__all__ = ["write_report"]
