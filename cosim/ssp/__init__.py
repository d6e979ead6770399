"""SSP 1.0 packages of any maker as systems: read, flattened, checked (docs/ssp.md)."""

from cosim.ssp.read import SUFFIXES, Given, SspCase, read_ssp

__all__ = ["SUFFIXES", "Given", "SspCase", "read_ssp"]
