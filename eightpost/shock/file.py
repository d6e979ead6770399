"""The shock file (shock.json): one law, its measurement and origin, its band at a setting, its uncertainty."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import inf
from pathlib import Path
from statistics import NormalDist
from typing import TYPE_CHECKING, Any

from eightpost import __version__
from eightpost.display import Summarized, Summary, some
from eightpost.errors import ParameterError
from eightpost.files import MALFORMED, atomic_path, json_content
from eightpost.shock.curve import KNOTS
from eightpost.shock.law import ShockLaw
from eightpost.shock.laws import FORMER, LAWS, law_name, law_title, named_law, own_parameters, parameter_units
from eightpost.shock.settings import TEMPERATURE, Axis, Settings, is_tested, setting_of
from eightpost.validity import ModelUncertainty, ParameterUncertainty, Validity, judged
from eightpost.verdict import Reason, Rules, Verdict

if TYPE_CHECKING:
    from eightpost.array_types import Array
    from eightpost.uncertainty import LeftOutBlocks

# ---- The verdict on a setting ---------------------------------------------------------------------------------------

ABOUT = "setting"  #: Subject of the reasons.
#: Distance beyond the measured settings, in intervals between them, up to which the continuation can be used.
FARTHEST = 1.0

RULES = Rules.read(Path(__file__).with_suffix(".txt"), ABOUT, farthest=FARTHEST)


def _setting_reasons(settings: Settings, setting: Sequence[float], origin: str) -> Iterator[Reason]:
    """Yield the reasons of a verdict on a setting (a value per axis)."""
    where = setting_text(settings, setting)
    outside = [(axis, value) for axis, value in zip(settings.axes, setting, strict=True) if axis.beyond(value)]
    for axis, value in outside:
        is_far = axis.intervals_beyond(value) > FARTHEST
        rule = "far beyond the measured settings" if is_far else "beyond the measured settings"
        figure = f"{axis.name} {value:g}; measured {axis.nodes[0]:g} to {axis.nodes[-1]:g} {axis.unit}"
        yield RULES.reason(rule, "the setting is beyond the measured ones", figure, origin)
    if not is_tested(settings, setting):
        statement = "this combination of settings was not measured"
        yield RULES.reason("untested combination of settings", statement, where, origin)
    elif not outside:
        yield RULES.reason("within the measured settings", "the setting is within the measured ones", where, origin)


def setting_text(settings: Settings, setting: Sequence[float]) -> str:
    """Return a setting as text, such as `rebound 12, temperature 313 K`."""
    parts = []
    for axis, value in zip(settings.axes, setting, strict=True):
        unit = "" if axis.unit in ("click", "1", "") else f" {axis.unit}"
        parts.append(f"{axis.name} {value:.4g}{unit}")
    return ", ".join(parts)


# ---- The band of the curve ------------------------------------------------------------------------------------------

#: Error of the interpolation in the middle between two settings, as a multiple of the error with which a straight line
#: between its neighbours predicts a measured setting (the larger of the two). Calibrated on random shocks so that the
#: band covers 95 % (docs/how_to/settings.md).
_CURVATURE = 0.5
#: The same as a share of the difference between the two curves; it counts alone where there are only two settings.
_DIFFERENCE = 0.02
_DIFFERENCE_OF_TWO = 0.3
_INTERACTION = 0.5  #: Half-width for an untested combination, as a share of the smaller effects of its adjusters.


def force_half_width(settings: Settings, law: ShockLaw, setting: Sequence[float]) -> tuple[float, ...]:
    """Return the half-width of the 95 % band of the curve's force at the knots (25,) [N] at a setting.

    The band includes the scatter of the measurements, the error of the interpolation between settings, the growth of
    that error beyond the measured settings, and the unknown interaction of an untested combination.
    """
    import numpy as np  # noqa: PLC0415 -- help texts import the laws without it

    def force_at(number: int, value: float) -> Array:
        """Return the force at the knots (25,) [N] with one axis at a value and the others at their reference."""
        place = list(settings.reference)
        place[number] = value
        return np.array(settings.law_at(law, tuple(place)).curve.knot_force)

    squares, effects = np.zeros(KNOTS), []
    for number, (axis, value) in enumerate(zip(settings.axes, setting, strict=True)):
        if value == axis.reference and len(setting) > 1:
            continue
        curves = [force_at(number, node) for node in axis.nodes]
        squares += _interpolation_error(axis, curves, value) ** 2 + _scatter(settings, number, value) ** 2
        effects.append(np.abs(force_at(number, value) - law.curve.knot_force))
    if not effects:
        squares = _scatter(settings, 0, setting[0]) ** 2
    if len(effects) > 1 and not is_tested(settings, setting):
        squares += (_INTERACTION * np.sort(effects, axis=0)[:-1].sum(axis=0)) ** 2
    return tuple(np.sqrt(squares).tolist())


def _scatter(settings: Settings, number: int, value: float) -> Array:
    """Return the half-width (25,) [N] of the measurements next to a value of one axis, interpolated between them.

    At a measured setting it is that with the other axes at their reference, or else the largest there.
    """
    import numpy as np  # noqa: PLC0415 -- help texts import the laws without it

    rows = dict(zip(settings.tested, map(np.array, settings.half_width), strict=True))

    def half_width(node: float) -> Array:
        place = list(settings.reference)
        place[number] = node
        there = [row for at, row in rows.items() if at[number] == node]
        return rows[tuple(place)] if tuple(place) in rows else np.max(there or [*rows.values()], axis=0)

    near = settings.axes[number].neighbours(value)
    share = 0.0 if len(near) == 1 else (value - near[0]) / (near[1] - near[0])
    return (1.0 - share) * half_width(near[0]) + share * half_width(near[-1])


def _interpolation_error(axis: Axis, curves: Sequence[Array], value: float) -> Array:
    """Return the half-width (25,) [N] for the interpolation at a value of one axis, given the curves at its nodes."""
    import numpy as np  # noqa: PLC0415 -- help texts import the laws without it

    nodes = axis.nodes
    if value in nodes or len(nodes) == 1:
        return np.zeros(KNOTS)
    j = axis.interval(value)
    w = (value - nodes[j]) / (nodes[j + 1] - nodes[j])
    # Within the interval the error is like 4 w (1 - w); beyond, it grows with the distance.
    shape = 4.0 * w * (1.0 - w) if 0.0 <= w <= 1.0 else 4.0 * max(-w, w - 1.0) * (1.0 + max(-w, w - 1.0))
    bends = [np.zeros(KNOTS)]  # errors with which a straight line between its neighbours predicts a node
    for i in (i for i in (j, j + 1) if 0 < i < len(nodes) - 1):
        u = (nodes[i] - nodes[i - 1]) / (nodes[i + 1] - nodes[i - 1])
        bends.append(np.abs((1.0 - u) * curves[i - 1] + u * curves[i + 1] - curves[i]))
    share = _DIFFERENCE if len(bends) > 1 else _DIFFERENCE_OF_TWO
    error: Array = shape * (_CURVATURE * np.max(bends, axis=0) + share * np.abs(curves[j + 1] - curves[j]))
    return error


SCHEMA = 1


@dataclass(frozen=True, repr=False)
class Shock(Summarized):
    """A shock: a law, and what is known about its origin."""

    name: str  #: Display name of the build.
    law: ShockLaw  #: Law with its parameters, in SI units.
    #: Conditions of the measurement: build, clicks and how they count, gas pressure, temperature range, offset, fitted
    #: velocity, stroke and frequency ranges. Free-form, JSON values; units in the keys.
    conditions: Mapping[str, Any] = field(default_factory=dict)
    #: Report of the fit: RMS, bounds, recipe. Free-form, JSON values. Left out if the verdict says that the shock was
    #: edited after it.
    fit: Mapping[str, Any] = field(default_factory=dict)
    inputs: tuple[Mapping[str, str], ...] = ()  #: Name and SHA-256 of each file that the shock was made from.
    #: Verdict on the fit and the ranges that it covers; None if not stated. It is "unknown" if `numbers` are not those
    #: that were judged.
    validity: Validity | None = None
    #: Effect of the adjusters and of the temperature; `law` is then that at the reference setting. None: the shock was
    #: measured at one setting.
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
        from eightpost.units import shown_range  # noqa: PLC0415 -- numpy takes long to load, and help texts need the laws

        verdict = self.validity.verdict if self.validity else None
        axes = self.settings.axes if self.settings else ()
        ranges = (
            f"{known.kind if known.kind == 'frequency' else known.variable} "
            f"{shown_range(known.low, known.high, known.unit)}"
            for known in (self.validity.ranges if self.validity else ())
        )
        return Summary.of(
            f"Shock {self.name}: {law_title(self.law_name)}",
            ("verdict", verdict.headline if verdict else "not stated"),
            ("reason", str(verdict.decisive[0]) if verdict and verdict.reasons else ""),
            ("parameters", some(_own_texts(self.law))),
            ("curve", _curve_text(self.law)),
            ("settings", ", ".join(axis.name for axis in axes)),
            ("ranges", some(ranges)),
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
                f"shock {self.name!r} was measured at one setting; fit a table of several: eightpost fit TABLE.toml"
            )
        values = dict(clicks or {}) | ({} if temperature is None else {TEMPERATURE: temperature})
        try:
            setting = setting_of(self.settings, values)
        except ValueError as error:
            raise ParameterError(f"shock {self.name!r}: {error}") from error
        self._check_stops(self.settings, setting)
        law = self.settings.law_at(self.law, setting)
        where = setting_text(self.settings, setting)
        reasons = Verdict(_setting_reasons(self.settings, setting, f"the settings of {self.name}"))
        band = {
            "level": self.fit.get("curve_band", {}).get("level", 0.95),
            "velocity [m/s]": list(law.curve.knot_velocity),
            "force [N]": list(law.curve.knot_force),
            "half_width [N]": list(force_half_width(self.settings, self.law, setting)),
        }
        return judged(
            self,
            name=f"{self.name}, {where}",
            law=law,
            conditions=dict(self.conditions) | {"clicks": where},
            fit=dict(self.fit) | {"curve_band": band},
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
    from eightpost.units import shown  # noqa: PLC0415 -- numpy takes long to load, and help texts need the laws

    units = parameter_units(type(law))
    for name in own_parameters(type(law)):
        value = getattr(law, name)
        if isinstance(value, int | float) and not isinstance(value, bool):
            number, unit = shown(float(value), units.get(name, ""))
            yield f"{name} {number:.4g} {unit}".rstrip()


_SHOWN = 0.1  #: Velocity at which a summary states both forces [m/s].


def _curve_text(law: ShockLaw) -> str:
    from eightpost.units import shown  # noqa: PLC0415 -- numpy takes long to load, and help texts need the laws

    (compression, unit), (rebound, _) = (shown(law.curve.force(sign * _SHOWN), "N") for sign in (1.0, -1.0))
    speed, per = shown(_SHOWN, "m/s")
    return f"{compression:.4g} {unit} and {rebound:.4g} {unit} at {speed:.3g} {per} in compression and rebound"


def write_shock(shock: Shock, path: str | Path) -> None:
    """Write a shock file; an existing file is replaced only when the new one is complete."""
    curve = shock.law.curve
    values = dataclasses.asdict(curve)  # a curve without knots has no entries for them
    document = {
        "schema": SCHEMA,
        "kind": "shock",
        "tool": f"eightpost {__version__}",
        "name": shock.name,
        "law": shock.law_name,
        "parameters": {name: getattr(shock.law, name) for name in own_parameters(type(shock.law))},
        "curve": {name: value for name, value in values.items() if curve.has_knots or "knot_" not in name},
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


def read_shock(path: str | Path) -> Shock:
    """Read a shock file.

    Raises:
        FileFormatError: The file is not a shock file, or its schema is newer than this version supports.
        ParameterError: A parameter is missing, unknown or out of range, or the law is a former one; the message names
            file and parameter.
    """
    from eightpost.schema import checked, document_of  # noqa: PLC0415 -- help texts do not need it
    from eightpost.shock.sections import Sections  # noqa: PLC0415

    path = Path(path)
    document = json_content(path)
    document_of(Sections, document, path, "shock", SCHEMA, "make shock files with `eightpost fit`")
    try:
        conditions, fit, inputs = _sections(document)
        law = _law_of(document, inputs, path)
        settings = checked(Settings, document["settings"], place="settings") if "settings" in document else None
        if settings is not None:
            settings.law_at(law, settings.reference)
        validity = Validity.from_json(document["validity"]) if "validity" in document else None
    except MALFORMED as error:
        raise ParameterError(f"{path}: {error}") from error
    shock = Shock(str(document.get("name") or path.stem), law, conditions, fit, inputs, settings=settings)
    return shock if validity is None else replace(shock, validity=validity.checked(shock.numbers, path.name))


def _sections(document: dict[str, Any]) -> tuple[dict[str, Any], dict[str, Any], tuple[Mapping[str, str], ...]]:
    """Return conditions, report of the fit and records, whose entries have the types that other modules expect."""
    from eightpost.uncertainty import left_out_of  # noqa: PLC0415

    conditions, fit, inputs = document.get("conditions", {}), document.get("fit", {}), document.get("inputs", [])
    if len({len(column) for name, column in fit.get("curve_band", {}).items() if name.endswith("]")}) > 1:
        raise ValueError("fit.curve_band: its lists must have one length")
    left_out_of(fit)
    return conditions, fit, tuple(inputs)


def _law_of(document: dict[str, Any], inputs: Sequence[Mapping[str, str]], path: Path) -> ShockLaw:
    """Return the law of a file; the error for a former law names the command that fits its records again."""
    from eightpost.schema import checked  # noqa: PLC0415 -- help texts do not need it

    name, own = document["law"], document.get("parameters", {})
    if name in FORMER:
        records = " ".join(entry["name"] for entry in inputs if "name" in entry) or "RECORD"
        command = f"eightpost fit {'TABLE' if 'settings' in document else records} -o {path}"
        raise ValueError(f"the law {law_title(name)} is no longer supported; fit the record again: {command}")
    law = LAWS[named_law(name)]
    return checked(law, {**own, "curve": document.get("curve", {}), "port": document.get("port", {})})


@dataclass(frozen=True, slots=True, eq=False)
class _FittedParameters:
    """Parameters of a fitted shock's FMU that are not known exactly. n parameters."""

    names: tuple[str, ...]  #: Names of the parameters.
    values: Array  #: Fitted values (n,).
    covariance: Array  #: Covariance of the parameters (n, n), which are independent.
    lowest: Array  #: Lower limits (n,).
    highest: Array  #: Upper limits (n,).
    held: tuple[str, ...]  #: A sentence for each parameter that is kept constant.
    #: Changes of the parameters when blocks of the test are left out; None if the file does not state them.
    left_out: LeftOutBlocks | None = None


def fitted_parameters(shock: Shock) -> _FittedParameters | None:
    """Return the uncertainty that a shock states; None if it states none, because it was not fitted.

    The law's own parameters vary independently by their standard errors, within the fit's bounds. A parameter at a
    bound, or one that the record does not determine, is kept constant. The static curve varies by `compression_scale`
    and `rebound_scale`, whose intervals the fit derives from the covariance of the curve at the velocities of its
    records: errors at different velocities cancel as far as they are independent. A file without these intervals (a
    shock at a setting, or a fit of an earlier version) has the band alone, which is then taken to be fully correlated
    over all velocities of a side, weighted by force. This overstates the effect of the band on a measure.
    """
    import numpy as np  # noqa: PLC0415 -- help texts import the laws without it

    from eightpost.uncertainty import left_out_of  # noqa: PLC0415

    fitted, band = shock.fit.get("parameters"), shock.fit.get("curve_band")
    if not isinstance(fitted, dict) or not isinstance(band, dict):
        return None
    # A law's parameter, or one of its elements, such as tau[2].
    own = {n: fitted[n] for name in own_parameters(type(shock.law)) for n in fitted if n.partition("[")[0] == name}
    free = {name: entry for name, entry in own.items() if entry["standard_error"] and not entry["at_bound"]}
    held = tuple(
        f"{name} is kept at its fitted value: "
        + (
            f"the fit ended at its {entry['at_bound']} bound"
            if entry["at_bound"]
            else "the record does not determine it"
        )
        for name, entry in own.items()
        if name not in free
    )
    scales = dict(_scales(band))
    return _FittedParameters(
        (*free, *scales),
        np.array([*(entry["value"] for entry in free.values()), *(1.0 for _ in scales)]),
        np.diag([*(entry["standard_error"] ** 2 for entry in free.values()), *(d**2 for d in scales.values())]),
        np.array([*(_bound(entry, 0) for entry in free.values()), *(0.0 for _ in scales)]),
        np.array([*(_bound(entry, 1) for entry in free.values()), *(inf for _ in scales)]),
        held,
        left_out_of(shock.fit) if "factor_half_width" in band else None,
    )


def shock_uncertainty(shock: Shock) -> ModelUncertainty | None:
    """Return the same as parameters that an FMU states; None if the shock states no uncertainty or cannot be read.

    The standard deviation from one copy of the shock to another is that of the builds that were fitted together
    (`fit.between_builds`); without it, it is not known.
    """
    try:
        if (fit := fitted_parameters(shock)) is None:
            return None
        builds = shock.fit.get("between_builds") or {}
        copies = {name: float(entry["standard_deviation"]) for name, entry in builds.get("parameters", {}).items()}
        deviations = (fit.covariance.diagonal() ** 0.5).tolist()
        rows = zip(fit.names, deviations, fit.lowest.tolist(), fit.highest.tolist(), strict=True)
        parameters = tuple(ParameterUncertainty(n, d, copies.get(n), low, high) for n, d, low, high in rows)
        return ModelUncertainty(parameters=parameters, held=fit.held, left_out=fit.left_out)
    except MALFORMED:
        return None


def _bound(entry: dict[str, Any], side: int) -> float:
    bound = (entry["bounds"] or (None, None))[side]
    return float(bound) if bound is not None else (-inf, inf)[side]


def _scales(band: dict[str, Any]) -> Iterator[tuple[str, float]]:
    """Yield the standard deviation of each side's factor."""
    reach = NormalDist().inv_cdf(0.5 + 0.5 * band["level"])
    for name, half_width in (band.get("factor_half_width") or dict(_correlated(band))).items():
        yield name, float(half_width) / reach


def _correlated(band: dict[str, Any]) -> Iterator[tuple[str, float]]:
    """Yield the half-width of each side's factor if the whole band moves as one: RMS half-width over RMS force."""
    import numpy as np  # noqa: PLC0415 -- help texts import the laws without it

    velocity, force, half = (np.array(band[f"{name}"]) for name in ("velocity [m/s]", "force [N]", "half_width [N]"))
    for name, side in (("compression_scale", velocity > 0.0), ("rebound_scale", velocity < 0.0)):
        if side.any() and np.any(force[side]):
            yield name, float(np.sqrt(np.sum(half[side] ** 2) / np.sum(force[side] ** 2)))
