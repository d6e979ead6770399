"""The shock file (shock.json): one law with its parameters, the conditions of its measurement, and its origin."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from math import inf
from pathlib import Path
from typing import Any

from eightpost import __version__
from eightpost.display import Summarized, Summary, some
from eightpost.errors import FileFormatError, ParameterError
from eightpost.files import MALFORMED, atomic_path, check_schema, json_content
from eightpost.shock.at_setting import band_section, force_half_width, setting_reasons, setting_text
from eightpost.shock.curve import StaticCurve
from eightpost.shock.law import ShockLaw
from eightpost.shock.laws import FORMER, LAWS, law_name, law_title, own_parameters, parameter_units
from eightpost.shock.port import Port
from eightpost.shock.settings import TEMPERATURE, Axis, Settings, Term, setting_of
from eightpost.validity import Validity, judged
from eightpost.verdict import Verdict

SCHEMA = 1


@dataclass(frozen=True, repr=False)
class Shock(Summarized):
    """A shock: a law, and what is known about its origin.

    Args:
        name: Display name of the build.
        law: Law with its parameters, in SI units.
        conditions: Conditions of the measurement: build, clicks and how they count, gas pressure, temperature range,
            offset, fitted velocity, stroke and frequency ranges. Free-form, JSON values; units in the keys.
        fit: Report of the fit: RMS, bounds, recipe. Free-form, JSON values. Left out if the verdict says that the
            shock was edited after it.
        inputs: Name and SHA-256 of each file that the shock was made from.
        validity: Verdict on the fit and the ranges that it covers; None if not stated. It is "unknown" if `numbers` are
            not those that were judged.
        settings: Effect of the adjusters and of the temperature; `law` is then the law at the reference setting. None:
            the shock was measured at one setting.
    """

    name: str
    law: ShockLaw
    conditions: Mapping[str, Any] = field(default_factory=dict)
    fit: Mapping[str, Any] = field(default_factory=dict)
    inputs: tuple[Mapping[str, str], ...] = ()
    validity: Validity | None = None
    settings: Settings | None = None

    def __post_init__(self) -> None:
        if self.settings is not None and not self.law.curve.has_knots:
            raise ValueError("settings: the curve must have knots, because a setting changes the slopes at them")
        if self.validity is not None:
            object.__setattr__(self, "validity", self.validity.checked(self.numbers, self.name))
            if self.validity.edits:
                object.__setattr__(self, "fit", {})

    @property
    def numbers(self) -> Mapping[str, Any]:
        """All that the verdict is about: law, conditions that are quantities, report of the fit, records, settings."""
        return {
            "law": self.law_name,
            "parameters": _stated(self.law),
            "conditions": {name: value for name, value in self.conditions.items() if name.endswith("]")},
            "fit": self.fit,
            "records": sorted(entry.get("sha256", "") for entry in self.inputs),
            "settings": _stated(self.settings),
        }

    def _summary(self) -> Summary:
        verdict = self.validity.verdict if self.validity else None
        axes = self.settings.axes if self.settings else ()
        return Summary.of(
            f"Shock {self.name}: {law_title(self.law_name)}",
            ("verdict", verdict.headline if verdict else "not stated"),
            ("reason", str(verdict.decisive[0]) if verdict and verdict.reasons else ""),
            ("parameters", some(_own_texts(self.law))),
            ("curve", _curve_text(self.law)),
            ("settings", ", ".join(axis.name for axis in axes)),
            ("ranges", some(f"{known.variable} {known}" for known in (self.validity.ranges if self.validity else ()))),
            ("made from", some(str(entry.get("name", "")) for entry in self.inputs)),
        )

    @property
    def law_name(self) -> str:
        """The law's name in files and on the command line."""
        return law_name(type(self.law))

    def at(self, *, clicks: Mapping[str, float] | None = None, temperature: float | None = None) -> Shock:
        """Return the shock at a setting: an ordinary law, with the verdict on the setting and the band of its curve.

        Args:
            clicks: Setting by name of the adjuster; others are at the reference.
            temperature: Temperature [K]; None: the reference.

        Raises:
            ParameterError: The shock has no such adjuster, or the setting is beyond the adjuster's stops.
        """
        if self.settings is None:
            raise ParameterError(
                f"shock {self.name!r} was measured at one setting; fit several with eightpost settings"
            )
        values = dict(clicks or {}) | ({} if temperature is None else {TEMPERATURE: temperature})
        try:
            setting = setting_of(self.settings, values)
        except ValueError as error:
            raise ParameterError(f"shock {self.name!r}: {error}") from error
        self._check_stops(self.settings, setting)
        law = self.settings.law_at(self.law, setting)
        half_width = force_half_width(self.settings, self.law, setting)
        where = setting_text(self.settings, setting)
        reasons = Verdict(setting_reasons(self.settings, setting, f"the settings of {self.name}"))
        level = self.fit.get("curve_band", {}).get("level", 0.95)
        return judged(
            self,
            name=f"{self.name}, {where}",
            law=law,
            conditions=dict(self.conditions) | {"clicks": where},
            fit=dict(self.fit) | {"curve_band": band_section(law, half_width, level)},
            validity=Validity.with_verdict(self.validity, reasons),
            settings=None,
        )

    def _check_stops(self, settings: Settings, setting: tuple[float, ...]) -> None:
        for axis, value in zip(settings.axes, setting, strict=True):
            low, high = (-inf if axis.lowest is None else axis.lowest), (inf if axis.highest is None else axis.highest)
            if not low <= value <= high:
                raise ParameterError(
                    f"shock {self.name!r}: {axis.name} = {value:g} is beyond the adjuster's stops, {low:g} to {high:g}"
                )


def _stated(value: Any) -> Any:
    """Return the fields without their defaults, also inside fields: a later version may have further fields."""
    if isinstance(value, tuple):
        return [_stated(one) for one in value]
    if not dataclasses.is_dataclass(value):
        return value
    known = ((field.name, getattr(value, field.name), field.default) for field in dataclasses.fields(value))
    return {name: _stated(one) for name, one, default in known if one != default}


def _own_texts(law: ShockLaw) -> Iterator[str]:
    """Yield the law's own parameters that are single numbers, as text with the unit."""
    units = parameter_units(type(law))
    for name in own_parameters(type(law)):
        value = getattr(law, name)
        if isinstance(value, int | float) and not isinstance(value, bool):
            yield f"{name} {value:.4g} {units.get(name, '')}".rstrip()


#: Velocity at which a summary states both forces [m/s].
_SHOWN = 0.1


def _curve_text(law: ShockLaw) -> str:
    compression, rebound = (law.curve.force(sign * _SHOWN) for sign in (1.0, -1.0))
    return f"{compression:.4g} N and {rebound:.4g} N at {_SHOWN:g} m/s in compression and rebound"


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
    if shock.settings is not None:
        document["settings"] = dataclasses.asdict(shock.settings)
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
        ParameterError: A parameter is missing, unknown or out of range, or the law is a former one; the message names
            file and parameter.
    """
    document = _read_document(Path(path))
    if document.get("law") in FORMER:
        raise ParameterError(_no_longer_supported(document, Path(path)))
    law_class = LAWS.get(str(document.get("law")))
    if law_class is None:
        raise ParameterError(f"{path}: law is {document.get('law')!r}; it must be one of {', '.join(LAWS)}")
    try:
        curve = _build(StaticCurve, "curve", document)
        port = _build(Port, "port", document)
        parameters = {**_section(document, "parameters"), "curve": curve, "port": port}
        law = _construct(law_class, "parameters", parameters)
        validity = Validity.from_json(document["validity"]) if "validity" in document else None
        settings = _settings(document) if "settings" in document else None
        if settings is not None:
            settings.law_at(law, settings.reference)
    except MALFORMED as error:
        raise ParameterError(f"{path}: {error}") from error
    shock = Shock(
        name=str(document.get("name") or Path(path).stem),
        law=law,
        conditions=_table(document, "conditions", Path(path)),
        fit=_table(document, "fit", Path(path)),
        inputs=_inputs(document, Path(path)),
        settings=settings,
    )
    return shock if validity is None else replace(shock, validity=validity.checked(shock.numbers, Path(path).name))


def _no_longer_supported(document: dict[str, Any], path: Path) -> str:
    """Return what is wrong with a file of a former law, and the command that fits its records again."""
    records = " ".join(entry["name"] for entry in _inputs(document, path) if "name" in entry) or "RECORD"
    command = "settings TABLE" if "settings" in document else f"fit {records}"
    return (
        f"{path}: the law {law_title(document['law'])} is no longer supported; fit the record again: "
        f"eightpost {command} -o {path}"
    )


def _settings(document: dict[str, Any]) -> Settings:
    """Return the settings of a document; ValueError if an entry is missing, unknown or wrong."""
    section = _section(document, "settings")
    axes = tuple(_construct_axis(entry) for entry in _entries(section, "axes"))
    terms = tuple(_construct_term(entry) for entry in _entries(section, "terms"))
    return Settings(
        axes=axes,
        parameters=tuple(str(name) for name in section.get("parameters", ())),
        terms=terms,
        tested=_rows(section, "tested"),
        half_width=_rows(section, "half_width"),
    )


def _entries(section: dict[str, Any], name: str) -> tuple[dict[str, Any], ...]:
    entries = section.get(name, ())
    if not isinstance(entries, tuple) or not all(isinstance(entry, dict) for entry in entries):
        raise ValueError(f"settings: {name} must be a list of objects, not {entries!r}")
    return entries


def _construct_axis(entry: dict[str, Any]) -> Axis:
    texts = {name: entry[name] for name in ("name", "unit", "counted") if name in entry}
    if not all(isinstance(text, str) for text in texts.values()):
        raise ValueError(f"settings: name, unit and counted of an axis must be texts, not {texts!r}")
    stops = {name: entry.get(name) for name in ("lowest", "highest")}
    for name, value in stops.items():
        if value is not None and type(value) not in (int, float):
            raise ValueError(f"settings: {name} must be a number, not {value!r}")
    (nodes,) = _rows({"nodes": (entry.get("nodes", ()),)}, "nodes")
    reference = _rows({"reference": ((entry.get("reference"),),)}, "reference")[0][0]
    return Axis(nodes=nodes, reference=reference, lowest=stops["lowest"], highest=stops["highest"], **texts)


def _construct_term(entry: dict[str, Any]) -> Term:
    return Term(tuple(str(name) for name in entry.get("axes", ())), _rows(entry, "deviations"))


def _rows(section: dict[str, Any], name: str) -> tuple[tuple[float, ...], ...]:
    """Return rows of numbers; ValueError if they are something else."""
    rows = section.get(name, ())
    if not isinstance(rows, (list, tuple)) or not all(isinstance(row, (list, tuple)) for row in rows):
        raise ValueError(f"settings: {name} must be rows of numbers")
    if not all(type(value) in (int, float) for row in rows for value in row):
        raise ValueError(f"settings: {name} must contain numbers only")
    return tuple(tuple(float(value) for value in row) for row in rows)


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
