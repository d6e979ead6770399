"""An FMU's interface: the table of interface.toml, made whole for one shock or one vehicle.

modelDescription.xml, the python slave's table and the documentation are all derived from it.
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from operator import attrgetter
from typing import TYPE_CHECKING, Any

import numpy as np

from builder.sources import source_folder
from eightpost.errors import FmuError

if TYPE_CHECKING:
    from eightpost.shock import Shock
    from eightpost.vehicle import StateSpace

#: The order of a row's references: docs/ports.md.
CORNERS = ("lf", "rf", "lr", "rr")

#: Units of what is zero in any steady state.
RATES = ("m/s", "rad/s", "m/s2")

_KEYS = {
    "name",
    "reference",
    "type",
    "causality",
    "variability",
    "unit",
    "display",
    "start",
    "min",
    "max",
    "size",
}
_KEYS |= {"description", "offset", "with", "at_start"}


@dataclass(frozen=True)
class Variable:
    """One scalar variable of an FMU.

    `offset` names the parameter that is added to an output.
    """

    name: str
    reference: int
    type: str
    causality: str
    variability: str
    unit: str | None
    display: str | None
    start: float | bool | None
    minimum: float | None
    maximum: float | None
    description: str
    offset: str | None = None

    @property
    def initial(self) -> str | None:
        """FMI's `initial`: parameters are given, outputs and locals follow, inputs have none."""
        return {"parameter": "exact", "output": "calculated", "local": "calculated"}.get(self.causality)


@dataclass(frozen=True)
class Interface:
    """All variables of one FMU, and what each output depends on.

    `direct` holds per output the inputs that it follows without delay, `initial` all that its initial value follows.
    """

    kind: str
    version: str
    description: str
    variables: tuple[Variable, ...]
    direct: Mapping[str, tuple[str, ...]]
    initial: Mapping[str, tuple[str, ...]]

    def names(self, causality: str) -> tuple[str, ...]:
        """Return the names of all variables of a causality, in order."""
        return tuple(v.name for v in self.variables if v.causality == causality)


def shock_interface(shock: Shock) -> Interface:
    """Return the interface of a shock's FMU with the shock's parameters as start values."""
    table = read_table(f"shock_{shock.law_name}")
    variables = tuple(v for row in table["variable"] for v in _sized(row, shock.law))
    # The start is an equilibrium: what only says how the lag goes on has no part in it.
    idle = {row["name"] for row in table["variable"] if not row.get("at_start", True)}
    parameters = tuple(v.name for v in variables if v.causality == "parameter" and v.name not in idle)
    direct = {name: tuple(inputs) for name, inputs in table["dependencies"].items()}
    return Interface(
        kind=table["interface"],
        version=table["version"],
        description=table["description"],
        variables=variables,
        direct=direct,
        initial={name: inputs + parameters for name, inputs in direct.items()},
    )


def vehicle_interface(model: StateSpace) -> Interface:
    """Return the interface of a vehicle's FMU: the rows of vehicle_ss that its model has.

    Raises:
        FmuError: The model has a channel that no row knows, or one with another unit or on the wrong side.
    """
    table = read_table("vehicle_ss")
    channels = {c.name: ("input", c.unit) for c in model.inputs} | {c.name: ("output", c.unit) for c in model.outputs}
    variables = tuple(v for row in table["variable"] for v in _cornered(row) if _wanted(row, v, channels))
    _check_channels(model.name, channels, variables)
    return Interface(
        kind=table["interface"],
        version=table["version"],
        description=table["description"],
        variables=variables,
        direct=_depends(model, model.direct_terms(), {}),
        initial=_depends(model, model.direct_terms() | _steady_terms(model), {v.name: v.offset for v in variables}),
    )


def friction_ports(interface: Interface) -> tuple[str, ...]:
    """Return the ports of a vehicle that take suspension friction, in order: "lf.", ..., or "" for a quarter car."""
    last = "friction_force"
    return tuple(v.name.removesuffix(last) for v in interface.variables if v.name.endswith(last))


def read_table(folder: str) -> dict[str, Any]:
    """Return interface.toml of a folder of fmus/, with what it extends."""
    path = source_folder() / folder / "interface.toml"
    table: dict[str, Any] = tomllib.loads(path.read_text(encoding="utf-8"))
    if base := table.get("extends"):
        common = tomllib.loads((path.parent / base).read_text(encoding="utf-8"))
        table["variable"] = common["variable"] + table.get("variable", [])
        table["dependencies"] = common.get("dependencies", {}) | table.get("dependencies", {})
    for row in table["variable"]:
        if unknown := sorted(set(row) - _KEYS):
            raise FmuError(f"{path}: {row.get('name')}: unknown {', '.join(unknown)}")
    return table


def _variable(row: Mapping[str, Any], name: str, reference: int, start: Any, offset: str | None = None) -> Variable:
    return Variable(
        name=name,
        reference=reference,
        type=row.get("type", "Real"),
        causality=row["causality"],
        variability=row.get("variability", "continuous"),
        unit=row.get("unit"),
        display=row.get("display"),
        start=0.0 if start is None and row["causality"] == "input" else start,
        minimum=row.get("min"),
        maximum=row.get("max"),
        description=row["description"],
        offset=offset,
    )


def _sized(row: Mapping[str, Any], law: Any) -> Sequence[Variable]:
    """Give a row its start from the law; a row with a size becomes name[1], name[2], ..."""
    start = attrgetter(row["start"])(law) if "start" in row else None
    if "size" not in row:
        return [_variable(row, row["name"], row["reference"], start)]
    assert start is not None and len(start) == row["size"]
    return [_variable(row, f"{row['name']}[{k + 1}]", row["reference"] + k, start[k]) for k in range(row["size"])]


def _cornered(row: Mapping[str, Any]) -> Sequence[Variable]:
    """A row with <corner> becomes one variable per corner, and one without the corner for a quarter car."""
    name, start, offset = row["name"], row.get("start"), row.get("offset")
    if "<corner>" not in name:
        return [_variable(row, name, row["reference"], start, offset)]
    prefixes = [f"{corner}." for corner in CORNERS] + [""]
    return [
        _variable(
            row,
            name.replace("<corner>.", prefix),
            row["reference"] + k % len(CORNERS),
            start,
            offset.replace("<corner>.", prefix) if offset else None,
        )
        for k, prefix in enumerate(prefixes)
    ]


def _wanted(row: Mapping[str, Any], variable: Variable, channels: Mapping[str, tuple[str, str]]) -> bool:
    if variable.causality != "parameter":
        return variable.name in channels
    if "with" not in row:
        return True
    corner, dot, _ = variable.name.rpartition(".")
    partners = [row["with"]] if isinstance(row["with"], str) else row["with"]
    return all(partner.replace("<corner>.", corner + dot) in channels for partner in partners)


def _check_channels(model: str, channels: Mapping[str, tuple[str, str]], variables: Sequence[Variable]) -> None:
    known = {v.name: (v.causality, v.unit) for v in variables}
    for name, (side, unit) in channels.items():
        if known.get(name) != (side, unit):
            raise FmuError(
                f"vehicle {model!r}: its {side} {name!r} [{unit}] is not a port of vehicle_ss; docs/ports.md lists the "
                "names, sides and units. Rename the channel or select the others"
            )


def _depends(
    model: StateSpace, terms: np.ndarray[Any, np.dtype[np.bool_]], offsets: Mapping[str, str | None]
) -> dict[str, tuple[str, ...]]:
    depends = {}
    for channel, row in zip(model.outputs, terms, strict=True):
        names = [c.name for c, term in zip(model.inputs, row, strict=True) if term]
        if offsets:
            names += ([offset] if (offset := offsets[channel.name]) else []) + (
                ["start_at_equilibrium"] if names else []
            )
        depends[channel.name] = tuple(names)
    return depends


def _steady_terms(model: StateSpace) -> np.ndarray[Any, np.dtype[np.bool_]]:
    """Return where the steady state follows an input, (p, m); everywhere if there is no steady state."""
    try:
        gain = model.dc_gain()
    except ValueError:
        return np.ones(model.D.shape, dtype=bool)
    scale = np.abs(gain).max(axis=1, keepdims=True)
    rate = np.array([channel.unit in RATES for channel in model.outputs])
    return np.asarray((np.abs(gain) > 1e-9 * scale) & ~rate[:, None])
