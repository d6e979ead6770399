"""A study as one HTML page that needs no network, with its figures and tables as files (chapter 7)."""

from cosim.study.report.write import ReportPaths, write_study_report

__all__ = ["ReportPaths", "write_study_report"]
