"""Construction of FMUs from models and parameters, and the checks that an FMU must pass."""
