"""The common-pole recipe, with and without friction at the ports."""

from eightpost.ident.vehicle.recipes.common_poles import CommonPoles

METHODS = {
    "common poles, no friction": CommonPoles(friction=None),
    "common poles": CommonPoles(),
}
