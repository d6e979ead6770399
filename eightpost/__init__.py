"""Shock laws, vehicle models, signals and identification: the numerical part of the project, without FMI."""

__version__ = "0.2.0"
