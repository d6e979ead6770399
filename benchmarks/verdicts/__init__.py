"""Benchmark of the verdicts of shock fits."""
