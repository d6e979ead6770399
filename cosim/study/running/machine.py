"""A study on the machine: its FMUs as matrices and parameters, the run of all setups on one drive, and its measures."""

from __future__ import annotations

import re
import zipfile
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import numpy as np

from cosim.components.component import Conversion, to_si
from cosim.components.fmu_component import FmuComponent
from cosim.session.setup import RunSetup, joined
from cosim.study.definition import Parameters
from cosim.study.measures import Measure, Sections, sections_of
from cosim.systems.coupling import Feed, Scenario, Term
from cosim.systems.system import Bond, System
from eightpost.array_types import Array, Integers
from eightpost.machine import (
    LAWS,
    SIGNALS,
    Drive,
    Limit,
    LinearCar,
    NotInBatchError,
    Port,
    Quantity,
    Run,
    ShockData,
    Vehicle,
)
from eightpost.signals import TimeSeries

# ==== What an FMU of this project contains about itself ==============================================================

_KIND = re.compile(r"/\* (\w+) [\d.]+: generated from interface\.toml")
_CONSTANT = re.compile(r"(\w+) = (-?\d+)[,\s}]")
_TABLE = re.compile(r"static const (?:double|int) (\w+)(?:\[\w+(?: \+ 1)?\])* = (\{.*?\});", re.DOTALL)
_SCALAR = re.compile(r"static const double (\w+) = ([^;]+);")
_NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*(?:[eE][-+]?\d+)?|inf|nan)")


@dataclass(frozen=True, slots=True, eq=False)
class Constants:
    """Constants of a generated C file."""

    sizes: Mapping[str, int]  #: Enumeration constants by name.
    numbers: Mapping[str, Array]  #: Numbers of every table, in their order, by name.

    @classmethod
    def of(cls, text: str) -> Constants:
        """Read a generated C file."""
        tables = {name: _numbers(content) for name, content in _TABLE.findall(text)}
        tables |= {name: _numbers(content) for name, content in _SCALAR.findall(text)}
        return cls({name: int(value) for name, value in _CONSTANT.findall(text)}, tables)

    def filled(self, name: str, *shape: int) -> Array:
        """Return the numbers of a table, filled up with zeros as a C compiler does."""
        numbers = np.zeros(shape)
        numbers.flat[: self.numbers[name].size] = self.numbers[name][: numbers.size]
        return numbers

    def integers(self, name: str, count: int) -> Integers:
        """Return the numbers of a table of integers."""
        return self.filled(name, count).astype(np.int64)


def _numbers(text: str) -> Array:
    return np.array([float(number) for number in _NUMBER.findall(text)])


def _sources_of(component: FmuComponent, path: Path) -> tuple[str, Mapping[str, str]]:
    """Return the interface of an FMU, such as `vehicle_ss` or `shock_lpnl2`, and its headers by name.

    Raises:
        NotInBatchError: The FMU is not of this project, or contains no sources.
    """
    if not component.is_ours:
        raise NotInBatchError(f"{path.name} was not built by eightpost")
    try:
        state = path.stat()
        files = _headers(path, state.st_mtime_ns, state.st_size)
    except (OSError, UnicodeDecodeError, zipfile.BadZipFile) as error:
        raise NotInBatchError(f"{path.name} cannot be read: {error}") from error
    found = _KIND.search(files.get("interface.h", ""))
    if found is None:
        raise NotInBatchError(f"{path.name} contains no sources (it is confidential)")
    return found[1], files


@lru_cache(maxsize=128)  # the trials of a search are thousands of shocks with the same few FMUs
def _headers(path: Path, _changed: int, _size: int) -> Mapping[str, str]:
    """Return the headers in the sources of an FMU by name; the time of its last change and its size identify it."""
    with zipfile.ZipFile(path) as archive:
        names = [name for name in archive.namelist() if name.startswith("sources/") and name.endswith(".h")]
        return {name.removeprefix("sources/"): archive.read(name).decode() for name in names}


# ==== Shock FMUs =====================================================================================================


def read_shock(component: FmuComponent, path: Path, given: Parameters) -> ShockData:
    """Return the data of a shock FMU.

    Args:
        component: FMU.
        path: FMU file.
        given: Values of parameters that differ from the FMU's.

    Raises:
        NotInBatchError: It is not a shock of this project, contains no sources, or has settings.
    """
    kind, files = _sources_of(component, path)
    law = kind.removeprefix("shock_")
    if law not in LAWS:
        raise NotInBatchError(f"{path.name} is {kind}, a law that has no batch")
    if "settings_data.h" in files:
        raise NotInBatchError(f"{path.name} has settings")
    own = component.variables.values()
    values = {v.name: v.start for v in own if v.causality == "parameter" and v.start is not None}
    values |= given

    def numbers(parameter: str, count: int) -> list[float]:
        names = [parameter] if count == 1 else [f"{parameter}[{k + 1}]" for k in range(count)]
        return [float(values[name]) for name in names]

    try:
        return ShockData.of(law, numbers)
    except (KeyError, ValueError) as error:
        raise NotInBatchError(f"{path.name} has other parameters than this version knows: {error}") from error


# ==== Vehicle FMUs: x' = A x + B u, y = C x + D u, with friction and springs at their ports ==========================

#: Parameters of the ports, in the order of PortFriction in fmus/machine/car.h; the last one is that of springs.
_FRICTION = (
    "friction_force", "friction_velocity", "bristle_force", "bristle_reach", "bristle_static_ratio",
    "bristle_stribeck_velocity",
)  # fmt: skip
_SPRING = "port_spring"
_AT_EQUILIBRIUM = "start_at_equilibrium"

#: Constants that FMUs of earlier versions lack, which have no coupled states.
_NONE_COUPLED = "enum { COUPLED_COUNT = 0 };\nstatic const double COUPLING[1] = {0.0};\n"


@dataclass(frozen=True, slots=True, eq=False)
class FmuVehicle(Vehicle):
    """A vehicle FMU."""

    inputs: tuple[str, ...]  #: Names of the inputs.
    outputs: tuple[str, ...]  #: Names of the outputs.
    ports: tuple[Port, ...]  #: Ports with friction or springs.


def read_vehicle(component: FmuComponent, path: Path, given: Parameters) -> FmuVehicle:
    """Return a vehicle FMU as matrices.

    Args:
        component: FMU.
        path: FMU file.
        given: Values of parameters that differ from the FMU's.

    Raises:
        NotInBatchError: It is not a vehicle of this project, or contains no sources.
    """
    kind, files = _sources_of(component, path)
    if kind != "vehicle_ss":
        raise NotInBatchError(f"{path.name} is not a vehicle but {kind}")
    values = {v.name: v.start for v in component.variables.values() if v.causality == "parameter"} | dict(given)
    try:
        return _vehicle(component, Constants.of(_NONE_COUPLED + files["vehicle_data.h"]), values)
    except (KeyError, ValueError) as error:
        raise NotInBatchError(f"{path.name} has other constants than this version knows: {error}") from error


def _vehicle(component: FmuComponent, constants: Constants, values: Mapping[str, object]) -> FmuVehicle:
    sizes = constants.sizes
    inputs, outputs = _names(component, "input"), _names(component, "output")
    modes, pairs = sizes["MODE_COUNT"], sizes["PAIR_COUNT"]
    rows = np.r_[0:modes, sizes["MODES"] : sizes["MODES"] + pairs]  # real parts, imaginary parts of pairs; no padding
    A = np.diag(np.r_[constants.filled("SIGMA", modes), constants.filled("SIGMA", modes)[:pairs]])
    omega = constants.filled("OMEGA", modes)[:pairs]
    A[:pairs, modes:], A[modes:, :pairs] = np.diag(-omega), np.diag(omega)
    coupled = sizes["COUPLED_COUNT"]
    own = slice(modes - coupled, modes)
    A[own, own] += constants.filled("COUPLING", coupled, coupled)
    B = constants.filled("B", sizes["STATE_BLOCKS"], len(inputs), sizes["BLOCK"])
    B = B.transpose(0, 2, 1).reshape(-1, len(inputs))
    C = constants.filled("C", len(outputs), sizes["STATE_COUNT"])
    D = np.zeros((len(outputs), len(inputs)))
    begin = constants.integers("DIRECT_BEGIN", len(outputs) + 1)
    columns, terms = constants.integers("DIRECT_INPUT", sizes["DIRECT_TERMS"]), constants.numbers["DIRECT_TERM"]
    for k in range(len(outputs)):
        D[k, columns[begin[k] : begin[k + 1]]] = terms[begin[k] : begin[k + 1]]
    at_rest = values.get(_AT_EQUILIBRIUM, True) in (True, "true", "1")
    if at_rest and not sizes["HAS_EQUILIBRIUM"]:
        raise NotInBatchError("the vehicle has no unique steady state")
    places = constants.integers("OFFSET_OF", len(outputs))
    offsets = [float(v) for n, v in values.items() if _is_offset(n)]  # type: ignore[arg-type]
    offset = np.array([offsets[place] if place >= 0 else 0.0 for place in places])
    ports = tuple(_ports(constants, sizes, values))
    return FmuVehicle(A, B[rows], C[:, rows], D, offset, at_rest, inputs, outputs, ports)


def _ports(constants: Constants, sizes: Mapping[str, int], values: Mapping[str, object]) -> list[Port]:
    count, springs = sizes["PORT_COUNT"], sizes["SPRING_COUNT"]
    friction = np.array([_own(values, name) for name in _FRICTION]).reshape(len(_FRICTION), -1)
    stiffness = np.zeros(count)
    travel: list[int | None] = [None] * count
    of_port, output = constants.integers("SPRING_PORT", springs), constants.integers("SPRING_OUTPUT", springs)
    for port, place, own in zip(of_port, output, _own(values, _SPRING), strict=True):
        stiffness[port], travel[port] = own, int(place)
    inputs, velocities = constants.integers("PORT_INPUT", count), constants.integers("PORT_OUTPUT", count)
    return [
        Port(int(inputs[k]), int(velocities[k]), travel[k], (*friction[:, k].tolist(), float(stiffness[k])))
        for k in range(count)
    ]


def _names(component: FmuComponent, causality: str) -> tuple[str, ...]:
    return tuple(v.name for v in component.variables.values() if v.causality == causality)


def _own(values: Mapping[str, object], name: str) -> list[float]:
    return [float(v) for n, v in values.items() if n.rpartition(".")[2] == name]  # type: ignore[arg-type]


def _is_offset(name: str) -> bool:
    return name.rpartition(".")[2] not in (*_FRICTION, _SPRING, _AT_EQUILIBRIUM)


# ==== A vehicle FMU and the shocks of a system at its ports ==========================================================


class WiredCar:
    """A vehicle whose forces come from shocks at its ports, and whose other inputs come from the drive.

    Args:
        system: System of the vehicle and its shocks.
        feeds: Sources of the inputs of every component.
        name: Name of the vehicle's component.
        vehicle: Vehicle.

    Attributes:
        vehicle: Vehicle.
        shocks: Components of the shocks, in the order of the bonds.
        ports: Port of each shock, with the friction and springs that the vehicle has there.

    Raises:
        NotInBatchError: The system has other connections than bonds between the vehicle and shocks.
    """

    def __init__(self, system: System, feeds: Mapping[str, Sequence[Feed]], name: str, vehicle: FmuVehicle) -> None:
        self.vehicle, self.name, self._system = vehicle, name, system
        self.shocks = tuple(shock_of(bond) for bond in system.bonds)
        self._feeds = feeds[name]
        self._check(feeds)
        self.ports = self._with_friction([self._port(bond) for bond in system.bonds])

    def output(self, name: str) -> int:
        """Return the number of an output `component.variable` of the vehicle."""
        component, _, variable = name.partition(".")
        if component != self.name or variable not in self.vehicle.outputs:
            raise NotInBatchError(f"{name} is not an output of the vehicle")
        self.check_si(name)
        return self.vehicle.outputs.index(variable)

    def check_si(self, name: str) -> None:
        """Raise an error if an output `component.variable` is not in an SI unit."""
        if to_si(self._system.output(name))[0] != Conversion():
            raise NotInBatchError(f"{name} is not in an SI unit")

    def inputs(self, scenario: Scenario, times: Array) -> Array:
        """Return what constants and drive give to the inputs of the vehicle (K, m) at times (K,) [s]."""
        values = np.zeros((times.size, len(self._feeds)))
        if scenario.drive is not None:
            samples = scenario.drive.sample(times + scenario.drive_start)
        for k, feed in enumerate(self._feeds):
            values[:, k] = feed.constant
            if feed.drive is not None:
                values[:, k] += feed.drive_conversion.factor * samples[feed.drive] + feed.drive_conversion.offset
        return values

    def _port(self, bond: Bond) -> Port:
        if bond.displacement is None:
            raise NotInBatchError(f"the shock at {bond.name} has no displacement")
        forces = [k for k, feed in enumerate(self._feeds) if feed.terms and self._source(feed.terms) == shock_of(bond)]
        if len(forces) != 1:
            raise NotInBatchError(f"the shock at {bond.name} acts on {len(forces)} inputs of the vehicle")
        return Port(forces[0], self.output(bond.velocity.source), self.output(bond.displacement.source))

    def _with_friction(self, shocks: Sequence[Port]) -> list[Port]:
        found = list(shocks)
        for port in self.vehicle.ports:
            for k, shock in enumerate(shocks):
                if (port.force, port.velocity) == (shock.force, shock.velocity) and port.travel in (None, shock.travel):
                    found[k] = replace(shock, friction=port.friction)
                    break
            else:
                if port.has_forces:
                    raise NotInBatchError("the vehicle has friction or a spring at a port that no shock is coupled to")
        return found

    def _source(self, terms: Sequence[Term]) -> str:
        source, _, variable = terms[0].source.partition(".")
        if len(terms) > 1 or variable != "force" or source not in self.shocks:
            raise NotInBatchError("an input of the vehicle has other sources than a shock and the drive")
        _check_unscaled(terms)
        return source

    def _check(self, feeds: Mapping[str, Sequence[Feed]]) -> None:
        if self._system.connections:
            raise NotInBatchError("components have connections besides their bonds")
        for bond, shock in zip(self._system.bonds, self.shocks, strict=True):
            for feed in feeds[shock]:
                if len(feed.terms) != 1 or feed.drive is not None or feed.constant != 0.0:
                    raise NotInBatchError(f"an input of the shock at {bond.name} has other sources than the vehicle")
                _check_unscaled(feed.terms)


def shock_of(bond: Bond) -> str:
    """Return the component of the shock of a bond."""
    return bond.force.source.partition(".")[0]


def _check_unscaled(terms: Iterable[Term]) -> None:
    if any(term.gain != 1.0 or term.conversion != Conversion() for term in terms):
        raise NotInBatchError("a connection has a gain or converts a unit")


# ==== A run of all setups on one drive ===============================================================================


class Plan:
    """A run of all setups on one drive at one step.

    Args:
        setup: Run of one of the setups; its step divides the interval between records.
        name: Name of the vehicle's component.
        vehicle: Vehicle.
        damping: Linear damping at each shock's port, around which the ports are solved (C,) [N.s/m].
        quantities: Quantities whose statistics are needed.
        series: Names of the channels whose series are needed.
        single: Whether numbers are in single precision.

    Attributes:
        run: Run of the machine.
        rows: Times of the recorded rows (R,) [s].

    Raises:
        NotInBatchError: The run is not one of a vehicle with shocks at its ports.
        FmuError: There is no compiler, or it fails.
    """

    def __init__(
        self,
        setup: RunSetup,
        name: str,
        vehicle: FmuVehicle,
        damping: Array,
        quantities: Sequence[Quantity],
        series: Sequence[str],
        *,
        single: bool = False,
    ) -> None:
        if setup.discrete.is_needed:
            raise NotInBatchError("components have connections besides their bonds")
        self._wired = WiredCar(setup.system, setup.coupling.feeds, name, vehicle)
        self.corners = self._wired.shocks
        car = LinearCar.of(vehicle, self._wired.ports, damping)
        drive = _drive(setup, self._wired)
        self.limits = tuple(limit for limit in setup.limits.watched if limit.signal.startswith(f"{name}."))
        names = {*series, *(channel for q in quantities for channel in q.channels)}
        self.run = Run(
            car,
            drive,
            {channel: self._channel(channel) for channel in names},
            quantities=quantities,
            limits=[Limit(limit.sign, limit.limit, self._wired.output(limit.signal)) for limit in self.limits],
            series=series,
            settling=int(np.searchsorted(drive.times[:: drive.every], setup.scenario.settling + 1e-9)),
            single=single,
        )
        self.rows, self.series = self.run.rows, self.run.series

    def _channel(self, name: str) -> tuple[int, int]:
        component, _, variable = name.partition(".")
        if component == self._wired.name:
            return -1, self._wired.output(name)
        if component not in self.corners or variable not in SIGNALS:
            raise NotInBatchError(f"{name} is not recorded in a batch")
        self._wired.check_si(name)
        return self.corners.index(component), SIGNALS.index(variable)


def _drive(setup: RunSetup, car: WiredCar) -> Drive:
    scenario, (times, every) = setup.scenario, _regular(setup)
    points = times
    if scenario.drive is not None:
        own = scenario.drive.series.time - scenario.drive_start
        points = joined(times, own[(own > 0.0) & (own < times[-1])])
    return Drive(times, every, points, car.inputs(scenario, points))


def _regular(setup: RunSetup) -> tuple[Array, int]:
    """Return equal steps (K + 1,) [s] up to the last record, and their number between records."""
    record = setup.scenario.record_step or setup.step
    every = max(1, round(record / setup.step))
    records = int(setup.times[-1] / record + 1e-9)
    if records < 1:
        raise NotInBatchError("the drive is shorter than the interval between records")
    return np.linspace(0.0, records * record, records * every + 1), every


# ==== Measures: summed while a batch runs, of filtered channels, and of the series ===================================

# ---- Statistics of a quantity ---------------------------------------------------------------------------------------


#: Places of the sums of deviations and of their squares among the sums of a quantity.
_SUM, _SQUARES = 1, 2


def _statistic(name: str, sums: Array, count: int, step: float) -> Array:
    """Return a statistic (n,) by its name in cosim.study.measures.

    Args:
        sums: Sums of Q quantities over the rows, as in fmus/machine/machine.h (Q, 8, n).
        count: Number of rows.
        step: Interval between the rows [s].
    """
    shift, total, _, least, largest, inside, first, last = sums[0]
    variances = np.maximum(sums[:, _SQUARES] / count - (sums[:, _SUM] / count) ** 2, 0.0)
    mean, rms = shift + total / count, np.sqrt(variances[0])
    found: Mapping[str, Callable[[], Array]] = {
        "rms": lambda: rms,
        "rms_with_mean": lambda: np.sqrt(variances[0] + mean**2),
        "joint_rms": lambda: np.sqrt(variances.mean(axis=0)),
        "mean": lambda: mean,
        "peak": lambda: np.maximum(largest - mean, mean - least),
        "range": lambda: largest - least,
        "maximum": lambda: largest,
        "minimum": lambda: least,
        "variation": lambda: rms / np.abs(mean),
        "work": lambda: step * (count * shift + total - 0.5 * (first + last)),
        "share": lambda: inside / count,
    }
    return found[name]()


#: Statistics that are computed from the sums.
_STREAMED = (
    "rms", "rms_with_mean", "joint_rms", "mean", "peak", "range", "maximum", "minimum", "variation", "work", "share",
)  # fmt: skip

#: Statistics that need the smallest or the largest value, or the share inside limits.
_WITH_LIMITS = ("peak", "range", "maximum", "minimum", "share")


# ---- Measures of a run ----------------------------------------------------------------------------------------------

#: A channel and the band to which it is filtered [Hz].
ChannelBand = tuple[str, tuple[float, float]]


class BatchMeasures:
    """Measures on a drive: summed while the batch runs, computed from channels filtered in lanes, or from the series.

    Args:
        measures: Measures of the drive.
        times: Times of the recorded rows (R,) [s].
        settling: Time at the start of the run that the measures exclude [s].

    Attributes:
        summed: Measures that are summed while the batch runs.
        quantities: Quantities of which the statistics are summed, each once.
        bands: Filter of every channel that is filtered in lanes.
        filtered: Measures of such channels.
        filtered_quantities: Quantities of these measures, with the band of their channels.
        others: Measures that need the series of each setup.
    """

    def __init__(self, measures: Sequence[Measure], times: Array, settling: float) -> None:
        self._windows = {m.name: _window(m, times, settling) for m in measures}
        self._step = float(times[-1] - times[0]) / (times.size - 1)
        self.bands = _bands(measures, times)
        known = [m for m in measures if self._is_known(m)]
        self.summed = tuple(m for m in known if m.band is None)
        self.filtered = tuple(m for m in known if m.band and all((c, m.band) in self.bands for c in m.channels))
        self.others = tuple(m for m in measures if m not in self.summed and m not in self.filtered)
        self.quantities = tuple(dict.fromkeys(q for m in self.summed for q in self._quantities_of(m)))
        self.filtered_quantities = tuple((q, m.band) for m in self.filtered if m.band for q in self._quantities_of(m))
        every = (*((q, None) for q in self.quantities), *self.filtered_quantities)
        self._places = {
            m.name: [every.index((q, m.band)) for q in self._quantities_of(m)] for m in (*self.summed, *self.filtered)
        }

    @property
    def series(self) -> tuple[str, ...]:
        """Channels of the measures that need series."""
        return tuple(dict.fromkeys(channel for m in (*self.filtered, *self.others) for channel in m.channels))

    def values(self, statistics: Array) -> dict[str, Array]:
        """Return the values (n,) of the summed and the filtered measures, in SI; not finite if one is not defined.

        Args:
            statistics: Statistics of the quantities, then of the filtered quantities (Q, 8, n).
        """
        return {m.name: self._values_of(m, statistics[self._places[m.name]]) for m in (*self.summed, *self.filtered)}

    def _values_of(self, measure: Measure, statistics: Array) -> Array:
        begin, end = self._windows[measure.name]
        return _statistic(measure.statistic, statistics, end - begin, self._step)

    def _is_known(self, measure: Measure) -> bool:
        begin, end = self._windows[measure.name]
        return not measure.function and measure.statistic in _STREAMED and end - begin >= 2

    def _quantities_of(self, measure: Measure) -> list[Quantity]:
        rows, weights = self._windows[measure.name], measure.weights or (1.0,) * len(measure.channels)
        if measure.statistic == "joint_rms":
            return [Quantity((c,), (w,), rows) for c, w in zip(measure.channels, weights, strict=True)]
        inside = (measure.options["from"], measure.options["to"]) if measure.statistic == "share" else (-np.inf, np.inf)
        limits = measure.statistic in _WITH_LIMITS
        return [Quantity(measure.channels, weights, rows, measure.statistic == "work", inside, limits)]


def _bands(measures: Sequence[Measure], times: Array) -> dict[ChannelBand, Sections]:
    """Return the filter of every channel of a measure with a band, if lanes can filter it."""
    rate = TimeSeries(times, np.zeros((0, times.size)), (), ()).sample_rate
    found = {}
    for name, band in dict.fromkeys((c, m.band) for m in measures if m.band is not None for c in m.channels):
        sections = sections_of(*band, rate)
        if sections is not None and times.size > sections.pad:
            found[name, band] = sections
    return found


def _window(measure: Measure, times: Array, settling: float) -> tuple[int, int]:
    """Return the rows of a measure, as cosim.study.measures.Filtered does."""
    first, last = measure.section or (-np.inf, np.inf)
    begin, end = np.searchsorted(times, (max(first, settling) - 1e-9, last + 1e-9)).tolist()
    return begin, end
