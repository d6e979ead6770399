"""The dissertation's twelve configurations (Table 3.1), and its printed errors (Tables 3.4 and 3.5)."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from eightpost.errors import ParameterError
from eightpost.rig.dyno_test import DynoTest
from eightpost.signals import parquet_header
from eightpost.units import convert

# ---- Tables 3.4 and 3.5, read from printed.toml ---------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class _PrintedFit:
    """A row of Table 3.4."""

    rms_lbf: float  #: Fit error [lbf].
    percent_of_deviation: float  #: Fit error in percent of the force's standard deviation.
    fit_seconds: float  #: Time of the fit [s].
    evaluation_seconds: float  #: Time of an evaluation [s].
    percent_less_than_static: float | None = None  #: Reduction from Polylinear [percent]; None for Polylinear itself.


@dataclass(frozen=True, slots=True)
class _PrintedConfiguration:
    """A column of Table 3.5."""

    number: int  #: Number 1 to 12, in the order of Table 3.1.
    build: int  #: Build number: 1, 2 or 4.
    clicks: int  #: Clicks of the bleed adjuster.
    gas_pressure_psi: float  #: Gas pressure [psi].
    rms_lbf: Mapping[str, float]  #: Error on the random validation record [lbf] by law.

    @property
    def title(self) -> str:
        """The heading of the column in the table."""
        return (
            f"Build {self.build}, {self.clicks} click{'' if self.clicks == 1 else 's'}, {self.gas_pressure_psi:g} psi"
        )


_DOCUMENT = tomllib.loads(Path(__file__).with_name("printed.toml").read_text(encoding="utf-8"))

#: Publication with the printed figures.
SOURCE: str = _DOCUMENT["source"]

#: Configuration of Table 3.4.
TABLE_3_4_CONFIGURATION = 1

#: Table 3.4 by law.
TABLE_3_4 = {law: _PrintedFit(**row) for law, row in _DOCUMENT["fit"].items()}

#: Table 3.5, configurations 1 to 12.
CONFIGURATIONS = tuple(_PrintedConfiguration(**column) for column in _DOCUMENT["configuration"])


def printed_configuration(number: int) -> _PrintedConfiguration:
    """Return a column of Table 3.5."""
    return CONFIGURATIONS[number - 1]


# ---- Assignment of records and shocks to the configurations ---------------------------------------------------------

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
    """Return a configuration's number after checking it.

    Raises:
        ParameterError: It is not a whole number of a row of Table 3.1.
    """
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
