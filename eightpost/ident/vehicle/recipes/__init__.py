"""Recipes that identify a vehicle from rig tests.

A module of `RECIPES` defines one recipe as `RECIPE`: a frozen dataclass of settings with a method `identify`. It is
imported when its recipe is requested.
"""

from __future__ import annotations

from collections.abc import Sequence
from importlib import import_module
from typing import Protocol

from eightpost.errors import ParameterError
from eightpost.ident.vehicle.experiment import Experiment
from eightpost.ident.vehicle.vehicle_fit import VehicleFit
from eightpost.signals import TimeSeries

#: Modules of the recipes by name; `eightpost identify` repeats the names.
RECIPES = {
    "boggs": "eightpost.ident.vehicle.recipes.boggs",
    "common-poles": "eightpost.ident.vehicle.recipes.common_poles",
    "grey-box": "eightpost.ident.grey_box.recipe",
}


class VehicleRecipe(Protocol):
    """Method of identifying a vehicle from rig tests."""

    def identify(self, tests: Sequence[TimeSeries], experiment: Experiment) -> VehicleFit:
        """Identify a vehicle.

        Args:
            tests: Records of rig tests with the channels of the experiment, all at one sample rate, the baseline test
                first. Each test may have any shocks.
            experiment: Inputs, shock forces and outputs of the tests.

        Raises:
            InputError: Tests and experiment do not match, or the effects of the inputs cannot be separated.
        """
        ...


def recipe(name: str) -> VehicleRecipe:
    """Return the recipe with the given name and its default settings.

    Raises:
        ParameterError: There is no recipe with this name.
    """
    if name not in RECIPES:
        raise ParameterError(f"there is no recipe {name!r}; use one of {', '.join(RECIPES)}")
    chosen: VehicleRecipe = import_module(RECIPES[name]).RECIPE
    return chosen
