"""One minimal model for all paths, with friction at the ports and without."""

from eightpost.ident.vehicle.recipes.common_poles import CommonPoles

METHODS = {
    "common poles, no friction": CommonPoles(friction=None),
    "common poles": CommonPoles(),
}
