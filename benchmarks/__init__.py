"""Accuracy and cost, as tables."""
