"""Which of the dissertation's twelve configurations (Table 3.1) a record or a shock is."""

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

#: Bytes of a text file that its note may be in.
_HEAD = 2048

#: How far a stated gas pressure may be from a table's [psi].
_NEAR = 10.0


def configuration_of(conditions: Mapping[str, Any]) -> int | None:
    """Return the configuration 1 to 12 that conditions say, None where they say none.

    Args:
        conditions: `configuration` goes first; else `build` (such as `Build 1`), `clicks` (1 or 14 at its beginning)
            and `gas_pressure [Pa]` together, as Table 3.1 has them.

    Raises:
        ParameterError: `configuration` is no whole number from 1 to 12.
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
    """Return a configuration's number, refusing what is none."""
    if isinstance(number, (int, float, str)) and str(number).strip().isdigit():
        found = int(str(number).strip())
        if 1 <= found <= len(CONFIGURATIONS):
            return found
    raise ParameterError(f"a configuration is a whole number from 1 to {len(CONFIGURATIONS)}, not {number!r}")


def configuration_of_file(path: Path) -> int | None:
    """Return the configuration that a file's own note says (`configuration 3`), None where it says none.

    Args:
        path: A text file, whose first lines are looked at, or a Parquet file, whose header is.
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
    """Return what a test says about its conditions, under the names of a shock file."""
    known = test.conditions
    stated = {
        "configuration": getattr(known, "configuration", None),
        "build": known.build,
        "clicks": known.clicks,
        "gas_pressure [Pa]": known.gas_pressure,
    }
    return {name: value for name, value in stated.items() if value is not None}
