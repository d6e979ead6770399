"""Rules for ModelVariables and UnitDefinitions."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Mapping

from builder.check.rules import Faults, listed, some
from builder.check.static.description import doubled
from eightpost import units
from eightpost.errors import UnknownUnitError
from eightpost.fmi.description import Description, Unit, Variable

# ---- Names, value references, causalities, start values -------------------------------------------------------------

_VARIABILITIES = {
    **dict.fromkeys(("parameter", "calculatedParameter", "structuralParameter"), ("fixed", "tunable")),
    "input": ("discrete", "continuous"),
    "output": ("constant", "discrete", "continuous"),
    "local": ("constant", "fixed", "tunable", "discrete", "continuous"),
    "independent": ("continuous",),
}
_CALCULATED = ("calculated", "approx")
_BOOLEANS = ("true", "false", "0", "1")


def variables(fmu: Description) -> Faults:
    """Yield faults of names, references, causalities, types and start values."""
    every = fmu.variables
    names = [v.name for v in every] + [alias.get("name", "") for v in every for alias in v.aliases]
    yield "variable-unique", some(doubled(names), "several variables are named ")
    yield from _aliases(fmu)
    for v in every:
        if v.variability not in _VARIABILITIES.get(v.causality, ()):
            yield "variable-combination", f"{v.name}: causality {v.causality} with variability {v.variability}"
        elif v.causality not in ("input", "independent") and v.initial is not None and v.initial not in _initials(v):
            yield "variable-combination", f"{v.name}: initial {v.initial} on a {v.variability} {v.causality}"
    no_initial = ("input", "independent") if fmu.fmi == 2 else ("independent",)  # FMI 3.0 allows it for inputs
    yield "initial-on-input", some((v.name for v in every if v.causality in no_initial and v.initial), "present on ")
    continuous = (v.name for v in every if v.type != "Real" and v.variability == "continuous")
    yield "continuous-real", some(continuous, "continuous but not Real: ")
    yield from _start_presence(fmu)
    for v in every:
        for name in ("start", "min", "max", "nominal"):
            if name in v.attributes and not _is_value(v, v.attributes[name]):
                yield "start-value", f"{v.name}: {name} is {v.attributes[name]!r}"
    nominals = ((v, v.number("nominal")) for v in every)
    yield "nominal", some(f"{v.name} has {value:g}" for v, value in nominals if value is not None and value <= 0.0)
    for v in every:
        limits = low, start, high = v.number("min"), v.number("start"), v.number("max")
        known = [value for value in limits if value is not None]
        if known != sorted(known):
            yield "start-range", f"{v.name}: min {low}, start {start}, max {high}"
    for v in every:
        yield "declared-type", _fault_of_type(fmu, v)
    times = [v.name for v in every if v.causality == "independent"]
    if len(times) > 1:
        yield "independent", f"independent variables: {listed(times)}"
    elif not times and fmu.fmi == 3:
        yield "independent", "the time variable is missing, which FMI 3.0 needs"
    shown = (v for v in every if v.causality in ("input", "output", "parameter"))
    yield "variable-description", some((v.name for v in shown if not v.description.strip()), "without a description: ")


def _initials(variable: Variable) -> tuple[str, ...]:
    """Return the allowed values of `initial`."""
    if variable.causality in ("parameter", "structuralParameter") or variable.variability == "constant":
        return ("exact",)
    if variable.causality == "calculatedParameter" or variable.variability in ("fixed", "tunable"):
        return _CALCULATED
    return ("exact", *_CALCULATED)


def _aliases(fmu: Description) -> Faults:
    """Compare variables with the same value reference; FMI 3.0 allows only one."""
    if fmu.fmi == 3:
        counts = Counter(v.reference for v in fmu.variables)
        shared = (v.name for v in fmu.variables if counts[v.reference] > 1)
        yield "alias-set", some(shared, after=": each variable needs its own; use elements Alias")
        return
    sets: dict[tuple[str, str], list[Variable]] = {}
    for v in fmu.variables:
        sets.setdefault(("Integer" if v.type == "Enumeration" else v.type, v.reference), []).append(v)
    for (kind, reference), same in sets.items():
        if len(same) > 1 and (why := _disagreement(same)):
            yield "alias-set", f"{kind} {reference}: {listed([v.name for v in same])} {why}"


def _disagreement(same: list[Variable]) -> str:
    if len({v.unit for v in same}) > 1:
        return "have different units"
    if sum(v.is_settable_at_start for v in same) > 1:
        return "can all be set"
    starts = [v for v in same if v.start is not None and v.variability != "constant"]
    return "have several start values" if len(starts) > 1 else ""


def _start_presence(fmu: Description) -> Faults:
    missing, surplus = [], []
    for v in fmu.variables:
        if v.type in ("Clock", "Binary"):  # clocks have no start value, that of a binary is optional
            continue
        if v.causality == "independent" or v.effective_initial == "calculated":
            surplus += [v.name] if v.start is not None else []
        elif v.start is None and (v.causality == "input" or v.effective_initial in ("exact", "approx")):
            missing.append(v.name)
    yield "start-required", some(missing, "missing on ")
    yield "start-forbidden", some(surplus, "present on ")


def _is_value(variable: Variable, text: str) -> bool:
    """Return whether a text is a finite value of a variable's type, or a list of them for an array."""
    if variable.is_array:
        return all(_is_scalar(variable, part) for part in text.split())
    return _is_scalar(variable, text)


def _is_scalar(variable: Variable, text: str) -> bool:
    if variable.type == "Boolean":
        return text.strip() in _BOOLEANS
    try:
        if variable.type == "Real":
            return math.isfinite(float(text))
        if variable.type in ("Integer", "Enumeration"):
            low, high = _integers(variable.native)
            return low <= int(text) < high
    except ValueError:
        return False
    return True


def _integers(native: str) -> tuple[int, int]:
    """Return the range of an integer type: the first value, and the first one beyond its end."""
    bits = 64 if native == "Enumeration" else int(native.partition("Int")[2] or 32)
    return (0, 2**bits) if native.startswith("U") else (-(2 ** (bits - 1)), 2 ** (bits - 1))


def _fault_of_type(fmu: Description, v: Variable) -> str:
    declared = v.attributes.get("declaredType")
    if declared is None:
        return ""
    if declared not in fmu.types:
        return f"{v.name} is of type {declared!r}, which is not declared"
    kind, own = fmu.types[declared][0], v.native or v.type
    return "" if kind == own else f"{v.name} is {own}, but its declared type {declared!r} is {kind}"


# ---- Units, compared with the meaning of their names ----------------------------------------------------------------

_BASE = ("kg", "m", "s", "A", "K", "mol", "cd", "rad")

#: SI exponents, factor and offset of a unit.
_Meaning = tuple[Mapping[str, int], float, float]

#: Names with two meanings, both of which are accepted.
_AMBIGUOUS: Mapping[str, tuple[_Meaning, ...]] = {
    "g": (({"m": 1, "s": -2}, 9.80665, 0.0), ({"kg": 1}, 1e-3, 0.0)),
    "lb": (({"kg": 1, "m": 1, "s": -2}, 4.4482216152605, 0.0), ({"kg": 1}, 0.45359237, 0.0)),
}
#: Names that have a different meaning in this project's file headers than in FMUs.
_UNKNOWN = {"C", "F", "c", "f", "h", "min", "-", "#", "gs"}

_TOLERANCE = 1e-6


def units_of(fmu: Description) -> Faults:
    """Yield faults of units and display units; those of names with a known meaning are compared with it."""
    displays = {unit.name: {display.get("name") for display in unit.displays} for unit in fmu.units}
    for v in fmu.variables:
        display = v.attributes.get("displayUnit")
        if v.unit is not None and v.unit not in displays:
            yield "unit-defined", f"{v.name} is in {v.unit!r}, which is not defined"
        elif display is not None and v.unit is None:
            yield "unit-defined", f"{v.name} has the display unit {display!r} but no unit"
        elif display is not None and display != v.unit and display not in displays[v.unit or ""]:
            what = f"the display unit {display!r}, which is not a display unit of {v.unit!r}"
            yield "unit-defined", f"{v.name} has {what}"
    twice = doubled(unit.name for unit in fmu.units)
    for unit in fmu.units:
        twice += [f"{name} of {unit.name}" for name in doubled(display.get("name", "") for display in unit.displays)]
    yield "unit-unique", some(twice, "defined twice: ")
    reals = (v for v in fmu.variables if v.type == "Real" and not v.unit)
    bare = (v.name for v in reals if fmu.fmi == 2 or v.causality != "independent")  # nothing is connected to time
    yield "unit-missing", some(bare, "without a unit: ")
    yield "unit-base", some((unit.name for unit in fmu.units if unit.base is None), "without a BaseUnit: ")
    for unit in fmu.units:
        yield from _base_unit(unit)
    for unit in fmu.units:
        for stated in unit.displays:
            yield "display-factor", _fault_of_display(unit.name, stated)


def _base_unit(unit: Unit) -> Faults:
    known = list(_meanings(unit.name))
    if unit.base is None or not known:
        return
    stated = {base: _number(unit.base, base, 0.0) for base in _BASE}
    alike = [meaning for meaning in known if _same_dimension(stated, meaning[0])]
    if not alike:
        yield "unit-exponents", f"{unit.name} is {_words(known[0][0])}, but its BaseUnit is {_words(stated)}"
    elif not any(_same_scale(unit.base, factor, offset) for _, factor, offset in alike):
        _, factor, offset = alike[0]
        own = f"the factor {unit.base.get('factor', '1')} with offset {unit.base.get('offset', '0')}"
        what = f"one {unit.name} is {factor:.9g} SI units with offset {offset:g}"
        yield "unit-factor", f"{what}, but its BaseUnit has {own}"


def _fault_of_display(unit: str, display: Mapping[str, str]) -> str:
    name = display.get("name", "")
    if not (list(_meanings(unit)) and list(_meanings(name))) or {unit, name} & _AMBIGUOUS.keys():
        return ""
    if not units.compatible(unit, name):
        return f"{unit} cannot be converted to {name}: the dimensions differ"
    factor, offset = units.conversion(unit, name)
    if _same_scale(display, factor, offset):
        return ""
    own = f"the factor is {display.get('factor', '1')} with offset {display.get('offset', '0')}"
    return f"one {unit} is {factor:.9g} {name} with offset {offset:g}, but {own}"


def _meanings(name: str) -> Iterator[_Meaning]:
    """Yield the meanings of a name; nothing for an unknown name."""
    if name in _AMBIGUOUS:
        yield from _AMBIGUOUS[name]
    elif name and name not in _UNKNOWN and units.is_unit(name):
        try:
            si = units.si_exponents(name)
            factor, offset = units.conversion(name, "K") if si == {"K": 1} else (units.si_factor(name), 0.0)
        except UnknownUnitError:
            return
        yield si, factor, offset


def _same_dimension(stated: Mapping[str, float], meant: Mapping[str, float]) -> bool:
    """Compare exponents; the radian only counts in rad and rad/s, because tools differ for units such as N.m/rad."""
    if any(stated.get(base, 0) != meant.get(base, 0) for base in _BASE if base != "rad"):
        return False
    return "rad" not in meant or bool(meant.keys() - {"rad", "s"}) or stated["rad"] == meant["rad"]


def _same_scale(stated: Mapping[str, str], factor: float, offset: float) -> bool:
    return math.isclose(_number(stated, "factor", 1.0), factor, rel_tol=_TOLERANCE) and math.isclose(
        _number(stated, "offset", 0.0), offset, rel_tol=_TOLERANCE, abs_tol=1e-9
    )


def _number(attributes: Mapping[str, str], name: str, default: float) -> float:
    try:
        return float(attributes.get(name, default))
    except ValueError:
        return math.nan


def _words(si: Mapping[str, float]) -> str:
    return " ".join(f"{base}^{power:g}" for base, power in si.items() if power) or "dimensionless"
