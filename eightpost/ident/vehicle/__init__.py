"""Identification of vehicle models from frequency responses, and simulation with these models."""
