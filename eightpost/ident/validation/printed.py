"""The dissertation's Tables 3.4 and 3.5, read from printed.toml."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from importlib.resources import files
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Mapping


@dataclass(frozen=True, slots=True)
class PrintedFit:
    """A row of Table 3.4.

    Attributes:
        rms_lbf: Fit error [lbf].
        percent_of_deviation: Fit error in percent of the force's standard deviation.
        fit_seconds: Time of the fit [s].
        evaluation_seconds: Time of an evaluation [s].
        percent_less_than_static: Reduction from Polylinear [percent]; None for Polylinear itself.
    """

    rms_lbf: float
    percent_of_deviation: float
    fit_seconds: float
    evaluation_seconds: float
    percent_less_than_static: float | None = None


@dataclass(frozen=True, slots=True)
class PrintedConfiguration:
    """A column of Table 3.5.

    Attributes:
        number: Number 1 to 12, in the order of Table 3.1.
        build: Build number: 1, 2 or 4.
        clicks: Clicks of the bleed adjuster.
        gas_pressure_psi: Gas pressure [psi].
        rms_lbf: Error on the random validation record [lbf] by law.
    """

    number: int
    build: int
    clicks: int
    gas_pressure_psi: float
    rms_lbf: Mapping[str, float]

    @property
    def title(self) -> str:
        """The heading of the column in the table."""
        return (
            f"Build {self.build}, {self.clicks} click{'' if self.clicks == 1 else 's'}, {self.gas_pressure_psi:g} psi"
        )


def _read() -> dict[str, Any]:
    return tomllib.loads(files("eightpost.ident.validation").joinpath("printed.toml").read_text(encoding="utf-8"))


_DOCUMENT = _read()

#: Publication with the printed figures.
SOURCE: str = _DOCUMENT["source"]

#: Configuration of Table 3.4.
TABLE_3_4_CONFIGURATION = 1

#: Table 3.4 by law.
TABLE_3_4 = {law: PrintedFit(**row) for law, row in _DOCUMENT["fit"].items()}

#: Table 3.5, configurations 1 to 12.
CONFIGURATIONS = tuple(PrintedConfiguration(**column) for column in _DOCUMENT["configuration"])


def printed_configuration(number: int) -> PrintedConfiguration:
    """Return a column of Table 3.5."""
    return CONFIGURATIONS[number - 1]
