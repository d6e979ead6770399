"""shock_polylinear for PythonFMU: a static curve without lag (Eq 3.23).

The builder stages this file as <model>_<digest>.py beside the package <model>_<digest>_law, which holds the law that
the library fits with, to the byte. Absolute names would make two FMUs in one process share code.
"""

from importlib import import_module

ShockSlave = import_module(f"{__name__}_law.shock_slave").ShockSlave
Polylinear = import_module(f"{__name__}_law.polylinear").Polylinear


class ShockPolylinear(ShockSlave):
    """A static curve without lag (Eq 3.23)."""

    law_class = Polylinear
    own_parameters = ()

    def __init__(self, **kwargs):
        super().__init__(f"{__name__}.json", **kwargs)
