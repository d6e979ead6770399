"""shock_lpnl2 for PythonFMU: a curve with lag at low force only (Eq 3.25).

The builder copies this file to <model>_<digest>.py next to the package <model>_<digest>_law, which contains the same
law files that the library uses for fits. Absolute names would make two FMUs in one process share code.
"""

from importlib import import_module

ShockSlave = import_module(f"{__name__}_law.shock_slave").ShockSlave
Lpnl2 = import_module(f"{__name__}_law.lpnl2").Lpnl2


class ShockLpnl2(ShockSlave):
    """A curve with lag at low force only (Eq 3.25)."""

    law_class = Lpnl2
    own_parameters = ("time_constant", "lag_full_force", "lag_zero_force")

    def __init__(self, **kwargs):
        super().__init__(f"{__name__}.json", **kwargs)
