"""The grey-box car: physical parameters fitted to the outputs of a free-running simulation."""

from __future__ import annotations

from typing import TYPE_CHECKING

from eightpost.ident.grey_box.recipe import GreyBox

if TYPE_CHECKING:
    from eightpost.ident.vehicle.recipes import VehicleRecipe

METHODS: dict[str, VehicleRecipe] = {"grey box": GreyBox()}
