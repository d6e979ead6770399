"""Physical damper model, the true system of the virtual dynamometer; no fitted law contains it."""

from eightpost.rig.damper.builds import BUILDS, CONFIGURATIONS, SHIMS_OF_BUILD, configuration, shim_build
from eightpost.rig.damper.physical import PhysicalDamper
from eightpost.rig.damper.valves import cavitation

__all__ = [
    "BUILDS",
    "CONFIGURATIONS",
    "SHIMS_OF_BUILD",
    "PhysicalDamper",
    "cavitation",
    "configuration",
    "shim_build",
]
