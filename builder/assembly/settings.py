"""The law and the settings of a shock, read from the contents of its FMU."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Mapping, Sequence

from builder.fmu.interface import Interface, own_value
from eightpost.shock import LAWS, Axis, Port, Settings, ShockLaw, StaticCurve, Term, own_parameters
from eightpost.shock.curve import KNOTS
from eightpost.shock.settings import LAGGED_SLOPE, TEMPERATURE


def law_of(kind: str, values: Mapping[str, float | bool]) -> ShockLaw:
    """Return a shock's law for the values of its variables.

    Args:
        kind: Kind of the interface, such as `shock_lpf1`.
        values: Values by name, as in the FMU of the shock.
    """
    numbers = {name: float(value) for name, value in values.items()}
    law = LAWS[kind.removeprefix("shock_")]
    lists: dict[str, tuple[float, ...]] = {}
    for name, value in numbers.items():
        if found := re.fullmatch(r"curve\.(\w+)\[\d+\]", name):
            lists[found[1]] = (*lists.get(found[1], ()), value)
    scalars = {name.removeprefix("curve."): value for name, value in numbers.items() if name.startswith("curve.")}
    curve = {f.name: lists.get(f.name, scalars.get(f.name)) for f in dataclasses.fields(StaticCurve)}
    port = Port(**{f.name: numbers[f.name] for f in dataclasses.fields(Port)})
    own = {name: own_value(law, name, numbers) for name in own_parameters(law)}
    return law(curve=StaticCurve(**curve), port=port, **own)  # type: ignore[arg-type]


def settings_of(data: str, interface: Interface) -> Settings:
    """Return the settings in a settings_data.h; texts that no calculation needs are empty, bands are zero.

    Args:
        data: Content of the file, as builder/native/settings_data.py writes it.
        interface: Interface of the FMU.

    Raises:
        ValueError: The content does not have this form.
        KeyError: A table is missing.
    """
    tables: dict[str, str] = dict(re.findall(r"(\w+)(?:\[\w+\])+ = (\{.*?\});", data, flags=re.DOTALL))
    counts = [int(count) for count in re.findall(r"\d+", tables["node_counts"])]
    axes = tuple(_axes(data, _rows(tables["axis_nodes"]), counts, interface))
    deviations = _rows(tables["deviations"])
    terms = []
    for places, rows, first in re.findall(r"\{\d+, \{([^}]*)\}, (\d+), (\d+)\}", tables["terms"]):
        names = tuple(axes[int(place)].name for place in places.split(","))
        terms.append(Term(names, deviations[int(first) : int(first) + int(rows)]))
    tested = _rows(tables["tested"])
    return Settings(axes, _parameters(data), tuple(terms), tested, ((0.0,) * KNOTS,) * len(tested))


def _axes(data: str, nodes: Sequence[tuple[float, ...]], counts: Sequence[int], interface: Interface) -> list[Axis]:
    starts = {v.name.replace(".", "_"): v for v in interface.variables}
    members = re.findall(r"setting\[\d+\] = v->named\.\w+\.(\w+);", data)
    axes = []
    for member, row, count in zip(members, nodes, counts, strict=True):
        variable = starts[member]
        name = variable.name.removeprefix("clicks.")
        unit = "K" if name == TEMPERATURE else "click"
        axes.append(Axis(name, row[:count], float(variable.start or 0.0), unit))
    return axes


def _parameters(data: str) -> tuple[str, ...]:
    factors = dict.fromkeys(re.findall(r"now->(\w+)(?:\[\d+\])? \*= exponential", data))
    lagged = "curve_lagged_slope[k] + changes[k]" in data
    return (*([LAGGED_SLOPE] if lagged else []), *factors)


def _rows(table: str) -> tuple[tuple[float, ...], ...]:
    """Return the rows of numbers of a C initializer of two levels."""
    return tuple(tuple(float(cell) for cell in row.split(",")) for row in re.findall(r"\{([^{}]+)\}", table))
