"""An assembly as one native FMU: its documents and reference results, its C sources and its file.

The C sources are those of each kind of part with prefixed names, and the wiring as constants.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import accumulate
from math import ceil
from pathlib import Path

import numpy as np

from builder.assembly.plan import VEHICLE, Assembly, Part, assembly_interface, coupling_step, law_of
from builder.build import fmu_identifier
from builder.interface import (
    BRISTLE,
    PORT_PARAMETERS,
    Interface,
    friction_ports,
    source_files,
    source_folder,
    spring_ports,
)
from builder.native_fmu import Source, common_files, compiled, model_files, sealed
from builder.page import curves_picture, equations, page
from builder.reference import COUNT, STEP, Reference, combined_member, reference_files, rounded, vehicle_inputs
from builder.tables import c_number, interface_header, interface_source, layout
from builder.toolchain import find_toolchain
from eightpost.archive import write_archive
from eightpost.array_types import Array
from eightpost.errors import FmuError
from eightpost.outputs import FMU, check_file
from eightpost.progress import Progress
from eightpost.report.static import Column, Picture, Section, folded, paragraph, table
from eightpost.shock import ShockLaw
from eightpost.vehicle import LinearStepper, friction
from eightpost.vehicle.friction import PortFriction, named_ports
from eightpost.wiring import Wire, Wiring

# ---- The parts as models of the library -----------------------------------------------------------------------------


def _start_values(assembly: Assembly, part: Part) -> dict[str, float | bool]:
    """Return the start values of a part's variables in the assembly, by their names in the part."""
    own = {v.name: v.start for v in part.interface.variables if v.start is not None}
    return {name: assembly.starts.get(f"{part.name}.{name}", value) for name, value in own.items()}


class _Shock:
    """A shock of an assembly with its start values, at any temperature if that is an input."""

    def __init__(self, assembly: Assembly, part: Part) -> None:
        self._values, self._settings = _start_values(assembly, part), part.settings
        self._given = law_of(part.kind, self._values)
        inputs = part.interface.names("input")
        self._temperature = inputs.index("temperature") if "temperature" in inputs else None
        self._laws: dict[tuple[float, ...], ShockLaw] = {}

    def law(self, u: Array | None = None) -> ShockLaw:
        """Return the law at the start values, or with the inputs (m,) of the shock."""
        if self._settings is None:
            return self._given
        warm = {} if u is None or self._temperature is None else {"temperature": float(u[self._temperature])}
        setting = tuple(float((self._values | warm)[axis.variable]) for axis in self._settings.axes)
        if setting not in self._laws:
            self._laws[setting] = self._settings.law_at(self._given, setting)
        return self._laws[setting]


#: Linear model in modal coordinates, friction, offsets of the outputs, and whether the vehicle starts at rest.
_VehicleModel = tuple[LinearStepper, PortFriction, Array, bool]


def _vehicle_model(assembly: Assembly) -> _VehicleModel:
    part = assembly.vehicle
    values, data, named = _start_values(assembly, part), _Data(part.data), part.interface
    inputs, outputs = named.names("input"), named.names("output")
    stepper = LinearStepper(*data.state_space(len(inputs), len(outputs)))
    names = friction_ports(named)
    ports = named_ports(stepper, (inputs, outputs), names, spring_ports(named))
    port_friction = PortFriction.of_values(ports, names, {name: float(value) for name, value in values.items()})
    offsets = np.zeros(len(outputs))
    added = [v.name for v in named.variables if v.causality == "parameter" and v.type == "Real"]
    added = [name for name in added if name.rpartition(".")[2] not in PORT_PARAMETERS]
    for output, place in enumerate(data.integers("OFFSET_OF")):
        offsets[output] = float(values[added[place]]) if place >= 0 else 0.0
    return stepper, port_friction, offsets, bool(values["start_at_equilibrium"])


class _Data:
    """The constants of a vehicle_data.h that builder/tables.py has written."""

    def __init__(self, text: str) -> None:
        text = re.sub(r"/\*.*?\*/", "", text, flags=re.DOTALL)
        self._arrays = {
            name: [float(cell) for cell in re.findall(r"[^{},\s]+", cells)]
            for name, cells in re.findall(r"static const \w+ (\w+)\[[^;]*?\] = \{(.*?)\};", text, flags=re.DOTALL)
        }
        self._counts: Mapping[str, int] = {name: int(n) for name, n in re.findall(r"\b([A-Z_]+) = (\d+)", text)}

    def integers(self, name: str) -> list[int]:
        return [int(value) for value in self._arrays[name]]

    def state_space(self, inputs: int, outputs: int) -> tuple[Array, Array, Array, Array]:
        """Return A (n, n), B (n, m), C (p, n), D (p, m); the state is all real parts, then the imaginary parts."""
        modes, pairs, room, coupled = (
            self._counts[name] for name in ("MODE_COUNT", "PAIR_COUNT", "MODES", "COUPLED_COUNT")
        )
        used = np.concatenate([np.arange(modes), room + np.arange(pairs)])
        sigma, omega = (np.array(self._arrays[name])[:modes] for name in ("SIGMA", "OMEGA"))
        A = np.diag(np.concatenate([sigma, sigma[:pairs]]))
        for k in range(pairs):
            A[k, modes + k], A[modes + k, k] = -omega[k], omega[k]
        first = modes - coupled
        A[first:modes, first:modes] += np.array(self._arrays["COUPLING"])[: coupled**2].reshape(coupled, coupled)
        blocks = np.array(self._arrays["B"]).reshape(-1, inputs, self._counts["BLOCK"])
        B = blocks.transpose(0, 2, 1).reshape(-1, inputs)[used]
        C = np.array(self._arrays["C"]).reshape(outputs, -1)[:, used]
        return A, B, C, self._direct(inputs, outputs)

    def _direct(self, inputs: int, outputs: int) -> Array:
        begins, columns = self.integers("DIRECT_BEGIN"), self.integers("DIRECT_INPUT")
        terms = self._arrays["DIRECT_TERM"]
        D = np.zeros((outputs, inputs))
        for row in range(outputs):
            for k in range(begins[row], begins[row + 1]):
                D[row, columns[k]] = terms[k]
        return D


# ---- Reference results, computed from the laws and the exact linear step of the library -----------------------------

_MEAN_DEFECT = 5.0 / 12.0
_LEAST_SPREAD = 1e-4


def _assembly_reference(assembly: Assembly, interface: Interface) -> Reference | None:
    """Return the response of an assembly to sums of sines at all inputs, with different frequencies at each input.

    Returns None if its vehicle has no equilibrium; the FMU then refuses to start with its default parameters.
    """
    inputs = [v for v in interface.variables if v.causality == "input"]
    starts = np.array([float(v.start or 0.0) for v in inputs])
    u = rounded(starts + vehicle_inputs([v.unit or "1" for v in inputs]))
    run = _Run(assembly, tuple(v.name for v in inputs), interface.names("output"))
    count = ceil(STEP / coupling_step(interface) * (1.0 - 1e-9))
    try:
        run.start(u[0])
    except ValueError:
        return None
    rows = [run.outputs(u[0])]
    for held in u[:COUNT]:
        for _ in range(count):
            run.step(held, STEP / count)
        rows.append(run.outputs(held))
    return Reference(run.inputs, u, run.names, np.array(rows))


class _Run:
    """A running assembly: the vehicle's state, the lagged forces, and every output by `component.variable`."""

    def __init__(self, assembly: Assembly, inputs: tuple[str, ...], names: tuple[str, ...]) -> None:
        self.inputs, self.names = inputs, names
        self._assembly = assembly
        self._stepper, self._friction, self._offsets, self._starts_at_rest = _vehicle_model(assembly)
        self._laws: dict[str, _Shock] = {part.name: _Shock(assembly, part) for part in assembly.shocks}
        self._state = np.zeros(self._stepper.A.shape[0] + self._friction.states)
        self._lagged = dict.fromkeys(self._laws, 0.0)
        self._now: dict[str, float] = {}
        self._slope = {f"{name}.force": 0.0 for name in self._laws}
        # Per force: integral of squared prediction errors, mean, integral of squared deviations from the mean.
        self._meters = {f"{name}.force": (0.0, 0.0, 0.0) for name in self._laws}
        self._time = 0.0
        self._wires = {part.name: tuple(self._wiring(part)) for part in assembly.parts}

    def _wiring(self, part: Part) -> Iterator[tuple[int | None, tuple[Wire, ...]]]:
        """Yield the index of the assembly's input and the links for each input of a part."""
        for name in part.interface.names("input"):
            full = f"{part.name}.{name}"
            yield self.inputs.index(full) if full in self.inputs else None, self._assembly.into(part, name)

    def start(self, u: Array) -> None:
        """Solve for the shock forces that are consistent with the vehicle's start state; at rest both are linear."""
        forces = [f"{name}.force" for name in self._laws]
        count = len(forces)
        none, *ones = (
            self._start_under(u, dict(zip(forces, row, strict=True))) for row in (np.zeros(count), *np.eye(count))
        )
        gains = np.column_stack([one - none for one in ones])
        found = np.linalg.solve(np.eye(count) - gains, none)
        self._start_under(u, dict(zip(forces, found.tolist(), strict=True)))

    def _start_under(self, u: Array, forces: dict[str, float]) -> Array:
        self._now = dict(forces)
        fed = self._fed(self._assembly.vehicle.name, u, self._now)
        if self._starts_at_rest:
            self._state = friction.equilibrium(self._stepper, self._friction, fed)
        self._take_vehicle(fed)
        for name, shock in self._laws.items():
            fed = self._fed(name, u, self._now)
            (velocity, displacement), law = fed[:2], shock.law(fed)
            self._lagged[name] = law.start(velocity)
            self._now[f"{name}.force"] = law.response(self._lagged[name], velocity, displacement).force
        return np.array([self._now[f"{name}.force"] for name in self._laws])

    def step(self, u: Array, h: float) -> None:
        """Do one micro step with the inputs held."""
        before = dict(self._now)
        ahead = {name: before[name] + slope * h for name, slope in self._slope.items()}
        self._step_vehicle(u, before, before | ahead, h)
        for name, shock in self._laws.items():
            fed = self._fed(name, u, self._now)
            v0, (v1, x1), law = self._fed(name, u, before)[0], fed[:2], shock.law(fed)
            self._lagged[name] = law.follow(self._lagged[name], v0, v1, h)
            self._now[f"{name}.force"] = law.response(self._lagged[name], v1, x1).force
        self._time += h
        for name, assumed in ahead.items():
            came, (missed, mean, spread) = self._now[name], self._meters[name]
            nearer = mean + (came - mean) * h / self._time
            spread += h * (came - mean) * (came - nearer)
            self._meters[name] = missed + h * (assumed - came) ** 2, nearer, spread
            self._slope[name] = (came - before[name]) / h

    def _step_vehicle(self, u: Array, before: dict[str, float], ahead: dict[str, float], h: float) -> None:
        name = self._assembly.vehicle.name
        u0, u1 = self._fed(name, u, before), self._fed(name, u, ahead)
        self._state = friction.advance(self._stepper, self._friction, self._state, u0, u1, h)
        self._take_vehicle(u1)

    def _take_vehicle(self, u: Array) -> None:
        part = self._assembly.vehicle
        y = friction.output(self._stepper, self._friction, self._state, u) + self._offsets
        for name, value in zip(part.interface.names("output"), y.tolist(), strict=True):
            self._now[f"{part.name}.{name}"] = value

    def _fed(self, component: str, u: Array, now: dict[str, float]) -> Array:
        rows = self._wires[component]
        return np.array(
            [(0.0 if at is None else u[at]) + sum(_through(link, now) for link in links) for at, links in rows]
        )

    def outputs(self, u: Array) -> list[float]:
        """Return all outputs of the assembly, in order; those of the vehicle follow the shocks' forces now."""
        self._take_vehicle(self._fed(self._assembly.vehicle.name, u, self._now))
        errors = {name: self._error(meter) for name, meter in self._meters.items()}
        own = {f"{name.removesuffix('force')}coupling_error": error for name, (error, _) in errors.items()}
        worst = max(100.0 * error / spread if spread > 0.0 else 0.0 for error, spread in errors.values())
        values = self._now | own | {"coupling_error": worst}
        return [values[name] for name in self.names]

    def _error(self, meter: tuple[float, float, float]) -> tuple[float, float]:
        """Return a force's RMS local error and its standard deviation [N]; 0 if it is almost constant."""
        if self._time == 0.0:
            return 0.0, 0.0
        missed, mean, squares = meter
        spread = (max(squares, 0.0) / self._time) ** 0.5
        moves = spread > _LEAST_SPREAD * (abs(mean) + 1.0)
        return _MEAN_DEFECT * (missed / self._time) ** 0.5, spread if moves else 0.0


def _through(link: Wire, now: dict[str, float]) -> float:
    return link.gain * (link.factor * now[link.source] + link.offset_before_gain)


# ---- The documents of an assembly -----------------------------------------------------------------------------------

_PARTS = (Column("component", "name"), Column("FMU", "tight"), Column("description"), Column("GUID", "digest"))
_CONNECTIONS = (Column("from", "name"), Column("to", "name"), Column("gain", "number"), Column("offset", "number"))
_CAPTION = "Force at the port of each shock without gas force, over the fitted velocity range."


def _assembly_documents(assembly: Assembly, interface: Interface, fmi: int = 2) -> dict[str, bytes]:
    """Return the documents of an archive: member name -> content; the same assembly gives the same bytes."""
    picture = curves_picture(assembly.identifier, {part.name: _Shock(assembly, part).law() for part in assembly.shocks})
    reference = _assembly_reference(assembly, interface)
    parts = [(part.name, part.file, part.text, part.guid) for part in assembly.parts]
    origin = [Section("Parts", table(_PARTS, parts)), _connections(assembly), _equations(assembly)]
    described = assembly.identifier, assembly.text, interface
    html = page(described, Picture(picture, _CAPTION), origin, has_reference=reference is not None, fmi=fmi)
    return {
        "model.png": picture,
        **({"terminalsAndIcons/icon.png": picture} if fmi == 3 else {}),
        "documentation/index.html": html,
        "documentation/licenses/license.txt": (source_folder() / "LICENSE.txt").read_bytes(),
        **combined_member(
            {part.name: part.validity for part in assembly.parts},
            {link.target: link.source for link in assembly.links if link.gain * link.factor == 1.0},
            frozenset(v.name for v in interface.variables),
        ),
        **(reference_files(reference, assembly.identifier) if reference else {}),
    }


def _connections(assembly: Assembly) -> Section:
    rows = [
        (
            link.source,
            link.target,
            f"{link.gain * link.factor:g}",
            f"{link.gain * link.offset_before_gain:g}" if link.offset_before_gain else "",
        )
        for link in assembly.links
    ]
    return Section("Connections", table(_CONNECTIONS, rows))


def _equations(assembly: Assembly) -> Section:
    """Return the texts of the parts; anchors are prefixed with the kind, because several texts have equal headings."""
    kinds = dict.fromkeys(part.kind for part in assembly.parts)
    html = paragraph("These texts are also in the documentation of the parts' own FMUs.")
    for kind in kinds:
        html += folded(kind, re.sub(r'(id="|href="#)', rf"\g<1>{kind}-", equations(kind)))
    return Section("Equations of the parts", html)


# ---- The C sources of an assembly -----------------------------------------------------------------------------------


def assembly_sources(assembly: Assembly, interface: Interface, guid: str) -> dict[str, bytes]:
    """Return the sources that both FMI versions have: file name -> content."""
    files = common_files() | source_files("assembly")
    for unit, example in _units(assembly).items():
        files |= _files_of(unit, example)
    signals, forces = len(assembly.signals), sum(not part.is_vehicle for part, _ in assembly.signals)
    plan = layout(interface, sum(map(_kept, assembly.parts)) + 2 * signals + 3 * forces + 1)
    generated = {
        "assembly_data.h": _wiring(assembly, interface),
        "interface.h": interface_header(plan, assembly.identifier, guid),
        "interface.c": interface_source(plan, interface.variables),
    }
    return files | {name: text.encode() for name, text in generated.items()}


def _units(assembly: Assembly) -> dict[str, Part]:
    """Return a part of each compilation unit, in order."""
    units: dict[str, Part] = {}
    for part in assembly.parts:
        units.setdefault(part.unit, part)
    return units


def _files_of(unit: str, example: Part) -> dict[str, bytes]:
    """Return a kind's model under a unique file name, which its compilation unit includes, and unchanged headers."""
    kind = example.kind
    included = {"model.c": f"{kind}.inc", "shock.c": "shock.inc", "rates.c": f"{kind}_rates.inc"}
    files = {included.get(name, name): content for name, content in model_files(kind).items()}
    if example.is_vehicle:
        files["vehicle_data.h"] = example.data.encode()
    if example.settings is not None:
        files[f"{unit}_settings.h"] = example.data.encode()
    header = interface_header(layout(example.interface, example.states), kind, "")
    return files | {f"{unit}_interface.h": header.encode(), f"{unit}_part.c": _unit(unit, example).encode()}


def _unit(unit: str, example: Part) -> str:
    kind = example.kind
    bodies = [f"{kind}.inc", f"{kind}_rates.inc" if kind == VEHICLE else "shock.inc"]
    lines = [
        f"/* The model of {unit} as a part: generated by the build; do not edit. */",
        f"#define EIGHTPOST_PART {unit}_",
        *([] if example.settings is None else [f'#define SETTINGS_DATA "{unit}_settings.h"']),
        '#include "part_names.h"',
        "/* Replaces interface.h, which belongs to the assembly. */",
        f'#include "{unit}_interface.h"',
        *(f'#include "{name}"' for name in (*bodies, "part.inc")),
        "",
    ]
    return "\n".join(lines)


def _kept(part: Part) -> int:
    """Return the number of values that the assembly stores for a part: state (at least 1) and signals."""
    return max(1, part.states) + len(_reals(part.interface, "input", "output", "local"))


def _wiring(assembly: Assembly, interface: Interface) -> str:
    units, outputs, parts = _units(assembly), interface.names("output"), assembly.parts
    coupled = [[parts.index(part), part.interface.names("output").index(name)] for part, name in assembly.signals]
    errors = [outputs.index(f"{p.name}.coupling_error") for p, _ in assembly.signals if not p.is_vehicle]
    counts = {
        "PARTS": len(assembly.parts),
        "PARTS_KEEP": sum(map(_kept, assembly.parts)),
        "COUPLED": len(assembly.signals),
        "FORCES": len(errors),
        "MOST_INPUTS": max(len(part.interface.names("input")) for part in assembly.parts),
        "COUPLING_STEP": _reals(interface, "parameter").index("coupling_step"),
        "WORST_ERROR": outputs.index("coupling_error"),
    }
    feeds, terms = _feeds(assembly, interface)
    states = (*_state_places(assembly), 0)
    blocks = [
        "/* The parts and their wiring: generated by the build; do not edit. */",
        "#ifndef EIGHTPOST_ASSEMBLY_DATA_H\n#define EIGHTPOST_ASSEMBLY_DATA_H",
        '#include "wiring.h"',
        "enum { " + ", ".join(f"{name} = {value}" for name, value in counts.items()) + " };",
        "#define PART_KINDS(X) " + " ".join(f"X({unit})" for unit in units),
        "enum { " + ", ".join(f"KIND_{unit}" for unit in units) + " };",
        _table("Place", "PART", "PARTS", _places(assembly, interface)),
        _table("Coupled", "SIGNAL", "COUPLED", coupled),
        _table("Feed", "FEED", "", feeds),
        _table("Term", "TERM", "", terms),
        f"static const int STATE_PLACE[] = {{{', '.join(map(str, states))}}}; /* in Memory.state */",
        f"static const int FORCE_ERROR[FORCES] = {{{', '.join(map(str, errors))}}}; /* outputs */",
        "#endif\n",
    ]
    return "\n\n".join(blocks)


def _table(kind: str, name: str, size: str, rows: Sequence[Sequence[object]]) -> str:
    lines = ",\n".join("    {" + ", ".join(map(str, row)) + "}" for row in rows)
    return f"static const {kind} {name}[{size}] = {{\n{lines},\n}};"


def _reals(interface: Interface, *causalities: str) -> list[str]:
    """Return the names of Real variables in memory order: by causality, then in the order of the interface."""
    stored = [v for v in interface.variables if v.type == "Real" and not v.is_computed]
    return [v.name for causality in causalities for v in stored if v.causality == causality]


def _places(assembly: Assembly, interface: Interface) -> list[list[object]]:
    signals = _reals(interface, "input", "output", "local")
    parameters = _reals(interface, "parameter")
    flags = [v.name for v in interface.variables if v.type == "Boolean"]
    kept = accumulate(map(_kept, assembly.parts), initial=0)
    feeds = accumulate((len(part.interface.names("input")) for part in assembly.parts), initial=0)
    states = accumulate((len(part.interface.states) for part in assembly.parts), initial=0)
    rows: list[list[object]] = []
    for part, keeps, fed, state in zip(assembly.parts, kept, feeds, states, strict=False):
        named = part.interface
        own_flags = [v.name for v in named.variables if v.type == "Boolean"]
        own_signals = [k for k, (source, _) in enumerate(assembly.signals) if source is part]
        rows.append(
            [
                f'"{part.name}"',
                f"KIND_{part.unit}",
                *(len(_reals(named, causality)) for causality in ("input", "output", "local")),
                *(_first(signals, part, _reals(named, causality)) for causality in ("output", "local")),
                _first(parameters, part, _reals(named, "parameter")),
                _first(flags, part, own_flags),
                len(own_flags),
                keeps,
                fed,
                own_signals[0],
                len(own_signals),
                state,
            ]
        )
    return rows


def _state_places(assembly: Assembly) -> Iterator[int]:
    """Yield the place of each continuous state in the assembly's memory.

    A shock's state is one of its signals, which follow what its model keeps; a vehicle's is a number that it keeps.
    """
    for part, keeps in zip(assembly.parts, accumulate(map(_kept, assembly.parts), initial=0), strict=False):
        named = part.interface
        if part.is_vehicle:
            yield from (keeps + place for place in _vehicle_places(part))
        for name in () if part.is_vehicle else named.states:
            yield keeps + max(1, part.states) + _reals(named, "input", "output", "local").index(name)


def _vehicle_places(part: Part) -> Iterator[int]:
    """Yield the place of each of a vehicle's continuous states in what its model keeps; deflections come last."""
    modes, bristles = int(re.findall(r"\bMODES = (\d+)", part.data)[0]), friction_ports(part.interface)
    for name in part.interface.states:
        if name.endswith(BRISTLE):
            yield part.states - len(bristles) + bristles.index(name.removesuffix(BRISTLE))
        else:
            number = int(re.findall(r"\[(\d+)\]", name)[0]) - 1
            yield number + (modes if "imaginary" in name else 0)


def _first(names: Sequence[str], part: Part, own: Sequence[str]) -> int:
    """Return the index of a part's first variable among all; 0 if it has none."""
    return names.index(f"{part.name}.{own[0]}") if own else 0


def _feeds(assembly: Assembly, interface: Interface) -> tuple[list[list[object]], list[list[object]]]:
    signals = [f"{part.name}.{name}" for part, name in assembly.signals]
    outside = interface.names("input")
    feeds: list[list[object]] = []
    terms: list[list[object]] = []
    for part in assembly.parts:
        for name in part.interface.names("input"):
            first = len(terms)
            for link in assembly.into(part, name):
                numbers = (c_number(value) for value in (link.gain, link.factor, link.offset_before_gain))
                terms.append([signals.index(link.source), *numbers])
            full = f"{part.name}.{name}"
            feeds.append([first, len(terms), outside.index(full) if full in outside else -1])
    return feeds, terms


# ---- The FMU --------------------------------------------------------------------------------------------------------


def without_binaries(assembly: Assembly, interface: Interface, fmi: int) -> Source:
    """Return the FMU of an FMI version, 2 or 3, without its binaries."""
    described = assembly.identifier, assembly.text, interface
    members = _assembly_documents(assembly, interface, fmi)
    return sealed(described, members, lambda guid: assembly_sources(assembly, interface, guid), fmi=fmi)


@dataclass(frozen=True)
class Assembled:
    """An assembled FMU that was written: its file, assembly, interface, platforms, and limits of its toolchain."""

    path: Path
    assembly: Assembly
    interface: Interface
    platforms: tuple[str, ...]
    limits: str

    @property
    def coupling_step(self) -> float:
        """Largest micro step of the coupling inside the FMU [s]; the start value of its parameter."""
        return coupling_step(self.interface)


def assemble(
    wiring: Wiring,
    path: str | Path,
    *,
    fmi: int = 2,
    progress: Progress | None = None,
) -> Assembled:
    """Write a system as one native FMU; the same system gives the same bytes.

    Args:
        wiring: Vehicle, shocks and connections to assemble; see `cosim.System.wiring`.
        path: FMU file to write; its name must be a C identifier.
        fmi: FMI version, 2 or 3.
        progress: Callback that receives the number of compiled binaries and the total number.

    Raises:
        FmuError: The system cannot be assembled, or there is no compiler, or it fails.
    """
    path = Path(path)
    if path.stem != fmu_identifier(path.stem):
        raise FmuError(
            f"{path}: {path.stem!r} is not a valid C identifier; use letters, digits and underscores, e.g. "
            f"{fmu_identifier(path.stem)}.fmu"
        )
    assembly = Assembly.of(wiring, path.stem)
    check_file(path, FMU)
    toolchain, interface = find_toolchain(), assembly_interface(assembly)
    (members,) = compiled([without_binaries(assembly, interface, fmi)], toolchain=toolchain, progress=progress)
    write_archive(path, members)
    platforms = tuple(platform.name for platform in toolchain.platforms)
    return Assembled(path, assembly, interface, platforms, toolchain.limits)
