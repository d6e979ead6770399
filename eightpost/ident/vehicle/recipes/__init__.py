"""Recipes that identify a vehicle from rig tests.

Each file of this folder defines one recipe as `RECIPE`: a frozen dataclass of settings with a method `identify`. The
name of the recipe is that of the file with hyphens: `common_poles.py` defines "common-poles".
"""

from __future__ import annotations

import pkgutil
from collections.abc import Sequence
from importlib import import_module
from pathlib import Path
from typing import Protocol

from eightpost.errors import ParameterError
from eightpost.ident.vehicle.experiment import Experiment
from eightpost.ident.vehicle.vehicle_fit import VehicleFit
from eightpost.signals import TimeSeries


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


def recipe_names() -> tuple[str, ...]:
    """Return the names of all recipes."""
    modules = pkgutil.iter_modules([str(Path(__file__).parent)])
    return tuple(sorted(module.name.replace("_", "-") for module in modules))


def recipe(name: str) -> VehicleRecipe:
    """Return the recipe with the given name and its default settings.

    Raises:
        ParameterError: There is no recipe with this name.
    """
    if name not in recipe_names():
        raise ParameterError(f"there is no recipe {name!r}; use one of {', '.join(recipe_names())}")
    found: VehicleRecipe = import_module(f"{__name__}.{name.replace('-', '_')}").RECIPE
    return found
