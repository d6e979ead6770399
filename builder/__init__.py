"""Models and parameters into FMUs, and the checks that an FMU must pass."""
