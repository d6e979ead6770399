"""The dissertation's twelve configurations (Table 3.1), and its printed errors (Tables 3.4 and 3.5)."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path


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


_DOCUMENT = tomllib.loads(Path(__file__).with_name("printed_shocks.toml").read_text(encoding="utf-8"))

#: Configuration of Table 3.4.
TABLE_3_4_CONFIGURATION = 1

#: Table 3.4 by law.
TABLE_3_4 = {law: _PrintedFit(**row) for law, row in _DOCUMENT["fit"].items()}

#: Table 3.5, configurations 1 to 12.
CONFIGURATIONS = tuple(_PrintedConfiguration(**column) for column in _DOCUMENT["configuration"])


def printed_configuration(number: int) -> _PrintedConfiguration:
    """Return a column of Table 3.5."""
    return CONFIGURATIONS[number - 1]
