"""The loop over coupling steps: one algorithm on flat arrays, compiled by numba where that is there, else Python."""
