"""Rules for ModelVariables and UnitDefinitions."""

from __future__ import annotations

import math
from collections import Counter, defaultdict
from collections.abc import Iterator, Mapping

from builder.check.catalogue import static as rules
from builder.check.description import Description, Unit, Variable
from builder.check.rules import Finding, listed
from eightpost import units
from eightpost.errors import UnknownUnitError

# ---- Names, value references, causalities, start values -------------------------------------------------------------

_VARIABILITIES = {
    "parameter": ("fixed", "tunable"),
    "calculatedParameter": ("fixed", "tunable"),
    "structuralParameter": ("fixed", "tunable"),
    "input": ("discrete", "continuous"),
    "output": ("constant", "discrete", "continuous"),
    "local": ("constant", "fixed", "tunable", "discrete", "continuous"),
    "independent": ("continuous",),
}
_CALCULATED = ("calculated", "approx")
_BOOLEANS = ("true", "false", "0", "1")


def _initials(variable: Variable) -> tuple[str, ...]:
    """Return the allowed values of `initial`."""
    if variable.causality in ("parameter", "structuralParameter") or variable.variability == "constant":
        return ("exact",)
    if variable.causality == "calculatedParameter" or variable.variability in ("fixed", "tunable"):
        return _CALCULATED
    return ("exact", *_CALCULATED)


def _names(description: Description) -> Iterator[Finding]:
    """Check that names are unique, those of aliases included."""
    names = [v.name for v in description.variables] + [name for own in description.aliases.values() for name in own]
    doubled = [name for name, count in Counter(names).items() if count > 1]
    if doubled:
        yield rules.NAMES.finding(f"several variables are named {listed(doubled)}")


def _aliases(description: Description) -> Iterator[Finding]:
    """Check that variables with the same value reference are consistent; FMI 3.0 allows only one."""
    if description.fmi == 3:
        counts = Counter(v.reference for v in description.variables)
        if doubled := [v.name for v in description.variables if counts[v.reference] > 1]:
            yield rules.ALIASES.finding(f"{listed(doubled)}: each variable needs its own; use elements Alias")
        return
    sets: dict[tuple[str, str], list[Variable]] = defaultdict(list)
    for variable in description.variables:
        kind = "Integer" if variable.type == "Enumeration" else variable.type
        sets[kind, variable.reference].append(variable)
    for (kind, reference), same in sets.items():
        if len(same) > 1 and (why := _disagreement(same)):
            yield rules.ALIASES.finding(f"{kind} {reference}: {listed([v.name for v in same])} {why}")


def _disagreement(same: list[Variable]) -> str:
    if len({v.unit for v in same}) > 1:
        return "have different units"
    if sum(v.is_settable_at_start for v in same) > 1:
        return "can all be set"
    starts = [v for v in same if v.start is not None and v.variability != "constant"]
    return "have several start values" if len(starts) > 1 else ""


def _combinations(description: Description) -> Iterator[Finding]:
    """Check that causality, variability and initial are a valid combination."""
    for v in description.variables:
        if v.variability not in _VARIABILITIES.get(v.causality, ()):
            yield rules.COMBINATION.finding(f"{v.name}: causality {v.causality} with variability {v.variability}")
        elif v.causality not in ("input", "independent") and v.initial is not None and v.initial not in _initials(v):
            yield rules.COMBINATION.finding(f"{v.name}: initial {v.initial} on a {v.variability} {v.causality}")


def _initial_on_inputs(description: Description) -> Iterator[Finding]:
    """Check that inputs and time have no `initial`; FMI 3.0 allows it for inputs."""
    causalities = ("input", "independent") if description.fmi == 2 else ("independent",)
    wrong = [v.name for v in description.variables if v.causality in causalities and v.initial]
    if wrong:
        yield rules.INITIAL_INPUT.finding(f"present on {listed(wrong)}")


def _continuous(description: Description) -> Iterator[Finding]:
    """Check that only Reals are continuous."""
    wrong = [v.name for v in description.variables if v.type != "Real" and v.variability == "continuous"]
    if wrong:
        yield rules.CONTINUOUS.finding(f"continuous but not Real: {listed(wrong)}")


def _start_presence(description: Description) -> Iterator[Finding]:
    """Check that start values are present exactly if they are required or allowed."""
    missing, surplus = [], []
    for v in description.variables:
        if v.type in ("Clock", "Binary"):  # clocks have no start value, that of a binary is optional
            continue
        if v.causality == "independent" or v.effective_initial == "calculated":
            surplus += [v.name] if v.start is not None else []
        elif v.start is None and (v.causality == "input" or v.effective_initial in ("exact", "approx")):
            missing.append(v.name)
    if missing:
        yield rules.START_MISSING.finding(f"missing on {listed(missing)}")
    if surplus:
        yield rules.START_FORBIDDEN.finding(f"present on {listed(surplus)}")


def _values(description: Description) -> Iterator[Finding]:
    """Check that start, min, max and nominal are valid values of their type."""
    for v in description.variables:
        for attribute in ("start", "min", "max", "nominal"):
            if attribute in v.attributes and not _is_value(v, v.attributes[attribute]):
                yield rules.START_VALUE.finding(f"{v.name}: {attribute} is {v.attributes[attribute]!r}")


def _is_value(variable: Variable, text: str) -> bool:
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
    if native == "Enumeration":
        return -(2**63), 2**63
    bits = int(native.partition("Int")[2] or 32)
    return (0, 2**bits) if native.startswith("U") else (-(2 ** (bits - 1)), 2 ** (bits - 1))


def _nominals(description: Description) -> Iterator[Finding]:
    """Check that nominal values are positive."""
    stated = ((v, v.number("nominal")) for v in description.variables)
    wrong = [f"{v.name} has {value:g}" for v, value in stated if value is not None and value <= 0.0]
    if wrong:
        yield rules.NOMINAL.finding(listed(wrong))


def _ranges(description: Description) -> Iterator[Finding]:
    """Check that min <= start <= max."""
    for v in description.variables:
        low, start, high = (v.number(name) for name in ("min", "start", "max"))
        known = [value for value in (low, start, high) if value is not None]
        if known != sorted(known):
            yield rules.START_RANGE.finding(f"{v.name}: min {low}, start {start}, max {high}")


def _declared_types(description: Description) -> Iterator[Finding]:
    """Check that declared types exist and match the variable's type."""
    for v in description.variables:
        declared = v.attributes.get("declaredType")
        if declared is None:
            continue
        kind = description.types.get(declared)
        if kind is None:
            yield rules.DECLARED_TYPE.finding(f"{v.name} is of type {declared!r}, which is not declared")
        elif kind[0] != (v.native or v.type):
            yield rules.DECLARED_TYPE.finding(
                f"{v.name} is {v.native or v.type}, but its declared type {declared!r} is {kind[0]}"
            )


def _independent(description: Description) -> Iterator[Finding]:
    """Check that at most one variable is independent; in FMI 3.0, exactly one."""
    times = [v.name for v in description.variables if v.causality == "independent"]
    if len(times) > 1:
        yield rules.INDEPENDENT.finding(f"independent variables: {listed(times)}")
    elif not times and description.fmi == 3:
        yield rules.INDEPENDENT.finding("the time variable is missing, which FMI 3.0 needs")


def _descriptions(description: Description) -> Iterator[Finding]:
    """Check that inputs, outputs and parameters have descriptions."""
    seen = ("input", "output", "parameter")
    bare = [v.name for v in description.variables if v.causality in seen and not v.description.strip()]
    if bare:
        yield rules.DESCRIPTIONS.finding(f"without a description: {listed(bare)}")


VARIABLE_RULES = (
    _names, _aliases, _combinations, _initial_on_inputs, _continuous, _start_presence, _values, _nominals, _ranges,
    _declared_types, _independent, _descriptions,
)  # fmt: skip


# ---- Units, compared with the meaning of their names ----------------------------------------------------------------

_BASE = ("kg", "m", "s", "A", "K", "mol", "cd", "rad")

#: Names with two meanings, both of which are accepted: SI exponents, factor, offset.
_AMBIGUOUS: Mapping[str, tuple[tuple[Mapping[str, int], float, float], ...]] = {
    "g": (({"m": 1, "s": -2}, 9.80665, 0.0), ({"kg": 1}, 1e-3, 0.0)),
    "lb": (({"kg": 1, "m": 1, "s": -2}, 4.4482216152605, 0.0), ({"kg": 1}, 0.45359237, 0.0)),
}
#: Names that have a different meaning in this project's file headers than in FMUs.
_UNKNOWN = {"C", "F", "c", "f", "h", "min", "-", "#", "gs"}

_TOLERANCE = 1e-6


def _defined(description: Description) -> Iterator[Finding]:
    """Check that all used units are defined."""
    displays = {unit.name: {display.get("name") for display in unit.displays} for unit in description.units}
    for v in description.variables:
        display = v.attributes.get("displayUnit")
        if v.unit is not None and v.unit not in displays:
            yield rules.UNIT_DEFINED.finding(f"{v.name} is in {v.unit!r}, which is not defined")
        elif display is not None and v.unit is None:
            yield rules.UNIT_DEFINED.finding(f"{v.name} has the display unit {display!r} but no unit")
        elif display is not None and display != v.unit and display not in displays[v.unit or ""]:
            yield rules.UNIT_DEFINED.finding(
                f"{v.name} has the display unit {display!r}, which is not a display unit of {v.unit!r}"
            )


def _unique(description: Description) -> Iterator[Finding]:
    """Check that units and display units are defined once."""
    doubled = [name for name, count in Counter(unit.name for unit in description.units).items() if count > 1]
    for unit in description.units:
        names = Counter(display.get("name", "") for display in unit.displays)
        doubled += [f"{name} of {unit.name}" for name, count in names.items() if count > 1]
    if doubled:
        yield rules.UNIT_TWICE.finding(f"defined twice: {listed(doubled)}")


def _given(description: Description) -> Iterator[Finding]:
    """Check that every Real has a unit, except the time that FMI 3.0 demands: nothing is connected to it."""
    reals = [v for v in description.variables if v.type == "Real"]
    bare = [v.name for v in reals if not v.unit and (description.fmi == 2 or v.causality != "independent")]
    if bare:
        yield rules.UNIT_MISSING.finding(f"without a unit: {listed(bare)}")


def _based(description: Description) -> Iterator[Finding]:
    """Check that every unit has a BaseUnit."""
    bare = [unit.name for unit in description.units if unit.base is None]
    if bare:
        yield rules.UNIT_BASE.finding(f"without a BaseUnit: {listed(bare)}")


def _exponents(description: Description) -> Iterator[Finding]:
    """Check that SI exponents, factor and offset match the unit's name."""
    for unit in description.units:
        known = list(_meanings(unit.name))
        if unit.base is None or not known:
            continue
        stated = {base: _number(unit.base, base, 0.0) for base in _BASE}
        alike = [meaning for meaning in known if _same_dimension(stated, meaning[0])]
        if not alike:
            yield rules.UNIT_EXPONENTS.finding(
                f"{unit.name} is {_words(known[0][0])}, but its BaseUnit is {_words(stated)}"
            )
        elif not any(_same_scale(unit.base, factor, offset) for _, factor, offset in alike):
            _, factor, offset = alike[0]
            yield rules.UNIT_FACTOR.finding(
                f"one {unit.name} is {factor:.9g} SI units with offset {offset:g}, but its BaseUnit has the factor "
                f"{unit.base.get('factor', '1')} with offset {unit.base.get('offset', '0')}"
            )


def _displays(description: Description) -> Iterator[Finding]:
    """Check the factors and offsets of display units."""
    for unit in description.units:
        for display in unit.displays:
            yield from _display(unit, display)


def _display(unit: Unit, display: Mapping[str, str]) -> Iterator[Finding]:
    name = display.get("name", "")
    if not (list(_meanings(unit.name)) and list(_meanings(name))) or {unit.name, name} & _AMBIGUOUS.keys():
        return
    if not units.compatible(unit.name, name):
        yield rules.DISPLAY_FACTOR.finding(f"{unit.name} cannot be converted to {name}: the dimensions differ")
        return
    factor, offset = units.conversion(unit.name, name)
    if not _same_scale(display, factor, offset):
        yield rules.DISPLAY_FACTOR.finding(
            f"one {unit.name} is {factor:.9g} {name} with offset {offset:g}, but the factor is "
            f"{display.get('factor', '1')} with offset {display.get('offset', '0')}"
        )


def _meanings(name: str) -> Iterator[tuple[Mapping[str, int], float, float]]:
    """Yield SI exponents, factor and offset for each meaning of a name; nothing for an unknown name."""
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
    plain = [base for base in _BASE if base != "rad"]
    if any(stated.get(base, 0) != meant.get(base, 0) for base in plain):
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


UNIT_RULES = (_defined, _unique, _given, _based, _exponents, _displays)
