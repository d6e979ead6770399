"""shock_maxwell for PythonFMU: a curve and a stiffness in series.

The builder copies this file to <model>_<digest>.py next to the package <model>_<digest>_law, which contains the same
law files that the library uses for fits. Absolute names would make two FMUs in one process share code.
"""

from importlib import import_module

ShockSlave = import_module(f"{__name__}_law.shock_slave").ShockSlave
Maxwell = import_module(f"{__name__}_law.maxwell").Maxwell


class ShockMaxwell(ShockSlave):
    """A curve and a stiffness in series."""

    law_class = Maxwell
    own_parameters = ("series_stiffness",)

    def __init__(self, **kwargs):
        super().__init__(f"{__name__}.json", **kwargs)
