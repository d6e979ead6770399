"""Physical damper model, the true system of the virtual dynamometer; no fitted law contains it."""

from eightpost.rig.damper.body import Cylinder, Fluid, GasChamber, Seals
from eightpost.rig.damper.builds import (
    BUILDS,
    CONFIGURATIONS,
    SHIMS_OF_BUILD,
    Setting,
    Shims,
    configuration,
    digressive,
    linear,
    shim_build,
)
from eightpost.rig.damper.physical import PhysicalDamper
from eightpost.rig.damper.valves import (
    SHIM_SETS,
    Bleed,
    Cavitation,
    HeadValve,
    MainPiston,
    Orifices,
    ShimStack,
    ShimValve,
    cavitation,
)

__all__ = [
    "BUILDS",
    "CONFIGURATIONS",
    "SHIMS_OF_BUILD",
    "SHIM_SETS",
    "Bleed",
    "Cavitation",
    "Cylinder",
    "Fluid",
    "GasChamber",
    "HeadValve",
    "MainPiston",
    "Orifices",
    "PhysicalDamper",
    "Seals",
    "Setting",
    "ShimStack",
    "ShimValve",
    "Shims",
    "cavitation",
    "configuration",
    "digressive",
    "linear",
    "shim_build",
]
