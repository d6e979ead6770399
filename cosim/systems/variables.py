"""Variables of a system's components by name, and the values that they take."""

from __future__ import annotations

from collections.abc import Mapping
from math import isfinite
from numbers import Real

import numpy as np

from cosim.components.component import DISCRETE, Component, Variable
from cosim.components.conversion import convert_between, named_unit
from eightpost import units
from eightpost.errors import UnknownUnitError, WiringError, suggestion


def find_variable(components: Mapping[str, Component], name: str) -> Variable:
    """Return the variable `component.variable`.

    Raises:
        WiringError: There is no such component or variable; the message lists similar names.
    """
    component, _, variable = name.partition(".")
    if component not in components:
        raise WiringError(f"{name}: there is no component {component!r}; {suggestion(component, components)}")
    variables = components[component].variables
    if variable not in variables:
        raise WiringError(
            f"{name}: component {component!r} has no variable {variable!r}; {suggestion(variable, variables)}"
        )
    return variables[variable]


def own_unit(components: Mapping[str, Component], name: str, value: bool | float | str) -> bool | float | str:
    """Return a value of `component.variable` in the variable's own unit; a number is already in it.

    Raises:
        WiringError: There is no such component or variable, or the unit does not fit.
    """
    variable = find_variable(components, name)
    if isinstance(value, np.generic):
        value = value.item()
    if variable.type in DISCRETE:
        return int(value) if isinstance(value, float) and value.is_integer() else value
    if variable.type != "Real":
        return value
    if not isinstance(value, str):
        if isinstance(value, bool) or not isinstance(value, Real):
            raise WiringError(f"{name}: the value is {value!r}; give a number, or a text such as '55 lbf'")
        return float(value)
    try:
        number, unit = units.quantity(value)
        return convert_between(named_unit(unit), variable.unit, f"{name} = {value!r}")(number)
    except UnknownUnitError as error:
        raise WiringError(f"{name}: {error}") from error


def can_be_set(variable: Variable) -> bool:
    """Return whether a variable can be set before a run and keeps its value: a parameter, or an initial value.

    In FMI exactly the variables that can be set before initialization have a start value (FMI 2.0.4, 2.2.7, `initial`).
    Real inputs are excluded here, because they are connected, driven or constant.
    """
    if variable.causality == "input":
        return variable.type != "Real"
    return variable.causality == "parameter" or (variable.start is not None and variable.variability != "constant")


_KINDS: Mapping[str, tuple[type, ...]] = {
    "Real": (int, float),
    "Integer": (int,),
    "Boolean": (bool,),
    "String": (str,),
    "Enumeration": (int,),
    "Binary": (),
}


def check_value(name: str, variable: Variable, value: object) -> None:
    """Refuse a value of the wrong type or outside the range that the component declares.

    Raises:
        WiringError: The value has the wrong type, or is outside the range.
    """
    if type(value) not in _KINDS.get(variable.type, (type(value),)):
        raise WiringError(f"{name} = {value!r}: it is a {variable.type} variable and takes no {type(value).__name__}")
    if not isinstance(value, (int, float)) or isinstance(value, bool):
        return
    low, high = variable.minimum, variable.maximum
    if not isfinite(value) or (low is not None and value < low) or (high is not None and value > high):
        unit = f" {variable.unit.name}" if variable.unit and variable.unit.name != "1" else ""
        lowest, highest = ("any" if limit is None else f"{limit:g}" for limit in (low, high))
        raise WiringError(f"{name} = {value!r}{unit} is outside its range, {lowest} to {highest}{unit}")
