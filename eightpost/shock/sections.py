"""Sections of a shock file beside the numbers of its law: entries that eightpost reads again; others are free."""

from __future__ import annotations

from typing import Annotated, Any, NotRequired

from pydantic import Field, with_config
from typing_extensions import TypedDict  # pydantic needs it before Python 3.12

from eightpost.schema import OPEN

Conditions = TypedDict("Conditions", {
    "gas_treatment": NotRequired[str],
    "gas_pressure [Pa]": NotRequired[float | None],
    "gas_preload_estimate [N]": NotRequired[float],
    "gas_stiffness_estimate [N/m]": NotRequired[float],
    "displacement_reference [m]": NotRequired[float],
    "temperature_range [K]": NotRequired[list[float]],
})  # fmt: skip
Band = TypedDict("Band", {
    "level": Annotated[float, Field(gt=0.0, lt=1.0)],
    "velocity [m/s]": list[float],
    "force [N]": list[float],
    "half_width [N]": list[float],
    "factor_half_width": NotRequired[dict[str, float]],
})  # fmt: skip


class _FittedValue(TypedDict):
    """A fitted parameter."""

    value: float
    unit: NotRequired[str]
    standard_error: float | None
    bounds: tuple[float | None, float | None] | None
    at_bound: str


class Spread(TypedDict):
    """A parameter's spread between builds."""

    standard_deviation: float


class Builds(TypedDict):
    """Spread between builds that were fitted together."""

    parameters: NotRequired[dict[str, Spread]]


class HeldOut(TypedDict):
    """Error on what was left out of the fit."""

    percent: NotRequired[float]


Fit = TypedDict("Fit", {
    "recipe": NotRequired[str],
    "rms [N]": NotRequired[float],
    "percent": NotRequired[float],
    "percent_of_static_curve": NotRequired[float],
    "parameters": NotRequired[dict[str, _FittedValue]],
    "curve_band": NotRequired[Band],
    "held_out": NotRequired[HeldOut],
    "between_builds": NotRequired[Builds],
    "changes": NotRequired[list[str]],
    "warnings": NotRequired[list[str]],
})  # fmt: skip


@with_config(OPEN)
class Sections(TypedDict):
    """Entries of a shock file beside the curve and the port."""

    name: NotRequired[str | None]
    law: str
    parameters: NotRequired[dict[str, Any]]
    settings: NotRequired[dict[str, Any]]
    validity: NotRequired[dict[str, Any]]
    conditions: NotRequired[Conditions]
    fit: NotRequired[Fit]
    inputs: NotRequired[list[dict[str, str]]]
