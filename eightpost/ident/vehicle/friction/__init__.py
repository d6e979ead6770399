"""Friction at the ports of an identified vehicle."""

from eightpost.ident.vehicle.friction.estimate import FrictionEstimate, FrictionSearch
from eightpost.ident.vehicle.friction.law import direction, with_friction

__all__ = ["FrictionEstimate", "FrictionSearch", "direction", "with_friction"]
