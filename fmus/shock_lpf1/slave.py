"""shock_lpf1 for PythonFMU: a curve behind a first-order lag (Eq 3.24).

The builder copies this file to <model>_<digest>.py next to the package <model>_<digest>_law, which contains the same
law files that the library uses for fits. Absolute names would make two FMUs in one process share code.
"""

from importlib import import_module

ShockSlave = import_module(f"{__name__}_law.shock_slave").ShockSlave
Lpf1 = import_module(f"{__name__}_law.lpf1").Lpf1


class ShockLpf1(ShockSlave):
    """A curve behind a first-order lag (Eq 3.24)."""

    law_class = Lpf1
    own_parameters = ("time_constant",)

    def __init__(self, **kwargs):
        super().__init__(f"{__name__}.json", **kwargs)
