"""The origin of an FMU's data: a fit and its conditions, a vehicle's parameters and modes, digests of files."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import fields
from typing import Any

from builder.documents.markup import Column, Section, bullets, paragraph, table
from builder.documents.quantities import CUSTOMARY, customary, quantity
from eightpost import units
from eightpost.shock import Shock
from eightpost.vehicle import Corners, IdentifiedVehicle, StructuralVehicle, Vehicle

_KEY = re.compile(r"(.*?) \[(.+)\]")

#: Entries of a fit that a confidential page shows: the ranges of validity and the error of the fit. Numbers only.
_OPEN_CONDITIONS = ("velocity_range [m/s]", "frequency_range [Hz]", "displacement_range [m]", "temperature_range [K]")
_OPEN_FIT = ("rms [N]", "percent")

_QUANTITIES = (Column("quantity", "tight"), Column("value"), Column("SI"))
_FILES = (Column("file", "tight"), Column("SHA-256", "digest"))


def shock_origin(shock: Shock) -> list[Section]:
    """Return all information about a shock's measurement and fit."""
    sections = [Section("Conditions of the measurement", _quantities(shock.conditions))]
    if shock.fit:
        sections.append(Section("Fit", _fit(shock.fit)))
    if shock.inputs:
        rows = [(str(entry.get("name", "")), str(entry.get("sha256", ""))) for entry in shock.inputs]
        sections.append(Section("Source files", table(_FILES, rows)))
    return sections


def open_shock_origin(shock: Shock) -> list[Section]:
    """Return the information about a shock on a confidential page: ranges, and the error of the fit."""
    known = {key: shock.conditions[key] for key in _OPEN_CONDITIONS if key in shock.conditions}
    known |= {key: shock.fit[key] for key in _OPEN_FIT if key in shock.fit}
    return [Section("Range of validity", _quantities(known))]


def vehicle_origin(vehicle: Vehicle) -> list[Section]:
    """Return a vehicle's parameters, if it has any, and its modes."""
    if isinstance(vehicle, StructuralVehicle):
        sections = [Section("Vehicle", table(_QUANTITIES, _parameters(vehicle.parameters)))]
    else:
        sections = _identified(vehicle)
    return [*sections, Section("Modes", _modes(vehicle))]


def _identified(vehicle: IdentifiedVehicle) -> list[Section]:
    text = "Identified model. Its baseline damping was removed, so that the ports take the whole shock force."
    damping = {f"baseline damping, {port or 'port'} [N.s/m]": c for port, c in vehicle.baseline_damping.items()}
    sections = [Section("Vehicle", paragraph(text) + (_quantities(damping) if damping else ""))]
    if vehicle.sources:
        sections.append(Section("Source files", table(_FILES, list(vehicle.sources.items()))))
    return sections


def _quantities(values: Mapping[str, Any]) -> str:
    rows = [_row(key, value) for key, value in values.items()]
    return table(_QUANTITIES, rows) if rows else paragraph("None stated.")


def _row(key: str, value: Any) -> tuple[str, str, str]:
    """Return name, customary value and SI value of `name [unit]: number or range`; return other values unchanged."""
    match = _KEY.fullmatch(key)
    name = (match[1] if match else key).replace("_", " ")
    if match and _numeric(value):
        shown = quantity(value, match[2])
        return (name, customary(value, match[2]) or shown, shown if match[2] in CUSTOMARY else "")
    if name == "percent" and _numeric(value):
        return ("rms, share of the force's standard deviation", quantity(value, "%"), "")
    return (name, value if isinstance(value, str) else json.dumps(value), "")


def _numeric(value: Any) -> bool:
    numbers = value if isinstance(value, Sequence) and not isinstance(value, str) else [value]
    return all(type(number) in (int, float) for number in numbers)


def _fit(fit: Mapping[str, Any]) -> str:
    """Return the fit's quality, its parameters with their standard errors, its warnings and its changes."""
    quality = {key: value for key, value in fit.items() if key not in ("parameters", "changes", "warnings")}
    html = _quantities(quality)
    if isinstance(parameters := fit.get("parameters"), Mapping):
        columns = (Column("parameter", "tight"), Column("value"), Column("± standard error"), Column("bounds"))
        html += table(columns, list(_fitted(parameters)))
    for name in ("warnings", "changes"):
        if notes := [str(note) for note in fit.get(name, ())]:
            html += f"<h3>{name.capitalize()}</h3>" + bullets(notes)
    return html


def _fitted(parameters: Mapping[str, Any]) -> Iterator[tuple[str, str, str, str]]:
    for name, entry in parameters.items():
        unit = str(entry.get("unit", ""))
        error = entry.get("standard_error")
        yield (
            name,
            _both(entry.get("value"), unit),
            "" if error is None else _both(error, unit),
            _bounds(entry.get("bounds"), unit) + (f", at {entry['at_bound']}" if entry.get("at_bound") else ""),
        )


def _both(value: Any, unit: str) -> str:
    us = customary(value, unit)
    return f"{us} ({quantity(value, unit)})" if us else quantity(value, unit)


def _bounds(bounds: Sequence[float | None] | None, unit: str) -> str:
    if bounds is None:
        return ""
    target = CUSTOMARY.get(unit, unit)
    low, high = ("" if end is None else f"{units.convert(float(end), unit, target):.4g}" for end in bounds)
    return f"{low or '−∞'} to {high or '∞'} {target}"


def _parameters(parameters: Any) -> Iterator[tuple[str, str, str]]:
    for declared in fields(parameters):
        value, unit = getattr(parameters, declared.name), declared.metadata["unit"]
        name = declared.name.replace("_", " ")
        for suffix, number in _at_corners(value).items():
            yield (name + suffix, customary(number, unit) or quantity(number, unit), quantity(number, unit))


def _at_corners(value: float | Corners | None) -> dict[str, float]:
    """Return values by the suffix of their name; four equal corners give one value without suffix."""
    if value is None:
        return {}
    if not isinstance(value, Corners):
        return {"": value}
    return {"": value.lf} if len(set(value)) == 1 else {f" {corner}": c for corner, c in value._asdict().items()}


def _modes(vehicle: Vehicle) -> str:
    columns = (Column("frequency", "number"), Column("damping ratio", "number"))
    rows = [(f"{mode.frequency_hz:.3g} Hz", f"{mode.damping_ratio:.3f}") for mode in vehicle.with_damper().modes()]
    text = "With the linear dampers of the vehicle's source file. The FMU has no dampers: shocks replace them."
    return paragraph(text) + table(columns, rows)
