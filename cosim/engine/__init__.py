"""The loop over coupling steps: one algorithm on flat arrays, compiled by numba if it is installed, else Python."""
