"""The continuous states of a vehicle FMU: modes of its model and bristles, their variables and their dependencies."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from builder.fmu.interface import (
    Interface,
    Variable,
    friction_ports,
    read_table,
    spring_ports,
    steady_terms,
    variable_of,
)
from builder.fmu.port_springs import springs_of, with_springs
from eightpost.array_types import Array
from eightpost.corners import CORNERS
from eightpost.vehicle import StateSpace
from eightpost.vehicle.modal import ModalForm, modal_form

#: Terms below this share of the largest one of an input or an output are rounding errors, not dependencies.
_ROUNDING = 1e-12

#: Size of an output in motion, by its unit: the nominal value of a mode moves one of the outputs that far.
_SIZES = {"m": 0.01, "m/s": 0.1, "m/s2": 5.0, "N": 500.0, "N.m": 500.0, "rad": 0.01, "rad/s": 0.1}

_KEY = "<mode>"


def with_modes(interface: Interface, model: StateSpace) -> Interface:
    """Return the interface of a vehicle with its modes, and the bristles of its ports, as continuous states.

    A model with more modes than there are value references for has none: its FMU offers co-simulation only.

    Args:
        interface: Variables of the vehicle.
        model: Model of the vehicle, with the same inputs and outputs.
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
        rest = _states_of(form, np.asarray(at_rest.real), np.asarray(at_rest.imag))
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
            direct[name] = (*direct[name], *_chosen(states, row))
        moved = self.own | (self._of_forces(self.into) @ rubbed)
        for name, by_input, by_state in zip(named.derivatives, self.into, moved, strict=True):
            direct[name] = (*_chosen(inputs, by_input), *_chosen(states, by_state))
        return direct, dict(named.initial) | self._at_start()

    def _at_start(self) -> dict[str, tuple[str, ...]]:
        """Return what states depend on at a start in equilibrium, and their derivatives at a start from zero."""
        named, found, springs = self.interface, {}, spring_ports(self.interface)
        steady = steady_terms(self.model)
        rest = with_springs(self.rest, steady, self.model, springs)
        of_springs = springs_of(self.rest, steady, self.model, springs)
        none = [()] * len(self.into)
        for names, terms, parameters in ((named.states, rest, of_springs), (named.derivatives, self.into, none)):
            for name, row, others in zip(names, terms, parameters, strict=True):
                known = _chosen(self.model.input_names, row)
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


def _chosen(names: Sequence[str], row: Any) -> tuple[str, ...]:
    return tuple(name for name, term in zip(names, row, strict=True) if term)
