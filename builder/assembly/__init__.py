"""A vehicle and its shocks as one native FMU, with their coupling solved inside."""

from builder.assembly.assembled_fmu import Assembled, assemble
from builder.assembly.parts import Part, read_parts
from builder.assembly.plan import Assembly

__all__ = ["Assembled", "Assembly", "Part", "assemble", "read_parts"]
