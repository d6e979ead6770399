"""The common-pole recipe: friction that sticks, creeps or is absent; the band from the record, or up to 16 Hz."""

from eightpost.ident.vehicle.port_search import FrictionSearch
from eightpost.ident.vehicle.recipes.common_poles import CommonPoles

_CREEPS = FrictionSearch(reaches=())

METHODS = {
    "common poles, no friction": CommonPoles(friction=None),
    "common poles, friction creeps, 16 Hz": CommonPoles(band=None, springs=None, friction=_CREEPS),
    "common poles, friction creeps": CommonPoles(friction=_CREEPS),
    "common poles, 16 Hz": CommonPoles(band=None),
    "common poles": CommonPoles(),
}
