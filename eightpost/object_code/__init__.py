"""Functions as object files: compiled by numba once per machine, for its processor, and loaded without numba."""
