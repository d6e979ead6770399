"""Report of a study (chapter 7): one HTML page that needs no network, figures and tables as files."""

from cosim.study.report.write import ReportPaths, write_study_report

__all__ = ["ReportPaths", "write_study_report"]
