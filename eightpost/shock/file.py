"""The shock file (shock.json): one law with its parameters, the conditions of its measurement, and its origin."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from eightpost import __version__
from eightpost.errors import FileFormatError, ParameterError
from eightpost.files import MALFORMED, atomic_path, check_schema, json_content
from eightpost.shock.curve import StaticCurve
from eightpost.shock.law import ShockLaw
from eightpost.shock.laws import LAWS, law_name, own_parameters
from eightpost.shock.port import Port
from eightpost.validity import Validity

SCHEMA = 1


@dataclass(frozen=True)
class Shock:
    """A shock: a law, and what is known about its origin.

    Args:
        name: Display name of the build.
        law: Law with its parameters, in SI units.
        conditions: Conditions of the measurement: build, clicks and how they count, gas pressure, temperature range,
            offset, fitted velocity, stroke and frequency ranges. Free-form, JSON values; units in the keys.
        fit: Report of the fit: RMS, bounds, recipe. Free-form, JSON values.
        inputs: Name and SHA-256 of each file that the shock was made from.
        validity: Verdict on the fit and the ranges that it covers; None if not stated.
    """

    name: str
    law: ShockLaw
    conditions: Mapping[str, Any] = field(default_factory=dict)
    fit: Mapping[str, Any] = field(default_factory=dict)
    inputs: tuple[Mapping[str, str], ...] = ()
    validity: Validity | None = None

    @property
    def law_name(self) -> str:
        """The law's name in files and on the command line."""
        return law_name(type(self.law))


def write_shock(shock: Shock, path: str | Path) -> None:
    """Write a shock file; an existing file is replaced only when the new one is complete."""
    document = {
        "schema": SCHEMA,
        "kind": "shock",
        "tool": f"eightpost {__version__}",
        "name": shock.name,
        "law": shock.law_name,
        "parameters": {name: getattr(shock.law, name) for name in own_parameters(type(shock.law))},
        "curve": _curve_section(shock.law.curve),
        "port": dataclasses.asdict(shock.law.port),
        "conditions": dict(shock.conditions),
        "fit": dict(shock.fit),
        "inputs": [dict(entry) for entry in shock.inputs],
    }
    if shock.validity is not None:
        document["validity"] = shock.validity.to_json()
    with atomic_path(path) as temporary:
        temporary.write_text(json.dumps(document, indent=2, allow_nan=False) + "\n", encoding="utf-8")


def _curve_section(curve: StaticCurve) -> dict[str, Any]:
    """Return the curve's values; a curve without knots has no entries for them."""
    section = dataclasses.asdict(curve)
    return section if curve.has_knots else {name: value for name, value in section.items() if "knot_" not in name}


def read_shock(path: str | Path) -> Shock:
    """Read a shock file.

    Raises:
        FileFormatError: The file is not a shock file, or its schema is newer than this version supports.
        ParameterError: A parameter is missing, unknown or out of range; the message names file and parameter.
    """
    document = _read_document(Path(path))
    law_class = LAWS.get(str(document.get("law")))
    if law_class is None:
        raise ParameterError(f"{path}: law is {document.get('law')!r}; it must be one of {', '.join(LAWS)}")
    try:
        curve = _build(StaticCurve, "curve", document)
        port = _build(Port, "port", document)
        parameters = {**_section(document, "parameters"), "curve": curve, "port": port}
        law = _construct(law_class, "parameters", parameters)
        validity = Validity.from_json(document["validity"]) if "validity" in document else None
    except MALFORMED as error:
        raise ParameterError(f"{path}: {error}") from error
    return Shock(
        name=str(document.get("name") or Path(path).stem),
        law=law,
        conditions=_table(document, "conditions", Path(path)),
        fit=_table(document, "fit", Path(path)),
        inputs=_inputs(document, Path(path)),
        validity=validity,
    )


def _table(document: dict[str, Any], name: str, path: Path) -> dict[str, Any]:
    table = document.get(name, {})
    if not isinstance(table, dict):
        raise FileFormatError(f"{name} must be an object, not {table!r}", path=path)
    return table


def _inputs(document: dict[str, Any], path: Path) -> tuple[Mapping[str, str], ...]:
    found = document.get("inputs", [])
    if not isinstance(found, list) or not all(
        isinstance(entry, dict) and all(isinstance(text, str) for text in entry.values()) for entry in found
    ):
        raise FileFormatError(
            "inputs must be a list of objects with text values: the files that the shock was made from", path=path
        )
    return tuple(found)


def _read_document(path: Path) -> dict[str, Any]:
    document = json_content(path)
    if not isinstance(document, dict) or document.get("kind") != "shock":
        raise FileFormatError("is not a shock file (kind is not 'shock'); make one with `eightpost fit`", path=path)
    check_schema(document, SCHEMA, path)
    return document


def _section(document: dict[str, Any], name: str) -> dict[str, Any]:
    section = document.get(name, {})
    if not isinstance(section, dict):
        raise ValueError(f"{name} must be an object, not {section!r}")
    return {key: tuple(value) if isinstance(value, list) else value for key, value in section.items()}


def _build(kind: type[Any], name: str, document: dict[str, Any]) -> Any:
    return _construct(kind, name, _section(document, name))


def _construct(kind: type[Any], section: str, values: dict[str, Any]) -> Any:
    fields = dataclasses.fields(kind)
    known = {f.name for f in fields}
    needed = {f.name for f in fields if f.default is dataclasses.MISSING and f.default_factory is dataclasses.MISSING}
    if unknown := sorted(set(values) - known):
        raise ValueError(f"{section}: unknown {', '.join(unknown)}; known are {', '.join(sorted(known))}")
    if missing := sorted(needed - set(values)):
        raise ValueError(f"{section}: {', '.join(missing)} missing")
    for name, value in values.items():
        numbers = value if isinstance(value, tuple) else (value,)
        if name not in ("curve", "port") and not all(type(n) in (int, float) for n in numbers):
            raise ValueError(f"{section}: {name} must be a number, not {value!r}")
    return kind(**values)
