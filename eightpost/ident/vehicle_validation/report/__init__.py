"""HTML report of a vehicle's validation."""

from eightpost.ident.vehicle_validation.report.page import write_vehicle_report

__all__ = ["write_vehicle_report"]
