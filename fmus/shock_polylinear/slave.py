"""shock_polylinear for PythonFMU: a static curve without lag (Eq 3.23).

The builder copies this file to <model>_<digest>.py next to the package <model>_<digest>_law, which contains the same
law files that the library uses for fits. Absolute names would make two FMUs in one process share code.
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
