"""Generation of interface.h and interface.c: the variables of an FMU as C tables."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import groupby

from builder.fmu.interface import PORT_PARAMETERS, Interface, Variable
from builder.fmu.settings import BEYOND_SETTINGS

_SIGNALS = ("input", "output", "local")

#: Phases (fmus/common/component.h) in which a host may set a variable.
_SETTABLE = {
    ("input", "continuous"): "INSTANTIATED | INITIALIZING | STEPPING | EVENT | CONTINUOUS",
    ("parameter", "tunable"): "INSTANTIATED | INITIALIZING | STEPPING | EVENT",
    ("parameter", "fixed"): "INSTANTIATED | INITIALIZING",
}
_STATE_SETTABLE = "EVENT | CONTINUOUS"


#: Kinds whose outputs are computed when they are read, not in the step.
_COMPUTED_WHEN_ASKED = ("vehicle_ss", "assembly")

#: Arrays that model.c refers to even if a model has none of them.
_NEEDED = {"vehicle_ss": ("offset", *PORT_PARAMETERS)}


@dataclass(frozen=True, slots=True)
class _Member:
    """The member of the C struct that holds a variable: `name`, or `name[position]` of an array."""

    name: str
    position: int | None


def _shock_member(variable: Variable, _earlier: Sequence[_Member]) -> _Member:
    """Return the member for a shock's variable: curve.inner[2] is curve_inner[1]."""
    found = re.fullmatch(r"(.+?)(?:\[(\d+)\])?", variable.name)
    assert found is not None
    return _Member(found[1].replace(".", "_"), int(found[2]) - 1 if found[2] else None)


def _vehicle_member(variable: Variable, earlier: Sequence[_Member]) -> _Member:
    """Return the member for a vehicle's variable: inputs, outputs and each kind of parameter are arrays."""
    own = variable.name.rpartition(".")[2]
    name = variable.causality if variable.causality != "parameter" else own if own in PORT_PARAMETERS else "offset"
    return _Member(name, sum(member.name == name for member in earlier))


def _assembly_member(variable: Variable, earlier: Sequence[_Member]) -> _Member:
    """Return the member for an assembly's variable: all variables of a causality are one array."""
    return _Member(variable.causality, sum(member.name == variable.causality for member in earlier))


_PLACES = {"vehicle_ss": _vehicle_member, "assembly": _assembly_member}


@dataclass(frozen=True)
class Layout:
    """The storage of each variable: Reals in a struct, signals before parameters; Booleans in an array.

    Derivatives and a vehicle's modes are in no struct: the model computes or keeps them.
    """

    interface: Interface
    reals: tuple[tuple[Variable, _Member], ...]
    flags: tuple[Variable, ...]
    states: int

    def index(self, variable: Variable) -> int:
        """Return the variable's index in Values.at or in Memory.flag."""
        return [v.name for v in (self.flags if variable.type == "Boolean" else [v for v, _ in self.reals])].index(
            variable.name
        )

    def place(self, variable: Variable) -> str:
        """Return the variable's index as C text; continuous states and their derivatives have indices of their own."""
        if variable.name in self.interface.states:
            return f"FIRST_STATE + {self.interface.states.index(variable.name)}"
        if variable.derivative_of is not None:
            return f"FIRST_DERIVATIVE + {self.interface.derivatives.index(variable.name)}"
        return str(self.index(variable))

    def count(self, *causalities: str) -> int:
        """Return the number of Real variables of some causalities."""
        return sum(v.causality in causalities for v, _ in self.reals)


def layout(interface: Interface, states: int) -> Layout:
    """Return the storage layout of an interface; `states` is the size of the model's internal state."""
    order = (*_SIGNALS, "parameter")
    stored = (v for v in interface.variables if v.type == "Real" and not v.is_computed)
    reals = sorted(stored, key=lambda v: order.index(v.causality))
    place = _PLACES.get(interface.kind, _shock_member)
    members: list[_Member] = []
    for variable in reals:
        members.append(place(variable, members))
    flags = tuple(v for v in interface.variables if v.type == "Boolean")
    return Layout(interface, tuple(zip(reals, members, strict=True)), flags, states)


def c_number(value: float) -> str:
    """Return a C constant for exactly the same double, with up to 17 digits."""
    return repr(float(value))


def c_array(values: Iterable[float]) -> str:
    """Return a C initializer; it is never empty, because C99 does not allow that."""
    return "{" + (", ".join(map(c_number, values)) or "0.0") + "}"


def interface_header(plan: Layout, identifier: str, guid: str) -> str:
    """Return interface.h."""
    interface = plan.interface
    counts = {
        "INPUTS": plan.count("input"),
        "OUTPUTS": plan.count("output"),
        "SIGNALS": plan.count(*_SIGNALS),
        "REALS": len(plan.reals),
        "FLAGS": max(1, len(plan.flags)),
        "STATES": max(1, plan.states),
        "CONTINUOUS_STATES": len(interface.states),
        "REFERENCES": _references(interface.variables),
        "OUTPUTS_ARE_KEPT": int(interface.kind not in _COMPUTED_WHEN_ASKED),
    }
    lines = [
        f"/* {interface.kind} {interface.version}: generated from interface.toml; do not edit. */",
        "#ifndef EIGHTPOST_INTERFACE_H",
        "#define EIGHTPOST_INTERFACE_H",
        "",
        f'#define MODEL_IDENTIFIER "{identifier}"',
        f'#define MODEL_GUID "{{{guid}}}"',
        f"#define STATE_TAG UINT64_C({_digest(f'{{{guid}}}'):#x})",
        *(["#define SEVERAL_STATES"] if interface.kind.startswith("shock_") and len(interface.states) > 1 else []),
        *_setting_switches(interface),
        "",
        "enum {",
        *(f"    {name} = {value}," for name, value in counts.items()),
        "};",
        *([] if not plan.flags else ["", "enum { " + ", ".join(_flag_name(v) for v in plan.flags) + " };"]),
        "",
        *_struct("Signals", [m for v, m in plan.reals if v.causality in _SIGNALS]),
        "",
        *_struct(
            "Parameters", [m for v, m in plan.reals if v.causality == "parameter"], _NEEDED.get(interface.kind, ())
        ),
        "",
        "typedef union {",
        "    struct {",
        "        Signals signals;",
        "        Parameters parameters;",
        "    } named;",
        "    double at[REALS];",
        "} Values;",
        "",
        "#endif",
        "",
    ]
    return "\n".join(lines)


def _setting_switches(interface: Interface) -> list[str]:
    """Return the switches of a shock whose adjusters or temperature are variables (settings.h)."""
    if BEYOND_SETTINGS not in interface.names("local"):
        return []
    has_input = "temperature" in interface.names("input")
    return ["#define HAS_SETTINGS", *(["#define HAS_TEMPERATURE_INPUT"] if has_input else [])]


def _digest(text: str) -> int:
    """Return the FNV-1a hash of a text, 64 bits."""
    value = 14695981039346656037
    for byte in text.encode():
        value = (value ^ byte) * 1099511628211 % 2**64
    return value


def _references(variables: Iterable[Variable]) -> int:
    return max(v.reference for v in variables) + 1


def _flag_name(variable: Variable) -> str:
    return variable.name.replace(".", "_")


def _struct(name: str, members: Sequence[_Member], needed: Sequence[str] = ()) -> list[str]:
    lines = ["typedef struct {"]
    missing = [member for member in needed if member not in {m.name for m in members}]
    for base, group in groupby(members, key=lambda member: member.name):
        size = len(list(group))
        scalar = size == 1 and next(m for m in members if m.name == base).position is None
        lines.append(f"    double {base};" if scalar else f"    double {base}[{size}];")
    return [*lines, *(f"    double {member}[1];" for member in missing), f"}} {name};"]


def interface_source(plan: Layout, variables: Sequence[Variable]) -> str:
    """Return interface.c: the table of the visible variables, inputs first, and the start values of all variables."""
    variables = sorted(variables, key=lambda v: v.causality != "input")
    position = {v.reference: k for k, v in enumerate(variables)}
    references = range(_references(plan.interface.variables))
    places = [position.get(reference, -1) for reference in references]
    index = {v.reference: plan.index(v) for v in variables if v.type == "Real" and not v.is_computed}
    nominal = {v.name: v.nominal for v in plan.interface.variables}
    inputs = [str(v.reference) for v, _ in plan.reals if v.causality == "input"]
    flags = [str(int(bool(v.start))) for v in plan.flags] or ["0"]
    lines = [
        f"/* {plan.interface.kind} {plan.interface.version}: generated from interface.toml; do not edit. */",
        '#include "component.h"',
        "",
        "const Variable variables[] = {",
        *(f"    {_row(plan, variable)}," for variable in variables),
        "};",
        "",
        f"const fmi2ValueReference input_references[INPUTS] = {{{', '.join(inputs)}}};",
        f"const int16_t variable_of_reference[REFERENCES] = {{{', '.join(map(str, places))}}};",
        f"const int16_t real_of_reference[REFERENCES] = {{{', '.join(str(index.get(r, -1)) for r in references)}}};",
        "",
        f"const double start_values[REALS] = {c_array(float(v.start or 0.0) for v, _ in plan.reals)};",
        f"const double nominal_states[CONTINUOUS_STATES + 1] = "
        f"{c_array([*(nominal[name] or 1.0 for name in plan.interface.states), 1.0])};",
        f"const int64_t start_flags[FLAGS] = {{{', '.join(flags)}}};",
        "",
    ]
    return "\n".join(lines)


def _row(plan: Layout, variable: Variable) -> str:
    cells = [
        f'"{variable.name}"',
        f'"{"" if variable.unit == "1" else variable.unit or ""}"',
        variable.type.upper(),
        plan.place(variable),
        _STATE_SETTABLE
        if variable.name in plan.interface.states
        else _SETTABLE.get((variable.causality, variable.variability), "0"),
        str(int(variable.causality == "output")),
        "-NO_LIMIT" if variable.minimum is None else c_number(variable.minimum),
        "NO_LIMIT" if variable.maximum is None else c_number(variable.maximum),
    ]
    return "{" + ", ".join(cells) + "}"
