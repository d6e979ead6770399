"""Dynamometer report: figures of runs, tables and laws of shocks, grouped into builds, and their page."""
