"""Shocks of the virtual rig, by their names on the command line."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from eightpost import units
from eightpost.errors import InputError, ParameterError
from eightpost.rig import configuration, demo_damper, shim_build
from eightpost.rig.post import LinearDamper
from eightpost.shock.file import read_shock

if TYPE_CHECKING:
    from collections.abc import Iterable

    from eightpost.rig.post import Shock


def per_corner(names: tuple[str, ...], corners: int) -> tuple[str, ...]:
    """Return one name for each corner, from one name for all or one for each."""
    if len(names) not in (1, corners):
        raise InputError(f"give --shock once or {corners} times, not {len(names)} times")
    return names * corners if len(names) == 1 else names


def shocks_named(names: Iterable[str]) -> dict[str, Shock]:
    """Return each different shock by its name: 'demo:A', 'configuration:1', 'build:C/B', a damping, or a shock.json."""
    return {name: _shock(name) for name in dict.fromkeys(names)}


def _shock(name: str) -> Shock:
    kind, _, own_name = name.partition(":")
    try:
        if kind == "demo" and own_name:
            return demo_damper(own_name)
        if kind == "configuration" and own_name:
            return configuration(int(own_name))
        if kind == "build" and own_name:
            return shim_build(own_name)
    except ValueError as error:
        raise InputError(f"--shock {name}: {error}") from error
    if Path(name).suffix == ".json":
        return read_shock(name).law
    return LinearDamper(si(name, "N.s/m", "--shock"))


def si(text: str, unit: str, option: str) -> float:
    """Return the positive quantity that was given to an option, in an SI unit."""
    try:
        number, given = units.quantity(text)
        value = units.convert(number, given, unit)
    except InputError as error:
        raise InputError(f"{option} {text!r}: {error}") from error
    if not value > 0.0:
        raise ParameterError(f"{option} must be above 0, not {text!r}")
    return float(value)
