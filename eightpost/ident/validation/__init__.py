"""Validation of fitted shocks (3.4) and of identified vehicles (6.5) on records that they were not fitted to."""
