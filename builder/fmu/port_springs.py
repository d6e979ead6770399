"""Effect of port springs on what a vehicle's start depends on: in the steady state, springs act on each other."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from eightpost.vehicle import StateSpace

#: A matrix of truths: which rows depend on which columns.
Terms = Any


def with_springs(terms: Terms, steady: Terms, model: StateSpace, ports: Sequence[str]) -> Terms:
    """Return which values of the steady state depend on which inputs (k, m), with springs at the ports.

    Args:
        terms: Dependencies of the values on the inputs without springs (k, m).
        steady: The same of the outputs (p, m).
        model: Model of the vehicle.
        ports: Prefixes of the ports that can have a spring: "lf.", ..., or "" for a quarter car.
    """
    return terms | (_forces(terms, steady, model, ports) @ _moved(steady, model, ports))


def springs_of(terms: Terms, steady: Terms, model: StateSpace, ports: Sequence[str]) -> list[tuple[str, ...]]:
    """Return the names of the spring parameters that each value (k) depends on; see `with_springs`."""
    acting = _forces(terms, steady, model, ports)
    return [tuple(f"{port}port_spring" for port, acts in zip(ports, row, strict=True) if acts) for row in acting]


def _forces(terms: Terms, steady: Terms, model: StateSpace, ports: Sequence[str]) -> Terms:
    """Return which springs (k, springs) the values depend on, through any chain of springs."""
    columns = [model.input_names.index(f"{port}force") for port in ports]
    linked = np.eye(len(ports), dtype=bool) | _moved(steady, model, ports)[:, columns]
    for _ in ports:
        linked = linked @ linked
    return terms[:, columns] @ linked


def _moved(steady: Terms, model: StateSpace, ports: Sequence[str]) -> Terms:
    """Return which inputs move the springs (springs, m)."""
    return steady[[model.output_names.index(f"{port}displacement") for port in ports]]
