"""Validity of an FMU's model and its reference results, and how its documents show quantities."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from enum import Enum
from pathlib import Path

import numpy as np

from builder.interface import Interface, Variable, friction_ports, spring_ports
from builder.product import Product
from eightpost import units
from eightpost.array_types import Array
from eightpost.errors import InputError
from eightpost.files import parse_json
from eightpost.shock import Shock, ShockLaw
from eightpost.shock.file import shock_uncertainty
from eightpost.validity import MEMBER, Range, Validity
from eightpost.vehicle import LinearStepper, StateSpace, StructuralVehicle, Vehicle, friction
from eightpost.vehicle.friction import PortFriction
from eightpost.vehicle.structural import doubts
from eightpost.verdict import Reason, Rules, Verdict

# ---- How much of an FMU's source its documents disclose -------------------------------------------------------------

#: Prefix of the variables that disclose the shape of a curve.
SECRET = "curve."


class Disclosure(Enum):
    """Amount of information in an archive about its source."""

    FULL = "full"
    """Everything: sources, pictures, coefficients, conditions, digests of the source files."""

    CONFIDENTIAL = "confidential"
    """Only what is needed to use the FMU: no sources, curve pictures, coefficients, or names of source files."""


# ---- Formatting of quantities for readers ---------------------------------------------------------------------------

Number = int | float


def quantity(value: Number | Sequence[Number], unit: str) -> str:
    """Return a value, or a range of two, with its unit.

    >>> quantity([-0.8, 0.75], "m/s")
    '-0.8 to 0.75 m/s'
    """
    numbers = [value] if isinstance(value, (int, float)) else value
    return f"{' to '.join(f'{number:.4g}' for number in numbers)} {_shown(unit)}".strip()


def customary(value: Number | Sequence[Number], unit: str) -> str:
    """Return a value or a range in US customary units; empty if only the SI unit is shown.

    >>> customary([-0.8, 0.75], "m/s")
    '-31.5 to 29.53 in/s'
    """
    if unit not in units.DISPLAY_UNITS:
        return ""
    target = units.DISPLAY_UNITS[unit][0]
    numbers = [value] if isinstance(value, (int, float)) else value
    return quantity([units.convert(float(number), unit, target) for number in numbers], target)


def start(variable: Variable) -> str:
    """Return a variable's start value in SI, with six digits, without its unit."""
    return "" if variable.start is None else _plain(variable.start)


def displayed_start(variable: Variable) -> str:
    """Return a variable's start value with its display unit; empty if it has no display unit."""
    if variable.unit is None or variable.display is None or variable.start is None:
        return ""
    return quantity(units.convert(float(variable.start), variable.unit, variable.display), variable.display)


def limits(variable: Variable) -> str:
    """Return a variable's range in SI, without its unit."""
    if variable.minimum is None and variable.maximum is None:
        return ""
    low = "−∞" if variable.minimum is None else _plain(variable.minimum)
    high = "∞" if variable.maximum is None else _plain(variable.maximum)
    return f"{low} … {high}"


def _plain(value: float | bool) -> str:
    return str(value).lower() if isinstance(value, bool) else f"{value:.6g}"


def _shown(unit: str) -> str:
    return "" if unit == "1" else {"degF": "°F", "deg": "°"}.get(unit, unit)


# ---- Reference results that any host must get from the FMU, in the format of the FMI cross-check rules --------------

STEP, COUNT = 1e-3, 1000

#: Allowed difference of a host's results.
RELATIVE_TOLERANCE = 1e-9

FOLDER = "extra/eightpost"

#: Amplitude of a vehicle's inputs by their unit, typical of a race car.
_AMPLITUDES = {"m": 0.005, "N": 300.0, "N.m": 200.0}

_NOTE = """Reference results of {identifier}, in the format of the FMI cross-check rules.

{identifier}_in.csv    inputs
{identifier}_ref.csv   outputs
{identifier}_ref.opt   start, stop and step [s], relative tolerance (of each output's largest value)

All values are in SI units; parameters have their start values. Inputs are held over each step: set the row at t, step
from t to t + {step:g} s, compare the outputs with the row at t + {step:g} s. The row at 0 holds the outputs after
initialization.
The results were computed from the equations in documentation/index.html, independently of the binaries.
"""


@dataclass(frozen=True)
class Reference:
    """Inputs and outputs by name: `u` (COUNT + 1, m) and `y` (COUNT + 1, p), SI, at t = 0, STEP, 2 STEP, ..."""

    inputs: tuple[str, ...]
    u: Array
    outputs: tuple[str, ...]
    y: Array


def _shock_reference(shock: Shock, outputs: Sequence[str]) -> Reference:
    """Return the response of a shock to a sum of sines whose speeds exceed the fitted range.

    `outputs` are names of `eightpost.shock.Response`.
    """
    u = rounded(_shock_inputs(shock.law))
    lagged = shock.law.start(u[0, 0])
    rows = [shock.law.response(lagged, u[0, 0], u[0, 1])]
    for velocity, displacement in u[:-1].tolist():
        lagged = shock.law.follow(lagged, velocity, velocity, STEP)
        rows.append(shock.law.response(lagged, velocity, displacement))
    y = np.array([[getattr(row, name) for name in outputs] for row in rows])
    return Reference(("velocity", "displacement"), u, tuple(outputs), y)


def _vehicle_reference(vehicle: Vehicle, interface: Interface) -> Reference | None:
    """Return the response of a vehicle to sums of sines at all inputs, with different frequencies at each input.

    The interface defines the static values that the FMU adds to its outputs. Returns None if the vehicle has no
    equilibrium; its FMU then refuses to start with its default parameters.
    """
    model = vehicle.coupled()
    stepper = LinearStepper(model.A, model.B, model.C, model.D)
    port_friction = _friction(model, stepper, interface)
    u = rounded(vehicle_inputs([channel.unit for channel in model.inputs]))
    try:
        x = friction.equilibrium(stepper, port_friction, u[0])
    except ValueError:
        return None
    rows = [friction.output(stepper, port_friction, x, u[0])]
    for held in u[:-1]:
        x = friction.advance(stepper, port_friction, x, held, held, STEP)
        rows.append(friction.output(stepper, port_friction, x, held))
    y = np.array(rows) + _offsets(interface, model.output_names)
    return Reference(model.input_names, u, model.output_names, y)


def _friction(model: StateSpace, stepper: LinearStepper, interface: Interface) -> PortFriction:
    """Return the friction and springs at the ports with the start values of the interface."""
    names = friction_ports(interface)
    ports = friction.named_ports(stepper, (model.input_names, model.output_names), names, spring_ports(interface))
    return PortFriction.of_values(ports, names, {v.name: float(v.start or 0.0) for v in interface.variables})


def reference_files(reference: Reference, identifier: str) -> dict[str, bytes]:
    """Return the files of the cross-check rules and a note on their use: member name -> content."""
    options = f"StartTime, 0.0\nStopTime, {COUNT * STEP}\nStepSize, {STEP}\nRelTol, {RELATIVE_TOLERANCE}\n"
    return {
        f"{FOLDER}/{identifier}_in.csv": csv(reference.inputs, reference.u),
        f"{FOLDER}/{identifier}_ref.csv": csv(reference.outputs, reference.y),
        f"{FOLDER}/{identifier}_ref.opt": options.encode(),
        f"{FOLDER}/README.txt": _NOTE.format(identifier=identifier, step=STEP).encode(),
    }


def results(product: Product, outputs: Sequence[str]) -> dict[str, bytes]:
    """Return the files of a product's reference results; `outputs` selects the outputs of a shock."""
    if isinstance(product.source, Shock):
        reference: Reference | None = _shock_reference(product.source, outputs)
    else:
        reference = _vehicle_reference(product.source, product.interface)
    return reference_files(reference, product.identifier) if reference else {}


def _offsets(interface: Interface, outputs: Sequence[str]) -> Array:
    """Return the offsets (p,) that the FMU adds to its outputs, in SI."""
    starts = {v.name: float(v.start or 0.0) for v in interface.variables}
    added = {v.name: starts[v.offset] if v.offset else 0.0 for v in interface.variables}
    return np.array([added[name] for name in outputs])


def _time() -> Array:
    return np.asarray(np.arange(COUNT + 1) * STEP, dtype=np.float64)


def _shock_inputs(law: ShockLaw) -> Array:
    """Return velocity [m/s] and displacement [m], its exact integral, (COUNT + 1, 2)."""
    speed = max(law.curve.compression_speed, law.curve.rebound_speed) / law.port.motion_ratio
    velocity, displacement = np.zeros(COUNT + 1), np.zeros(COUNT + 1)
    for share, frequency in ((0.8, 2.0), (0.35, 7.0), (0.15, 19.0)):
        rate = 2.0 * np.pi * frequency
        velocity += speed * share * np.sin(rate * _time())
        displacement += speed * share / rate * (1.0 - np.cos(rate * _time()))
    return np.column_stack([velocity, displacement])


def vehicle_inputs(input_units: Sequence[str]) -> Array:
    """Return a sum of two sines per input (COUNT + 1, m), with different frequencies at each input."""
    columns = []
    for k, unit in enumerate(input_units):
        slow, fast = (2.0 * np.pi * frequency * _time() for frequency in (1.0 + 0.37 * k, 6.0 + 0.83 * k))
        columns.append(_AMPLITUDES.get(unit, 1.0) * (np.sin(slow) + 0.3 * np.sin(fast)))
    return np.column_stack(columns)


def rounded(values: Array) -> Array:
    """Round each column (K, n) to 12 digits of its largest value.

    The last digits of a double differ between machines; with 12 digits the difference is almost never visible.
    """
    largest = np.abs(values).max(axis=0, initial=0.0)
    digits = 12 - np.ceil(np.log10(np.maximum(largest, 1e-3))).astype(int)
    return np.column_stack([np.round(values[:, k], digit) + 0.0 for k, digit in enumerate(digits.tolist())])


def csv(names: Sequence[str], values: Array) -> bytes:
    """Return columns (COUNT + 1, n) over time in the CSV format of the cross-check rules."""
    head = ",".join(f'"{name}"' for name in ("time", *names))
    lines = [
        ",".join(f"{value:.12g}" for value in (time, *row))
        for time, row in zip(rounded(_time()[:, None])[:, 0].tolist(), rounded(values).tolist(), strict=True)
    ]
    return "\n".join((head, *lines, "")).encode()


# ==== resources/eightpost.json: the validity of an FMU's model, which a run of the FMU reads =========================

RULES = Rules.read(Path(__file__).with_suffix(".txt"))


def validity_of(source: Shock | Vehicle) -> Validity:
    """Return the validity of a shock or vehicle; that of a shock contains the uncertainty of its fit."""
    if isinstance(source, Shock):
        known = source.validity or _unknown("fit of the shock unknown", source.name)
        return replace(known, uncertainty=shock_uncertainty(source), judged=None)
    if isinstance(source, StructuralVehicle):
        figure = f"{len(fields(source.parameters))} parameters"
        summary = "the car's parameters were stated, not identified"
        stated = RULES.reason("vehicle of stated parameters", summary, figure, origin=source.name)
        return Validity(Verdict([stated, *_doubtful(source)]))
    if source.validity is not None:
        return replace(source.validity, judged=None)
    return _unknown("fit of the vehicle unknown", source.name)


def _doubtful(source: StructuralVehicle) -> Iterator[Reason]:
    for doubt in doubts(source.parameters):
        rule = "impossible parameters" if doubt.is_gross else "implausible parameters"
        statement = "the parameters are those of no car" if doubt.is_gross else "the parameters are unusual"
        yield RULES.reason(rule, statement, figure=doubt.summary, origin=source.name, remedy=doubt.remedy)


def validity_member(source: Shock | Vehicle, identifier: str, disclosure: Disclosure) -> dict[str, bytes]:
    """Return the archive's member; a confidential archive has the FMU's name in place of file names."""
    known = validity_of(source)
    if disclosure is Disclosure.CONFIDENTIAL:
        reasons = (replace(reason, origin=identifier) for reason in known.verdict.reasons)
        known = replace(known, verdict=Verdict(reasons))
    return _member(known)


def combined_member(
    parts: Mapping[str, bytes | None], fed: Mapping[str, str], variables: frozenset[str]
) -> dict[str, bytes]:
    """Return the member of an FMU that is assembled from other FMUs.

    Args:
        parts: Content of this member in each part, by component name; None if a part has no such member.
        fed: Source of each input that is connected without a factor, both as `component.variable`.
        variables: Names of the assembled FMU's variables; a variable of a part is named `component.variable`.
    """
    verdicts, ranges = [], list[Range]()
    for name, content in parts.items():
        known = _read_validity(content) or _unknown("fit of the shock unknown", name)
        verdicts.append(Verdict(replace(r, origin=f"{name}: {r.origin}") for r in known.verdict.reasons))
        places = [f"{name}.{covered.variable}" for covered in known.ranges]
        named = [replace(c, variable=fed.get(place, place)) for c, place in zip(known.ranges, places, strict=True)]
        ranges += [covered for covered in named if covered.variable in variables or covered.kind == "condition"]
    return _member(Validity(Verdict.combined(verdicts), tuple(dict.fromkeys(ranges))))


def _read_validity(content: bytes | None) -> Validity | None:
    """Return the validity in a member; None if there is no member or it cannot be read."""
    try:
        return None if content is None else Validity.from_json(parse_json(content, MEMBER))
    except InputError:
        return None


def _unknown(rule: str, origin: str) -> Validity:
    reason = RULES.reason(rule, "how good the fit is was not recorded", figure="0 findings stated", origin=origin)
    return Validity(Verdict([reason]))


def _member(known: Validity) -> dict[str, bytes]:
    return {MEMBER: (json.dumps(known.to_json(), indent=1, allow_nan=False) + "\n").encode()}
