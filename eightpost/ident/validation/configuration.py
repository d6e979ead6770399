"""Assignment of records and shocks to the dissertation's twelve configurations (Table 3.1)."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from eightpost.errors import ParameterError
from eightpost.ident.validation.printed import CONFIGURATIONS
from eightpost.signals import parquet_header
from eightpost.units import convert

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path
    from typing import Any

    from eightpost.rig.dyno_test import DynoTest

#: Number of bytes of a text file that are searched for its note.
_HEAD = 2048

#: Tolerance between a stated gas pressure and that of the table [psi].
_NEAR = 10.0


def configuration_of(conditions: Mapping[str, Any]) -> int | None:
    """Return the configuration 1 to 12 that conditions state, or None.

    Args:
        conditions: Conditions of a test or shock. `configuration` takes precedence; otherwise `build` (such as
            `Build 1`), `clicks` (starting with 1 or 14) and `gas_pressure [Pa]` must together match Table 3.1.

    Raises:
        ParameterError: `configuration` is not a whole number from 1 to 12.
    """
    stated = conditions.get("configuration")
    if stated is not None:
        return checked(stated)
    build = re.fullmatch(r"\s*build\s*(\d+)\s*", str(conditions.get("build")), re.IGNORECASE)
    clicks = re.match(r"\s*(\d+)\b", str(conditions.get("clicks")))
    pressure = conditions.get("gas_pressure [Pa]")
    if not (build and clicks and pressure):
        return None
    for printed in CONFIGURATIONS:
        near = abs(convert(float(pressure), "Pa", "psi") - printed.gas_pressure_psi) <= _NEAR
        if near and int(build[1]) == printed.build and int(clicks[1]) == printed.clicks:
            return printed.number
    return None


def checked(number: object) -> int:
    """Return a configuration's number after checking it."""
    if isinstance(number, (int, float, str)) and str(number).strip().isdigit():
        found = int(str(number).strip())
        if 1 <= found <= len(CONFIGURATIONS):
            return found
    raise ParameterError(f"a configuration is a whole number from 1 to {len(CONFIGURATIONS)}, not {number!r}")


def configuration_of_file(path: Path) -> int | None:
    """Return the configuration that a note in a file states (`configuration 3`), or None.

    Args:
        path: Text file, whose first lines are searched, or Parquet file, whose header is searched.
    """
    suffix = path.suffix.lower()
    if suffix in (".csv", ".txt"):
        with path.open("rb") as stream:
            note = stream.read(_HEAD).decode("utf-8", errors="replace")
    elif suffix == ".parquet":
        note = str((parquet_header(path) or {}).get("note", ""))
    else:
        return None
    found = re.search(r"\bconfiguration\W{1,3}(\d{1,2})\b", note, re.IGNORECASE)
    return checked(found[1]) if found else None


def conditions_of_test(test: DynoTest) -> dict[str, Any]:
    """Return the conditions that a test states, under the names of a shock file."""
    known = test.conditions
    stated = {
        "configuration": getattr(known, "configuration", None),
        "build": known.build,
        "clicks": known.clicks,
        "gas_pressure [Pa]": known.gas_pressure,
    }
    return {name: value for name, value in stated.items() if value is not None}
