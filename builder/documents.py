"""Documents of an FMU: icon, origin, licences."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

from builder.interface import source_folder
from builder.page import LOOP_FREQUENCY, page, shock_picture, terminals_and_icons, vehicle_picture
from builder.product import Product
from builder.reference import SECRET, Disclosure, customary, quantity, results, validity_member
from eightpost import units
from eightpost.report.static import Column, Picture, Section, bullets, paragraph, table
from eightpost.shock import Response, Shock
from eightpost.vehicle import Corners, IdentifiedVehicle, StructuralVehicle, Vehicle


def icon(source: Shock | Vehicle) -> bytes:
    """Return a square PNG, 256 pixels wide, with a transparent background."""
    name = "shock.png" if isinstance(source, Shock) else "vehicle.png"
    return (Path(__file__).with_name("icons") / name).read_bytes()


# ---- The origin of an FMU's data ------------------------------------------------------------------------------------

_KEY = re.compile(r"(.*?) \[(.+)\]")

#: Entries of a fit that a confidential page shows: the ranges of validity and the error of the fit. Numbers only.
_OPEN_CONDITIONS = ("velocity_range [m/s]", "frequency_range [Hz]", "displacement_range [m]", "temperature_range [K]")
_OPEN_FIT = ("rms [N]", "percent", "held_out")

_QUANTITIES = (Column("quantity", "tight"), Column("value"), Column("SI"))
_FILES = (Column("file", "tight"), Column("SHA-256", "digest"))


def _shock_origin(shock: Shock) -> list[Section]:
    sections = [Section("Conditions of the measurement", _quantities(shock.conditions)), *_edits(shock)]
    sections += [Section("Fit", _fit(shock.fit))] if shock.fit else []
    rows = [(str(entry.get("name", "")), str(entry.get("sha256", ""))) for entry in shock.inputs]
    return [*sections, Section("Source files", table(_FILES, rows))] if rows else sections


def open_shock_origin(shock: Shock) -> list[Section]:
    """Return the information about a shock on a confidential page: ranges, and the error of the fit."""
    known = {key: shock.conditions[key] for key in _OPEN_CONDITIONS if key in shock.conditions}
    known |= {key: shock.fit[key] for key in _OPEN_FIT if key in shock.fit}
    return [Section("Range of validity", _quantities(known))]


def _edits(source: Shock | IdentifiedVehicle) -> list[Section]:
    """Return a section that says that the numbers are not those that were judged; empty if they are."""
    known = source.validity.edits if source.validity else ()
    text = (f"{reason.grade.capitalize()}: {reason.statement}. To do: {reason.remedy}." for reason in known)
    return [Section("Verdict", bullets(text))] if known else []


def _vehicle_origin(vehicle: Vehicle) -> list[Section]:
    if isinstance(vehicle, StructuralVehicle):
        sections = [Section("Vehicle", table(_QUANTITIES, _parameters(vehicle.parameters)))]
    else:
        sections = _identified(vehicle)
    return [*sections, Section("Modes", _modes(vehicle))]


def _identified(vehicle: IdentifiedVehicle) -> list[Section]:
    text = "Identified model. Its baseline damping was removed, so that the ports take the whole shock force."
    damping = {f"baseline damping, {port or 'port'} [N.s/m]": c for port, c in vehicle.baseline_damping.items()}
    sections = [Section("Vehicle", paragraph(text) + (_quantities(damping) if damping else ""))]
    sections += _edits(vehicle)
    files = list(vehicle.sources.items())
    return [*sections, Section("Source files", table(_FILES, files))] if files else sections


def _quantities(values: Mapping[str, Any]) -> str:
    rows = [_row(key, value) for key, value in values.items()]
    return table(_QUANTITIES, rows) if rows else paragraph("None stated.")


def _row(key: str, value: Any) -> tuple[str, str, str]:
    """Return name, customary value and SI value of `name [unit]: number or range`; return other values unchanged."""
    match = _KEY.fullmatch(key)
    name = (match[1] if match else key).replace("_", " ")
    if match and _numeric(value):
        shown = quantity(value, match[2])
        us = customary(value, match[2])
        return (name, us or shown, shown if us else "")
    if name == "percent" and _numeric(value):
        return ("rms, share of the force's standard deviation", quantity(value, "%"), "")
    if name == "held out" and isinstance(value, Mapping) and type(own := value.get("percent")) is float:
        other = value.get("lpnl2_percent")
        beside = f" (LPNL2: {quantity(other, '%')})" if type(other) is float else ""
        return ("rms of what was left out of the fit, share as above", quantity(own, "%") + beside, "")
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
    target = units.us_customary(unit)
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


# ---- The documents of one FMU ---------------------------------------------------------------------------------------


#: What may be disclosed about a product: variables and text, picture, origin, recorded outputs.
_Disclosed = tuple[Product, Picture, Sequence[Section], tuple[str, ...]]


def documents(product: Product, *, disclosure: Disclosure, fmi: int = 2) -> dict[str, bytes]:
    """Return the documents of an archive, for people and for tools: member name -> content.

    The same product gives the same bytes. A confidential archive contains no curve picture, no coefficients, and
    neither names nor digests of source files. It also omits the product's name, which is often the name of its file.
    `fmi` is the FMI version, 2 or 3, which only the page names.
    """
    shown, picture, origin, recorded = (_full if disclosure is Disclosure.FULL else _confidential)(product)
    reference = results(shown, recorded)
    described = shown.identifier, shown.text, shown.interface
    return {
        "model.png": picture.png,
        "documentation/index.html": page(described, picture, origin, has_reference=bool(reference), fmi=fmi),
        "documentation/licenses/license.txt": (source_folder() / "LICENSE.txt").read_bytes(),
        "terminalsAndIcons/terminalsAndIcons.xml": terminals_and_icons(shown.interface),
        "terminalsAndIcons/icon.png": icon(shown.source),
        **validity_member(product.source, product.identifier, disclosure),
        **reference,
    }


def _full(product: Product) -> _Disclosed:
    source = product.source
    if isinstance(source, Shock):
        caption = (
            "Force at the port without gas force. Shaded: fitted range. If the law has lag, the loop is its "
            f"response to a sine of {LOOP_FREQUENCY:g} Hz."
        )
        return product, Picture(shock_picture(source), caption), _shock_origin(source), Response._fields
    caption = "Frequency responses with the linear dampers of the vehicle's source file. The FMU itself has no dampers."
    return product, Picture(vehicle_picture(source), caption), _vehicle_origin(source), ()


def _confidential(product: Product) -> _Disclosed:
    interface, source = product.interface, product.source
    shown = replace(interface, variables=tuple(v for v in interface.variables if not v.name.startswith(SECRET)))
    picture = Picture(icon(source), "A confidential build: its sources are not in this archive.", "icon")
    origin = open_shock_origin(source) if isinstance(source, Shock) else []
    origin += [] if isinstance(source, StructuralVehicle) else _edits(source)
    return replace(product, text=interface.description, interface=shown), picture, origin, ("force",)
