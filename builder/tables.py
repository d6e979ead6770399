"""Generated C tables of an FMU: its variables, a shock's settings, a vehicle's modes."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby

import numpy as np

from builder.interface import PORT_PARAMETERS, Interface, Variable, friction_ports, spring_ports
from builder.product import BEYOND_SETTINGS
from eightpost.array_types import Array
from eightpost.shock import Settings, ShockLaw
from eightpost.shock.curve import KNOTS
from eightpost.shock.settings import LAGGED_SLOPE
from eightpost.vehicle import LinearStepper, StateSpace
from eightpost.vehicle.friction import ports_of
from eightpost.vehicle.modal import ModalForm

# ---- interface.h and interface.c: the variables ---------------------------------------------------------------------

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


def _member(kind: str, variable: Variable, earlier: Sequence[_Member]) -> _Member:
    """Return the member for a variable of an interface kind.

    A shock's variable curve.inner[2] is curve_inner[1]. In a vehicle, inputs, outputs and each kind of parameter are
    arrays; in an assembly, all variables of a causality are one array.
    """
    if kind not in _COMPUTED_WHEN_ASKED:
        name, _, number = variable.name.rstrip("]").partition("[")
        return _Member(name.replace(".", "_"), int(number) - 1 if number else None)
    name, own = variable.causality, variable.name.rpartition(".")[2]
    if kind == "vehicle_ss" and name == "parameter":
        name = own if own in PORT_PARAMETERS else "offset"
    return _Member(name, sum(member.name == name for member in earlier))


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
        stored = self.flags if variable.type == "Boolean" else [v for v, _ in self.reals]
        return [v.name for v in stored].index(variable.name)

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
    members: list[_Member] = []
    for variable in reals:
        members.append(_member(interface.kind, variable, members))
    flags = tuple(v for v in interface.variables if v.type == "Boolean")
    return Layout(interface, tuple(zip(reals, members, strict=True)), flags, states)


def c_number(value: float) -> str:
    """Return a C constant for exactly the same double, with up to 17 digits."""
    return repr(float(value))


def _c_array(values: Iterable[float]) -> str:
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
    has_settings, inputs = BEYOND_SETTINGS in interface.names("local"), interface.names("input")
    switches = {
        "SEVERAL_STATES": interface.kind.startswith("shock_") and len(interface.states) > 1,
        "HAS_SETTINGS": has_settings,  # adjusters or temperature are variables (settings.h)
        "HAS_TEMPERATURE_INPUT": has_settings and "temperature" in inputs,
    }
    signals = [m for v, m in plan.reals if v.causality in _SIGNALS]
    parameters = [m for v, m in plan.reals if v.causality == "parameter"]
    lines = [
        f"/* {interface.kind} {interface.version}: generated from interface.toml; do not edit. */",
        "#ifndef EIGHTPOST_INTERFACE_H",
        "#define EIGHTPOST_INTERFACE_H",
        "",
        f'#define MODEL_IDENTIFIER "{identifier}"',
        f'#define MODEL_GUID "{{{guid}}}"',
        f"#define STATE_TAG UINT64_C({_digest(f'{{{guid}}}'):#x})",
        *(f"#define {name}" for name, is_on in switches.items() if is_on),
        "",
        "enum {",
        *(f"    {name} = {value}," for name, value in counts.items()),
        "};",
        *(["", "enum { " + ", ".join(v.name.replace(".", "_") for v in plan.flags) + " };"] if plan.flags else []),
        "",
        *_struct("Signals", signals),
        "",
        *_struct("Parameters", parameters, _NEEDED.get(interface.kind, ())),
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


def _digest(text: str) -> int:
    """Return the FNV-1a hash of a text, 64 bits."""
    value = 14695981039346656037
    for byte in text.encode():
        value = (value ^ byte) * 1099511628211 % 2**64
    return value


def _references(variables: Iterable[Variable]) -> int:
    return max(v.reference for v in variables) + 1


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
        f"const double start_values[REALS] = {_c_array(float(v.start or 0.0) for v, _ in plan.reals)};",
        f"const double nominal_states[CONTINUOUS_STATES + 1] = "
        f"{_c_array([*(nominal[name] or 1.0 for name in plan.interface.states), 1.0])};",
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


# ---- settings_data.h: the effect of a shock's adjusters and temperature ---------------------------------------------

#: Slope of the lagged part at a knot, as in settings.py: with its own deviation, or its share of the curve's slope.
_CHANGED = """        const double slope = now->curve_knot_slope[k];
        const double part = not_negative(now->curve_lagged_slope[k] + changes[k]);""".splitlines()
_SHARED = """        const double before = given->curve_knot_slope[k], slope = now->curve_knot_slope[k];
        const double part = before > 0.0 ? now->curve_lagged_slope[k] * (slope / before) : 0.0;""".splitlines()

#: The lagged part is never steeper than the curve.
_LIMITED = """        now->curve_lagged_slope[k] = part < slope ? part : slope;
    }
    if (now->curve_lagged_slope[0] > now->curve_rebound_slope) {
        now->curve_lagged_slope[0] = now->curve_rebound_slope;
    }
    if (now->curve_lagged_slope[KNOTS - 1] > now->curve_compression_slope) {
        now->curve_lagged_slope[KNOTS - 1] = now->curve_compression_slope;
    }""".splitlines()


def settings_data(settings: Settings, law: ShockLaw, interface: Interface) -> str:
    """Return the tables of settings, and the functions that depend on the names of their variables."""
    inputs = interface.names("input")
    most = max(len(axis.nodes) for axis in settings.axes)
    rows = [row for term in settings.terms for row in term.deviations]
    counts = {
        "AXES": len(settings.axes),
        "TERMS": len(settings.terms),
        "TESTED": len(settings.tested),
        "MOST_NODES": most,
        "DEVIATIONS": settings.deviation_count,
        "TEMPERATURE_INPUT": inputs.index("temperature") if "temperature" in inputs else -1,
    }
    lines = [
        "/* Effect of the settings: generated from the shock file; do not edit. */",
        "enum {",
        *(f"    {name} = {value}," for name, value in counts.items()),
        "};",
        "",
        "/* Deviations that depend on some axes together: a row per combination of their nodes, from `first` on. */",
        "typedef struct {",
        "    int axes, axis[AXES], rows, first;",
        "} TermTable;",
        "",
        f"static const int node_counts[AXES] = {{{', '.join(str(len(axis.nodes)) for axis in settings.axes)}}};",
        "static const double axis_nodes[AXES][MOST_NODES] = {",
        *(f"    {_c_array([*axis.nodes, *[0.0] * (most - len(axis.nodes))])}," for axis in settings.axes),
        "};",
        f"static const TermTable terms[TERMS] = {{{', '.join(_terms(settings))}}};",
        f"static const double deviations[{len(rows)}][DEVIATIONS] = {{",
        *(f"    {_c_array(row)}," for row in rows),
        "};",
        "static const double tested[TESTED][AXES] = {",
        *(f"    {_c_array(row)}," for row in settings.tested),
        "};",
        "",
        "static void read_setting(const Values *v, double *setting)",
        "{",
        *(
            f"    setting[{k}] = v->named.{'signals' if axis.variable in inputs else 'parameters'}"
            f".{axis.variable.replace('.', '_')};"
            for k, axis in enumerate(settings.axes)
        ),
        "}",
        "",
        "/* Changes the law's own parameters by the deviations that follow those of the curve. */",
        "static void change_own(Parameters *now, const Parameters *given, const double *changes)",
        "{",
        *_changes(settings, law),
        "}",
        "",
    ]
    return "\n".join(lines)


def _terms(settings: Settings) -> Iterator[str]:
    first, names = 0, [axis.name for axis in settings.axes]
    for term in settings.terms:
        places = ", ".join(str(names.index(name)) for name in term.axes)
        yield f"{{{len(term.axes)}, {{{places}}}, {len(term.deviations)}, {first}}}"
        first += len(term.deviations)


def _changes(settings: Settings, law: ShockLaw) -> Iterator[str]:
    """Yield the lines that change the law's parameters: factors by their logarithms, then the lagged slopes."""
    first = KNOTS * settings.has_lagged_slope
    for k, name in enumerate(settings.factors):
        value = getattr(law, name)
        places = [f"{name}[{i}]" for i in range(len(value))] if isinstance(value, tuple) else [name]
        for place in places:
            yield f"    now->{place} *= exponential(changes[{first + k}]);"
    if not settings.parameters:
        yield "    (void)changes;"
    if settings.has_lagged_slope or not hasattr(law, LAGGED_SLOPE):
        yield "    (void)given;"
    if hasattr(law, LAGGED_SLOPE):
        yield "    for (int k = 0; k < KNOTS; k++) {"
        yield from (_CHANGED if settings.has_lagged_slope else _SHARED)
        yield from _LIMITED
    elif not settings.parameters:
        yield "    (void)now;"


# ---- vehicle_data.h: a vehicle's modes, for fmus/vehicle_ss/model.c -------------------------------------------------

#: Possible numbers of rows of a block of B, of which the one with less padding is used: fmus/vehicle_ss/model.c keeps
#: as many sums in registers.
_BLOCKS = (16, 8)

#: Number of values that fmus/vehicle_ss/model.c processes at once; arrays are padded to a multiple of it.
_LANES = 4


def vehicle_data(model: StateSpace, form: ModalForm, interface: Interface) -> str:
    """Return the header; inputs and outputs are in the interface's order, which may differ from the model's."""
    columns = [model.input_names.index(name) for name in interface.names("input")]
    rows = [model.output_names.index(name) for name in interface.names("output")]
    room = _Room.of(form)
    into = room.rows(form.B_re[:, columns], form.B_im[:, columns])
    out = room.rows(form.C_re[rows].T, form.C_im[rows].T).T
    blocks = [
        "/* The vehicle in real block-modal form: generated by the build; do not edit. */",
        "#ifndef EIGHTPOST_VEHICLE_DATA_H\n#define EIGHTPOST_VEHICLE_DATA_H",
        _modes(form, room),
        _blocks_of_rows(into),
        _rows("C", "OUTPUTS", out),
        _direct(model.D[np.ix_(rows, columns)]),
        _offsets(interface),
        _ports(model, interface),
        "#endif\n",
    ]
    return "\n\n".join(blocks)


def kept_numbers(form: ModalForm, interface: Interface) -> int:
    """Return the number of values that model.c keeps from step to step: modes, the corresponding inputs, bristles."""
    room = _Room.of(form)
    return room.modes + room.pairs + len(interface.names("input")) + len(friction_ports(interface))


@dataclass(frozen=True, slots=True)
class _Room:
    """Padded sizes for the real parts of all modes and the imaginary parts of the complex pairs, which come first."""

    modes: int
    pairs: int
    used: int

    @staticmethod
    def of(form: ModalForm) -> _Room:
        """Return the sizes that a vehicle needs."""
        return _Room(_whole(form.sigma.size), _whole(form.pairs), form.pairs)

    def rows(self, re: Array, im: Array) -> Array:
        """Return the rows (modes, n) of real and imaginary parts, padded with zeros."""
        placed = np.zeros((self.modes + self.pairs, re.shape[1]))
        placed[: re.shape[0]] = re
        placed[self.modes : self.modes + self.used] = im[: self.used]
        return placed


def _whole(count: int) -> int:
    return max(_LANES, -(-count // _LANES) * _LANES)


def _modes(form: ModalForm, room: _Room) -> str:
    fastest, coupled = float(np.abs(form.eigenvalues).max(initial=0.0)), len(form.coupling)
    at_rest = -np.linalg.inv(form.coupling) if form.steady else np.zeros((coupled, coupled))
    sizes = {"MODE_COUNT": form.sigma.size, "MODES": room.modes, "PAIR_COUNT": room.used, "PAIRS": room.pairs}
    sizes |= {"COUPLED_COUNT": coupled, "COUPLED": max(1, coupled), "COUPLED_CELLS": max(1, coupled**2)}
    sizes |= {"LANES": _LANES, "STATE_COUNT": room.modes + room.pairs}
    return "\n".join(
        (
            "enum { " + ", ".join(f"{name} = {size}" for name, size in sizes.items()) + " };",
            f"enum {{ HAS_EQUILIBRIUM = {int(form.steady)} }};",
            f"static const double SIGMA[MODES] = {_c_array(form.sigma)}; /* 1/s */",
            f"static const double OMEGA[MODES] = {_c_array(form.omega)}; /* rad/s */",
            f"static const double FASTEST = {c_number(fastest)}; /* 1/s */",
            f"static const double COUPLING[COUPLED_CELLS] = {_c_array(form.coupling.ravel())}; /* 1/s */",
            f"static const double COUPLED_AT_REST[COUPLED_CELLS] = {_c_array(at_rest.ravel())}; /* s */",
            f"static const double FASTEST_COUPLED = {c_number(np.abs(form.coupling).sum(axis=1).max(initial=0.0))};",
        )
    )


def _blocks_of_rows(values: Array) -> str:
    """Return the matrix B in blocks of rows, each block column by column; the last block is padded with zeros."""
    rows, columns = values.shape
    block = min(_BLOCKS, key=lambda size: -(-rows // size) * size)
    count = -(-rows // block)
    padded = np.zeros((count * block, columns))
    padded[:rows] = values
    stored = padded.reshape(count, block, columns).transpose(0, 2, 1)
    lines = ",\n".join(f"    {{{', '.join(map(_c_array, columns_of))}}}" for columns_of in stored)
    sizes = f"enum {{ BLOCK = {block}, STATE_BLOCKS = {count} }};"
    return f"{sizes}\nstatic const double B[STATE_BLOCKS][INPUTS][BLOCK] = {{\n{lines},\n}};"


def _rows(name: str, size: str, values: Array) -> str:
    lines = ",\n".join(f"    {_c_array(row)}" for row in values)
    return f"static const double {name}[{size}][STATE_COUNT] = {{\n{lines},\n}};"


def _direct(direct: Array) -> str:
    """Return the nonzero terms of D as a sparse list, ordered by output."""
    outputs, inputs = np.nonzero(direct)
    begins = np.searchsorted(outputs, np.arange(direct.shape[0] + 1))
    return "\n".join(
        (
            f"enum {{ DIRECT_TERMS = {max(1, outputs.size)} }};",
            f"static const int DIRECT_BEGIN[OUTPUTS + 1] = {_integers(begins.tolist())};",
            f"static const int DIRECT_INPUT[DIRECT_TERMS] = {_integers(inputs.tolist())};",
            f"static const double DIRECT_TERM[DIRECT_TERMS] = {_c_array(direct[outputs, inputs])};",
        )
    )


def _offsets(interface: Interface) -> str:
    """Return the index of the static offset of each output among the offset parameters; -1 means no offset."""
    added = {v.name: v.offset for v in interface.variables if v.offset}
    own = [v.name for v in interface.variables if v.name in added.values()]
    places = [own.index(added[name]) if name in added else -1 for name in interface.names("output")]
    return f"static const int OFFSET_OF[OUTPUTS] = {_integers(places)};"


def _ports(model: StateSpace, interface: Interface) -> str:
    """Return the ports with friction, in the order of the friction parameters, and those of them with a spring."""
    names, inputs, outputs = friction_ports(interface), interface.names("input"), interface.names("output")
    springs = spring_ports(interface)
    forces = [model.input_names.index(f"{name}force") for name in names]
    velocities = [model.output_names.index(f"{name}velocity") for name in names]
    mobility = ports_of(LinearStepper(model.A, model.B, model.C, model.D), forces, velocities).mobility
    places = [outputs.index(f"{name}displacement") for name in springs]
    return "\n".join(
        (
            f"enum {{ PORT_COUNT = {len(names)}, PORTS = {max(1, len(names))} }};",
            f"static const int PORT_INPUT[PORTS] = {_integers([inputs.index(f'{name}force') for name in names])};",
            f"static const int PORT_OUTPUT[PORTS] = {_integers([outputs.index(f'{name}velocity') for name in names])};",
            f"static const double MOBILITY[PORTS] = {_c_array(mobility)}; /* 1/kg */",
            f"enum {{ SPRING_COUNT = {len(springs)}, SPRINGS = {max(1, len(springs))} }};",
            f"static const int SPRING_PORT[SPRINGS] = {_integers([names.index(name) for name in springs])};",
            f"static const int SPRING_OUTPUT[SPRINGS] = {_integers(places)};",
        )
    )


def _integers(values: Sequence[int]) -> str:
    return "{" + (", ".join(map(str, values)) or "0") + "}"
