"""The loop over coupling steps: one algorithm on flat arrays, compiled by numba or interpreted, with equal results."""
