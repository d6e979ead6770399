"""Reading of SSP packages from any tool: parsed, flattened and checked (docs/how_to/ssp.md)."""

from cosim.ssp.read import SUFFIXES, Given, read_ssp

__all__ = ["SUFFIXES", "Given", "read_ssp"]
