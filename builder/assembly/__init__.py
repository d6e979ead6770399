"""A vehicle and its shocks as one native FMU, with their coupling solved inside."""

from builder.assembly.assembled_fmu import Assembled, assemble
from builder.assembly.plan import Assembly, Part, read_parts

__all__ = ["Assembled", "Assembly", "Part", "assemble", "read_parts"]
