"""What an FMU is built from: a shock or vehicle, its variables, its states."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from builder.interface import (
    Interface,
    Variable,
    chosen,
    friction_ports,
    read_table,
    shock_interface,
    spring_ports,
    steady_terms,
    variable_of,
    vehicle_interface,
    with_springs,
)
from eightpost.array_types import Array
from eightpost.corners import CORNERS
from eightpost.errors import FmuError
from eightpost.shock import Settings, Shock
from eightpost.vehicle import Friction, IdentifiedVehicle, StateSpace, Vehicle
from eightpost.vehicle.modal import ModalForm, modal_form

# ---- Continuous states of a vehicle: modes of its model and bristles, their variables and dependencies --------------

#: Terms below this share of the largest one of an input or an output are rounding errors, not dependencies.
_ROUNDING = 1e-12

#: Size of an output in motion, by its unit: the nominal value of a mode moves one of the outputs that far.
_SIZES = {"m": 0.01, "m/s": 0.1, "m/s2": 5.0, "N": 500.0, "N.m": 500.0, "rad": 0.01, "rad/s": 0.1}

_KEY = "<mode>"


def _with_modes(interface: Interface, model: StateSpace) -> Interface:
    """Return the interface of a vehicle with its modes, and the bristles of its ports, as continuous states.

    A model with more modes than there are value references for has none: its FMU offers co-simulation only.
    """
    table = read_table("vehicle_ss")["variable"]
    rows = [row for row in table if _KEY in row["name"]]
    form = modal_form(model)
    if form.sigma.size > min(row["size"] for row in rows):
        return interface
    bristles = _bristles([row for row in table if "bristle_deflection" in row["name"]], friction_ports(interface))
    named = replace(
        interface, variables=(*interface.variables, *_variables(rows, form, _nominals(form, model)), *bristles)
    )
    direct, initial = _Dependencies(named, model, form).sections()
    return replace(named, direct=direct, initial=initial)


def _variables(rows: Sequence[Mapping[str, Any]], form: ModalForm, nominals: Array) -> Iterator[Variable]:
    """Yield real parts, imaginary parts of the pairs, and the derivatives of both."""
    for row in rows:
        count, offset = (form.pairs, form.sigma.size) if "imaginary" in row["name"] else (form.sigma.size, 0)
        for k in range(count):
            variable = variable_of(row, _named(row["name"], k), row["reference"] + k, None)
            if of := row.get("derivative_of"):
                yield replace(variable, derivative_of=_named(of, k))
            else:
                yield replace(variable, nominal=float(nominals[offset + k]))


def _bristles(rows: Sequence[Mapping[str, Any]], ports: Sequence[str]) -> Iterator[Variable]:
    """Yield the deflections of the bristles at the ports, and their derivatives."""
    for row in rows:
        for port in ports:
            name, offset = row["name"].replace("<corner>.", port), _corner_place(port)
            variable = variable_of(row, name, row["reference"] + offset, None)
            if of := row.get("derivative_of"):
                variable = replace(variable, derivative_of=of.replace("<corner>.", port))
            yield variable


def _corner_place(port: str) -> int:
    return CORNERS.index(port.removesuffix(".")) if port else 0


def _named(name: str, k: int) -> str:
    return name.replace(_KEY, str(k + 1))


def _states_of(form: ModalForm, re: Array, im: Array) -> Array:
    """Return rows (n, ...) of the continuous states from rows (K, ...) of real and imaginary parts."""
    return np.concatenate([re, im[: form.pairs]])


def _nominals(form: ModalForm, model: StateSpace) -> Array:
    """Return the nominal value of each state (n,), rounded to a power of two."""
    gains = np.abs(_states_of(form, form.C_re.T, form.C_im.T))
    sizes = np.array([_SIZES.get(channel.unit, 1.0) for channel in model.outputs])
    largest = (gains / sizes).max(axis=1, initial=0.0)
    exponents = np.round(np.log2(np.where(largest > 0.0, largest, 1.0)))
    return np.asarray(np.exp2(-exponents))


class _Dependencies:
    """Which states and inputs the outputs and derivatives of a vehicle depend on: n states of modes, P bristles."""

    def __init__(self, interface: Interface, model: StateSpace, form: ModalForm) -> None:
        self.interface, self.model, self.ports = interface, model, friction_ports(interface)
        self.into = self._with_rows(_terms(_states_of(form, form.B_re, form.B_im)))  # (n + P, m)
        out = _terms(_states_of(form, form.C_re.T, form.C_im.T)).T
        self.out = self._with_rows(out.T).T  # (p, n + P)
        at_rest = form.at_rest() if form.steady else 0j * form.B_re
        rest = _states_of(form, np.asarray(at_rest.real, dtype=np.float64), np.asarray(at_rest.imag, dtype=np.float64))
        self.rest = self._with_rows(_terms(rest))  # (n + P, m): the steady state of constant inputs
        count, pairs = form.sigma.size, np.arange(form.pairs)
        self.own = np.eye(len(self.into), dtype=bool)  # (n + P, n + P): a pair's parts depend on each other
        self.own[pairs, count + pairs] = self.own[count + pairs, pairs] = True
        coupled = slice(form.uncoupled, count)
        self.own[coupled, coupled] |= form.coupling != 0.0
        self.own[len(rest) :] |= self.out[self._outputs("velocity", self.ports)]

    def _with_rows(self, terms: Any) -> Any:
        """Return the terms (n, ...) with rows of the bristles (n + P, ...), which are false."""
        return np.concatenate([terms, np.zeros((len(self.ports), terms.shape[1]), dtype=bool)])

    def sections(self) -> tuple[dict[str, tuple[str, ...]], dict[str, tuple[str, ...]]]:
        """Return the fields `direct` and `initial` of the interface."""
        named, states = self.interface, self.interface.states
        inputs, outputs = self.model.input_names, self.model.output_names
        rubbed = self._port_forces()
        direct = dict(named.direct)
        for name, row in zip(outputs, self.out | (self._of_forces(self.model.D != 0.0) @ rubbed), strict=True):
            direct[name] = (*direct[name], *chosen(states, row))
        moved = self.own | (self._of_forces(self.into) @ rubbed)
        for name, by_input, by_state in zip(named.derivatives, self.into, moved, strict=True):
            direct[name] = (*chosen(inputs, by_input), *chosen(states, by_state))
        return direct, dict(named.initial) | self._at_start()

    def _at_start(self) -> dict[str, tuple[str, ...]]:
        """Return what states depend on at a start in equilibrium, and their derivatives at a start from zero."""
        named, found, springs = self.interface, {}, spring_ports(self.interface)
        steady = steady_terms(self.model)
        rest, of_springs = with_springs(self.rest, steady, self.model, springs)
        none = [()] * len(self.into)
        for names, terms, parameters in ((named.states, rest, of_springs), (named.derivatives, self.into, none)):
            for name, row, others in zip(names, terms, parameters, strict=True):
                known = chosen(self.model.input_names, row)
                found[name] = (*known, *(("start_at_equilibrium",) if known else ()), *others)
        return found

    def _port_forces(self) -> Any:
        """Return the states (P, n + P) that friction and spring of each port depend on."""
        springs = spring_ports(self.interface)
        found = self.out[self._outputs("velocity", self.ports)]
        for port, row in zip(springs, self.out[self._outputs("displacement", springs)], strict=True):
            found[self.ports.index(port)] |= row
        count = len(self.ports)
        found[:, found.shape[1] - count :] |= np.eye(count, dtype=bool)
        return found

    def _outputs(self, quantity: str, ports: Sequence[str]) -> list[int]:
        return [self.model.output_names.index(f"{port}{quantity}") for port in ports]

    def _of_forces(self, terms: Any) -> Any:
        """Return the columns (..., P) of the forces at the ports with friction."""
        return terms[:, [self.model.input_names.index(f"{port}force") for port in self.ports]]


def _terms(gains: Array) -> Any:
    """Return which gains (n, k) are more than rounding errors of the largest one in their column."""
    sizes = np.abs(gains)
    return (sizes > 0.0) & (sizes > _ROUNDING * sizes.max(axis=0, initial=0.0))


# ---- Variables of a shock's adjusters and temperature, and of what is known about their setting ---------------------

#: Local variable that reports the distance from the measured settings.
BEYOND_SETTINGS = "beyond_settings"

#: First value references: of what is reported, of the temperature, of the adjusters. They are free in shock.toml.
_REPORTED, _TEMPERATURE, _CLICKS = 290, 295, 300


def _with_settings(interface: Interface, settings: Settings, *, temperature_input: bool = False) -> Interface:
    """Return a shock's interface with its adjusters and temperature; force and states depend on all of them."""
    if temperature_input and not any(axis.is_temperature for axis in settings.axes):
        raise FmuError(
            "the shock has no temperature that could be an input: its files were not fitted over the temperature"
        )
    added = tuple(_setting_variables(settings, temperature_input=temperature_input))
    known = tuple(v.name for v in added if v.causality != "local")
    inputs = tuple(v.name for v in added if v.causality == "input")
    return replace(
        interface,
        variables=(*interface.variables, *added),
        direct={name: (*names, *inputs) for name, names in interface.direct.items()},
        initial={
            name: names if name in interface.derivatives else (*names, *known)  # which are zero in equilibrium
            for name, names in interface.initial.items()
        },
    )


#: Rows of what is reported: name and description.
_REPORTS = (
    (BEYOND_SETTINGS, "Distance of the setting beyond the measured ones, in intervals between them; 0 within"),
    (
        "untested_settings",
        "1 while this combination of settings was not measured, so that interactions are unknown, else 0",
    ),
)


def _setting_variables(settings: Settings, *, temperature_input: bool) -> Iterator[Variable]:
    for k, (name, text) in enumerate(_REPORTS):
        yield variable_of({"causality": "local", "unit": "1", "description": text}, name, _REPORTED + k, None)
    adjusters = [axis for axis in settings.axes if not axis.is_temperature]
    for axis in settings.axes:
        low, high = axis.nodes[0], axis.nodes[-1]
        row: dict[str, Any] = {"causality": "parameter", "variability": "tunable"}
        if axis.is_temperature:
            row = {"causality": "input"} if temperature_input else row
            text = f"Temperature of the shock, measured from {low:.5g} to {high:.5g} K"
            row |= {"unit": "K", "display": "degC", "min": 1.0, "description": text}
            reference = _TEMPERATURE
        else:
            what = f"clicks {axis.counted}".strip() if axis.is_whole else axis.unit
            text = f"Setting of the adjuster {axis.name} in {what}, measured from {low:g} to {high:g}"
            row |= {"unit": "1", "min": axis.lowest, "max": axis.highest, "description": text}
            reference = _CLICKS + adjusters.index(axis)
        yield variable_of(row, axis.variable, reference, axis.reference)


# ---- Content of an FMU ----------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Product:
    """One FMU to build: its C name, a one-line description, its variables, and the shock or vehicle it represents."""

    identifier: str
    text: str
    interface: Interface
    source: Shock | Vehicle


def shock_product(shock: Shock, identifier: str, *, temperature_input: bool = False) -> Product:
    """Return the product for a shock.

    Args:
        shock: Shock, with or without settings.
        identifier: C name of the FMU.
        temperature_input: Whether the temperature is an input instead of a parameter.

    Raises:
        FmuError: The temperature is to be an input, but the shock has none.
    """
    interface = shock_interface(shock)
    if shock.settings is not None:
        interface = _with_settings(interface, shock.settings, temperature_input=temperature_input)
    elif temperature_input:
        raise FmuError(f"shock {shock.name!r} has no temperature that could be an input (eightpost settings)")
    return Product(identifier, f"{interface.description}: {shock.name}", interface, shock)


def vehicle_product(vehicle: Vehicle, identifier: str) -> Product:
    """Return the product for a vehicle: its model without dampers at the ports, and its static state.

    Raises:
        FmuError: The model is discrete or not stable, has feedthrough to a shock velocity, or has a channel that
            vehicle_ss does not have.
    """
    model = vehicle.coupled()
    if model.dt is not None:
        raise FmuError(f"vehicle {vehicle.name!r} is a discrete model; convert it to continuous time first")
    if isinstance(vehicle, IdentifiedVehicle) and (growing := vehicle.instability()) is not None:
        raise FmuError(
            f"vehicle {vehicle.name!r} is not stable: {growing}, so that runs with it diverge; identify it with more "
            "or longer tests, or without the channels that fit worst (--set output-channels)"
        )
    _refuse_direct_velocity(model)
    interface = _with_modes(vehicle_interface(model), model)
    starts = {v.offset: vehicle.static.get(v.name, 0.0) for v in interface.variables if v.offset}
    if isinstance(vehicle, IdentifiedVehicle):
        starts |= _friction_starts(vehicle.friction, interface)
    variables = tuple(replace(v, start=starts[v.name]) if v.name in starts else v for v in interface.variables)
    interface = replace(interface, variables=variables)
    return Product(identifier, f"{interface.description}: {vehicle.name}", interface, vehicle)


def _refuse_direct_velocity(model: StateSpace) -> None:
    """Raise an error if a shock velocity has feedthrough: it would make an algebraic loop with the shock."""
    for channel, terms in zip(model.outputs, model.D != 0.0, strict=True):
        if channel.name.rpartition(".")[2] == "velocity" and terms.any():
            inputs = ", ".join(c.name for c, term in zip(model.inputs, terms, strict=True) if term)
            raise FmuError(
                f"vehicle {model.name!r}: {channel.name} has feedthrough from {inputs} (D is not zero there), which "
                "makes an algebraic loop with the shock; identify it without feedthrough to the shock velocities"
            )


def _friction_starts(friction: Mapping[str, Friction], interface: Interface) -> dict[str, float]:
    """Return the start values of friction and springs at the ports; `friction` holds them by port."""
    starts: dict[str, float] = {}
    for port, law in friction.items():
        prefix = f"{port}." if port else ""
        if law.spring and prefix not in spring_ports(interface):
            raise FmuError(
                f"the port {port!r} has a spring, but {prefix}displacement has feedthrough, which makes an algebraic "
                "loop with the spring; identify it without feedthrough, or remove the spring"
            )
        own = {f"bristle_{name}": value for name, value in asdict(law.bristle).items()}
        own |= {"friction_force": law.force, "friction_velocity": law.velocity}
        own |= {"port_spring": law.spring} if prefix in spring_ports(interface) else {}
        starts |= {f"{prefix}{name}": value for name, value in own.items()}
    return starts
