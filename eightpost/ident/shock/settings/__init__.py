"""Fit of a shock over its adjusters and temperature, and the choice of a setting for a target curve."""
