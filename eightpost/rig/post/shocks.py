"""Shocks of the car on the virtual rig, and their names."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from eightpost import units
from eightpost.errors import InputError, ParameterError
from eightpost.rig.damper import PhysicalDamper, configuration, shim_build
from eightpost.rig.truth_damper import TruthDamper, demo_damper
from eightpost.shock.file import read_shock
from eightpost.shock.law import ShockLaw


@dataclass(frozen=True, slots=True)
class LinearDamper:
    """Linear damper F = c v."""

    damping: float  #: Damping c [N.s/m].


Shock = LinearDamper | ShockLaw | TruthDamper | PhysicalDamper


def shocks_named(names: Iterable[str]) -> dict[str, Shock]:
    """Return each different shock by its name: 'demo:A', 'configuration:1', 'build:C/B', a damping, or a shock.json.

    Raises:
        InputError: A name does not exist.
    """
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
    return LinearDamper(_damping(name))


def _damping(text: str) -> float:
    try:
        damping = float(units.convert(*units.quantity(text), "N.s/m"))
    except InputError as error:
        forms = "demo:A, configuration:1, build:C/B, a damping such as '20 lbf.s/in', or a shock.json"
        raise InputError(f"--shock {text!r}: {error}; a shock is one of {forms}") from error
    if not damping > 0.0:
        raise ParameterError(f"--shock must be above 0, not {text!r}")
    return damping
