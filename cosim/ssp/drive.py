"""Data for the open inputs of a package: a drive file and constants, by variable or by connector."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from cosim.component import DISCRETE, Variable
from cosim.conversion import Conversion, convert_between, named_unit, to_si
from cosim.ssp.flatten import Network, Path, Port, compose
from cosim.ssp.structure import FmuElement
from eightpost import units
from eightpost.errors import UnknownUnitError, WiringError
from eightpost.signals import Drivefile, TimeSeries

Array = NDArray[np.float64]


@dataclass(frozen=True)
class OpenInputs:
    """Inputs for numbers that no other FMU feeds.

    Args:
        network: Network of the package.
        names: Component names by path.
    """

    network: Network
    names: Mapping[Path, str]

    @cached_property
    def ports(self) -> tuple[Port, ...]:
        """Open inputs in the order of the components."""
        numbers = ("Real", *DISCRETE)
        return tuple(
            port for port in self.network.inputs() if self._variable(port).type in numbers and not self._is_fed(port)
        )

    def full_name(self, port: Port) -> str:
        """Return `component.variable`."""
        return f"{self.names[port.path]}.{port.name}"

    def drive(self, given: Drivefile) -> Drivefile:
        """Return a drive file with one channel for each input, under its full name.

        Raises:
            WiringError: A channel has no input, or two have the same.
        """
        channels: dict[str, tuple[str, Array]] = {}
        for name, unit in zip(given.names, given.units, strict=True):
            for port, start in self._reached(name, f"drive file channel {name!r}"):
                if self.full_name(port) in channels:
                    raise WiringError(f"two channels of the drive file feed {port}; keep one")
                channels[self.full_name(port)] = self._channel(given, (name, unit), (port, start))
        return Drivefile(TimeSeries.from_channels(given.series.time, channels))

    def fixed(self, known: Mapping[Port, float], given: Mapping[str, str], driven: Collection[str]) -> dict[str, float]:
        """Return the constant values of inputs by full name.

        Args:
            known: Values from the package; the drive file takes precedence over them.
            given: Texts by name: a number in the unit of the named port, or a value with its unit; they take
                precedence over the package.
            driven: Full names of the inputs that the drive file feeds.

        Raises:
            WiringError: There is no such open input, the drive file feeds it too, or the text is not a value.
        """
        found = {self.full_name(port): value for port, value in known.items()}
        found = {name: value for name, value in found.items() if name not in driven}
        for name, text in given.items():
            for port, start in self._reached(name, f"input {name!r}"):
                if self.full_name(port) in driven:
                    raise WiringError(f"input {name!r}: the drive file feeds {port} too; remove one of the two")
                found[self.full_name(port)] = self._constant(name, text, (port, start))
        return found

    def idle(self, fed: Collection[str]) -> dict[str, float]:
        """Return the start values of the Real inputs without a source; other types keep them anyway.

        Raises:
            WiringError: An input has no start value.
        """
        left = {self.full_name(port): self._variable(port).start for port in self.ports if self._is_real(port)}
        left = {name: start for name, start in left.items() if name not in fed}
        if empty := [name for name, start in left.items() if start is None]:
            raise WiringError(
                f"{len(empty)} inputs have no source and no start value: {', '.join(empty)}; give a drive file with "
                "channels of these names (--drive), a constant (--input NAME=VALUE), or a value in a parameter set"
            )
        return {name: float(start) for name, start in left.items() if start is not None}

    def _is_real(self, port: Port) -> bool:
        return self._variable(port).type == "Real"

    def _variable(self, port: Port) -> Variable:
        variable = self.network.variable(port)
        if variable is None:
            raise WiringError(f"{port}: the FMU has no such variable; correct the name")
        return variable

    def _is_fed(self, port: Port) -> bool:
        origin, hops = self.network.chain(port)
        return bool(hops) and isinstance(self.network.elements[origin.path], FmuElement)

    def _reached(self, name: str, what: str) -> Iterator[tuple[Port, Port]]:
        """Yield the open inputs that a name refers to, each with the port at which the value enters."""
        start = self._port(name)
        found = [] if start is None else [port for port in self.ports if start in self._line(port)]
        if not found:
            found = [port for port in self.ports if port.name == name]
            start = None
        if not found or (start is None and len(found) > 1):
            which = " and ".join(map(str, found)) or "no open input"
            raise WiringError(
                f"{what} matches {which}; name a connector of the package, or component and input; open inputs: "
                f"{', '.join(map(str, self.ports)) or 'none'}"
            )
        yield from ((port, start or port) for port in found)

    def _port(self, name: str) -> Port | None:
        if (found := self.network.find(name, ())) is not None:
            return found
        component, _, variable = name.partition(".")
        paths = [path for path, flat in self.names.items() if flat == component]
        return self.network.find(variable, paths[0]) if paths else None

    def _line(self, port: Port) -> list[Port]:
        origin, hops = self.network.chain(port)
        return [origin, *(hop.target for hop in hops)]

    def _carried(self, unit: str | None, what: str, way: tuple[Port, Port]) -> Conversion:
        """Return the conversion from a value at the port where it enters to the input's own unit."""
        port, start = way
        line = self._line(port)
        at = self.network.unit(start)
        given = at if unit is None else named_unit(unit)
        first = convert_between(given, at, what)
        hops = self.network.chain(port)[1][line.index(start) :]
        return self.network.carry(at or given, hops, first)[0]

    def _channel(self, given: Drivefile, channel: tuple[str, str], way: tuple[Port, Port]) -> tuple[str, Array]:
        """Return unit and samples of a channel for the master, which converts to the input's unit."""
        name, unit = channel
        what, values = f"drive file channel {name!r}", given.series[name]
        total = self._carried(unit, what, way)
        variable = self._variable(way[0])
        if way[0] == way[1] and variable.unit is not None:
            return unit, values
        back, si = to_si(variable)
        total = compose(total, back)
        return si, values if total == Conversion() else total.factor * values + total.offset

    def _constant(self, name: str, text: str, way: tuple[Port, Port]) -> float:
        what, kind = f"input {name!r}", self._variable(way[0]).type
        if kind in DISCRETE:
            return _discrete(text, kind, f"{way[0]} = {text!r}")
        number, unit = _quantity(text, what)
        return self._carried(unit, what, way)(number)


def _discrete(text: str, kind: str, what: str) -> int:
    """Return the value of an Integer, a Boolean or an enumeration."""
    if kind == "Boolean" and text in ("true", "false"):
        return text == "true"
    try:
        return int(text) if kind != "Boolean" else bool(("0", "1").index(text))
    except ValueError:
        expected = "true or false" if kind == "Boolean" else "a whole number"
        raise WiringError(f"{what}: the input is a {kind}; give {expected}") from None


def _quantity(text: str, what: str) -> tuple[float, str | None]:
    """Return a number and its unit; None if the text is only a number."""
    try:
        return float(text), None
    except ValueError:
        pass
    try:
        return units.quantity(text)
    except UnknownUnitError as error:
        raise WiringError(f"{what}: {error}") from error
