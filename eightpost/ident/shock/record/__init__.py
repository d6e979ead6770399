"""Preparation of records for the fit: segment, low-pass, runs, and the effect of a lag on them."""
