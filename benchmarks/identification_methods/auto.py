"""The choice between common-poles and grey-box by a left-out test."""

from __future__ import annotations

from typing import TYPE_CHECKING

from eightpost.ident.vehicle.recipes.auto import Auto

if TYPE_CHECKING:
    from eightpost.ident.vehicle.recipes import VehicleRecipe

METHODS: dict[str, VehicleRecipe] = {"auto": Auto()}
