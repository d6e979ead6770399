"""Friction at the ports of an identified vehicle."""

from eightpost.ident.vehicle.friction.estimate import FrictionEstimate, FrictionSearch
from eightpost.ident.vehicle.friction.law import Friction, direction, with_friction

__all__ = ["Friction", "FrictionEstimate", "FrictionSearch", "direction", "with_friction"]
