"""Settings of a shock in the name of its dynamometer file: `damper_2clicks`, `run_1.5A`, `t1_n10_150psi`."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from eightpost.rig.dyno_conditions import DynoConditions
from eightpost.units import convert

if TYPE_CHECKING:
    from pathlib import Path

_NUMBER = r"(?<![A-Za-z0-9.,])(\d+(?:[.,]\d+)?)"
#: Names of adjusters before a number.
_NAMED = re.compile(
    r"(?<![A-Za-z])(rebound|reb|compression|comp|bump|lsc|hsc|lsr|hsr)[ _-]?(\d+)(?![\d.,]*\d|[A-Za-z])", re.IGNORECASE
)
#: Units of settings in file names, and the adjuster that they belong to.
UNITS = {"click": "clicks", "mA": "current", "A": "current", "V": "voltage"}


def numbers_in(stem: str, unit: str, *, has_decimals: bool = False) -> list[float]:
    """Return the numbers with a unit (`click`, `A`, `psi`) in the name of a file, all or those with decimals."""
    word, ignore = ("clicks?", re.IGNORECASE) if unit == "click" else (re.escape(unit), re.NOFLAG)
    found = re.findall(rf"{_NUMBER}[ _-]?{word}(?![A-Za-z])", stem, ignore)
    return [float(one.replace(",", ".")) for one in found if not has_decimals or not one.isdigit()]


def setting_in(stem: str, adjuster: str, unit: str) -> float | None:
    """Return the setting of an adjuster in the name of a file: the number behind its name or before its unit.

    None without one, or if several numbers have the unit. An empty unit is that of no number.
    """
    found = [float(number) for name, number in _NAMED.findall(stem) if adjuster.lower().startswith(name.lower())]
    found = found or (numbers_in(stem, unit) if unit else [])
    return found[0] if len(found) == 1 else None


def conditions_in(path: Path) -> tuple[DynoConditions, tuple[str, ...]]:
    """Return the settings and the gas pressure in the name of a file, and a note if there are some."""
    stem = path.stem
    settings = [f"{name} {number}" for name, number in _NAMED.findall(stem)]
    # `1A` and `2V` may be the names of builds.
    settings += [
        f"{n:g} {unit.replace('click', 'clicks')}"
        for unit in UNITS
        for n in numbers_in(stem, unit, has_decimals=unit in ("A", "V"))
    ]
    pressures = {unit: found for unit in ("psi", "bar", "kPa") if len(found := numbers_in(stem, unit)) == 1}
    unit, (pressure,) = next(iter(pressures.items())) if len(pressures) == 1 else ("", (0.0,))
    stated = [*settings, *([f"gas {pressure:g} {unit}"] if unit else [])]
    note = f"from the name of the file: {', '.join(stated)}"
    return DynoConditions(
        clicks=", ".join(settings) or None, gas_pressure=convert(pressure, unit, "Pa") if unit else None
    ), (note,) if stated else ()
