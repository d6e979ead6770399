"""Benchmarks of accuracy and cost, which print tables."""
