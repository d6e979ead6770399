"""Registry of the laws: each file of this folder that defines a subclass of `ShockLaw` is a law of the file's name."""

from __future__ import annotations

import dataclasses
import inspect
import pkgutil
from collections.abc import Mapping
from importlib import import_module
from pathlib import Path
from types import ModuleType

from eightpost.errors import ParameterError, choice_of
from eightpost.shock.law import FitParameter, ShockLaw

#: Files that are not laws, among them all files that import this one.
_OTHERS = ("compiled", "curve", "file", "law", "laws", "records", "sections", "settings", "shape")


def own_parameters(law: type[ShockLaw]) -> tuple[str, ...]:
    """Return the names of a law's own parameters, without curve and port."""
    return tuple(f.name for f in dataclasses.fields(law) if f.name not in ("curve", "port"))


def own_values(law: ShockLaw) -> tuple[float, ...]:
    """Return the values of a law's own parameters, those of tuples one after the other."""
    values = (getattr(law, name) for name in own_parameters(type(law)))
    return tuple(number for value in values for number in (value if isinstance(value, tuple) else (value,)))


def own_size(law: type[ShockLaw]) -> int:
    """Return the number of `own_values` of a law."""
    sizes: Mapping[str, int] = getattr(law_module(law), "SIZES", {})
    return sum(sizes.get(name, 1) for name in own_parameters(law))


def state_names(law: type[ShockLaw]) -> tuple[str, ...]:
    """Return the names of a law's states."""
    names: tuple[str, ...] = getattr(law_module(law), "STATES", ("lagged_force",))
    return names


def law_name(law: type[ShockLaw]) -> str:
    """Return the name of a law in files and on the command line."""
    return next(name for name, known in LAWS.items() if known is law)


def named_law(name: object) -> str:
    """Return the name of the law that a file or a user names, by its title or its identifier.

    Raises:
        ParameterError: There is no such law, or no longer; the message names similar ones.

    >>> named_law("LPNL2")
    'lpnl2'
    """
    if name == "auto":
        raise ParameterError(f"the choice among laws was removed; omit the law, or choose from {', '.join(LAWS)}")
    if name in FORMER:
        raise ParameterError(f"the law {law_title(str(name))} is no longer supported; choose from {', '.join(LAWS)}")
    return choice_of("law", name, LAWS)


def law_title(law: str) -> str:
    """Return the display name of a law.

    >>> law_title("lpnl2"), law_title("polylinear")
    ('LPNL2', 'Polylinear')
    """
    return law.upper() if any(letter.isdigit() for letter in law) else law.capitalize()


def law_module(law: type[ShockLaw]) -> ModuleType:
    """Return the module of a law: it has `weight_core`, `advance_core` and `FIT_PARAMETERS`."""
    return import_module(law.__module__)


def fit_parameters(law: type[ShockLaw]) -> tuple[FitParameter, ...]:
    """Return how each of a law's own parameters is fitted, in the order of its fields."""
    declared: tuple[FitParameter, ...] = law_module(law).FIT_PARAMETERS
    return declared


def parameter_units(law: type[ShockLaw]) -> dict[str, str]:
    """Return the unit of each of a law's own parameters by name."""
    stated: Mapping[str, str] = getattr(law_module(law), "UNITS", {})
    return {**stated, **{entry.name: entry.unit for entry in fit_parameters(law)}}


def fit_form(law: type[ShockLaw]) -> str:
    """Return the name of the closed form with which a law is fitted; "stepped" for a law that declares none."""
    return getattr(law_module(law), "FIT_FORM", "stepped")


def _law_classes() -> dict[str, type[ShockLaw]]:
    """Return the laws by name, those with few parameters first."""
    laws: dict[str, type[ShockLaw]] = {}
    for module in pkgutil.iter_modules([str(Path(__file__).parent)]):
        if module.name not in _OTHERS:
            laws |= _laws_in(import_module(f"{__package__}.{module.name}"))
    return dict(sorted(laws.items(), key=lambda item: (len(own_parameters(item[1])), item[0])))


def _laws_in(module: ModuleType) -> dict[str, type[ShockLaw]]:
    classes = [c for _, c in inspect.getmembers(module, inspect.isclass) if c.__module__ == module.__name__]
    return {module.__name__.rpartition(".")[2]: c for c in classes if issubclass(c, ShockLaw)}


FORMER = ("maxwell",)  #: Laws of earlier versions; their FMUs run, but their shock files cannot be read.
LAWS: Mapping[str, type[ShockLaw]] = _law_classes()  #: All laws by the name used in files and on the command line.
