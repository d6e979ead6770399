"""Ports of a vehicle for the shocks of a study (docs/reference/ports.md)."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from pathlib import Path

from cosim.components.component import Component
from cosim.systems.system import Bond
from eightpost.errors import InputError


def ports(vehicle: Component) -> tuple[str, ...]:
    """Return the corners at which a vehicle has a port (docs/reference/ports.md); `corner` for a quarter car."""
    names = vehicle.variables
    found = [
        name.removesuffix(".velocity")
        for name, variable in names.items()
        if name.endswith(".velocity") and variable.causality == "output"
    ]
    corners = tuple(c for c in found if f"{c}.force" in names and names[f"{c}.force"].causality == "input")
    is_quarter = {"velocity", "force"} <= set(names) and names["velocity"].causality == "output"
    return corners or (("corner",) if is_quarter else ())


def bond_at(vehicle: Component, name: str, corner: str, shock: Component) -> Bond:
    """Return the bond of a shock at a corner; the port of a quarter car has no corner in its name.

    Args:
        vehicle: Vehicle.
        name: Name of the vehicle's component.
        corner: Corner, which is also the name of the shock's component.
        shock: Shock.
    """
    port = f"{name}.{corner}" if f"{corner}.velocity" in vehicle.variables else name
    return Bond.between(port, corner, displacement="displacement" in shock.variables, name=corner)


def check_corners(corners: Collection[str], vehicle: Component, file: Path) -> None:
    """Refuse corners that are not the vehicle's: a port without a shock would have no damping.

    Args:
        corners: Corners that a study names.
        vehicle: Vehicle.
        file: File of the vehicle, for the message.

    Raises:
        InputError: The vehicle has no port for a shock, or not that of a corner, or a port has no shock.
    """
    known = ports(vehicle)
    if not known:
        raise InputError(f"vehicle.fmu: {file} has no port for a shock, so it is no vehicle that a study can run; name "
                         "a vehicle file or the FMU of a vehicle (docs/reference/ports.md)")  # fmt: skip
    listed = f"{file} has {_counted(known)}"
    if unknown := [corner for corner in corners if corner not in known]:
        raise InputError(f"corners: the vehicle has no port {unknown[0]!r}; {listed}. Name its ports in [corners], or "
                         "a vehicle that has these corners")  # fmt: skip
    if missing := [corner for corner in known if corner not in corners]:
        raise InputError(f"corners: {missing[0]} has no shock; {listed}. Name the builds allowed at {missing[0]}")


def _counted(known: Sequence[str]) -> str:
    return f"the port {known[0]!r} only" if len(known) == 1 else f"ports at {', '.join(known)}"
