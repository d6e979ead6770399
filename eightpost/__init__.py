"""Shock laws, vehicle models, signals and their identification: the numerics, without FMI."""

__version__ = "0.1.0"
