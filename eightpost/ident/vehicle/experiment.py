"""Experiments that a vehicle is identified from."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from eightpost.array_types import Array
from eightpost.corners import CORNERS, channel
from eightpost.errors import InputError, ParameterError
from eightpost.ident.preparation import Prepared
from eightpost.signals import TimeSeries

# ---- Definition of an identification --------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Experiment:
    """Channels of an identification and the damping around which the model is identified."""

    name: str  #: Name of the vehicle.
    rig: tuple[str, ...]  #: Inputs of the rig: roads, aeroloaders or forces and moments on the chassis.
    forces: tuple[str, ...]  #: Shock forces: `force` of each port.
    outputs: tuple[str, ...]  #: Outputs of the model, which include the shock velocities of all ports.
    baseline_damping: Mapping[str, float]  #: Baseline damping C-bar [N.s/m] by port ("lf", ...; "" for a quarter car).
    #: Values of the static state by output, SI, as in `IdentifiedVehicle`.
    static: Mapping[str, float] = field(default_factory=dict)
    sources: Mapping[str, str] = field(default_factory=dict)  #: SHA-256 digests of the files, by name.
    #: Means of the first test's channels, SI, if they were removed from the records: of tire forces, to detect tires
    #: that lift off, and of loads, for the travel that they cause.
    means: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Check that every port has a velocity and a damping."""
        for port in self.ports:
            if channel(port, "velocity") not in self.outputs:
                raise ParameterError(
                    f"{self.name}: {channel(port, 'velocity')} must be an output, as a shock law needs it"
                )
            if port not in self.baseline_damping:
                raise ParameterError(f"{self.name}: the port {port!r} has no baseline damping; specify one [N.s/m]")

    @property
    def inputs(self) -> tuple[str, ...]:
        """Inputs of the rig, then the shock forces."""
        return self.rig + self.forces

    @property
    def loads(self) -> tuple[str, ...]:
        """Inputs of the rig that load the chassis."""
        return tuple(name for name in self.rig if quantity(name) != "road")

    @property
    def ports(self) -> tuple[str, ...]:
        """Ports in the order of the forces."""
        return tuple(name.removesuffix("force").rstrip(".") for name in self.forces)

    def of(self, *outputs: str) -> Experiment:
        """Return the experiment with the given outputs and the shock velocities only.

        Raises:
            ParameterError: The experiment has no such output.
        """
        unknown = [name for name in outputs if name not in self.outputs]
        if unknown:
            raise ParameterError(f"there is no output {', '.join(unknown)}; the outputs are {', '.join(self.outputs)}")
        kept = {channel(port, "velocity") for port in self.ports} | set(outputs)
        return replace(self, outputs=tuple(name for name in self.outputs if name in kept))


def quantity(name: str) -> str:
    """Return the quantity of a channel: its name without corner or axle."""
    return name.rpartition(".")[2]


def experiment_of(
    names: Iterable[str],
    baseline_damping: Mapping[str, float],
    *,
    name: str = "vehicle",
    sources: Mapping[str, str] | None = None,
) -> Experiment:
    """Return the experiment for records with the given channels: a quarter car, a seven-DOF car or an 8-post rig.

    Args:
        names: Names of the channels that all records have, as in docs/explanation/rig.md.
        baseline_damping: Baseline damping C-bar [N.s/m] by port.
        name: Name of the vehicle.
        sources: SHA-256 digests of the files, by name.

    Raises:
        ParameterError: The channels do not include the road and the force of each shock.
    """
    available = tuple(names)
    ports = ("",) if "road" in available else CORNERS
    roads, forces = (tuple(channel(port, quantity) for port in ports) for quantity in ("road", "force"))
    aero = tuple(n for n in (channel(port, "aero") for port in ports) if n in available)
    loads = aero or tuple(n for n in _LOADS if n in available)
    if not set(roads + forces) <= set(available):
        missing = ", ".join(sorted(set(roads + forces) - set(available)))
        raise ParameterError(
            f"{name}: the records lack {missing}; a rig test needs the road and the force of each shock"
        )
    outputs = tuple(channel(port, quantity) for quantity in _CORNER_OUTPUTS for port in ports)
    outputs = tuple(n for n in (*outputs, *_CAR_OUTPUTS) if n in available)
    return Experiment(name, roads + loads, forces, outputs, baseline_damping, {}, sources or {})


#: Loads on a chassis without aeroloaders.
_LOADS = ("aero_force", "heave_force", "roll_moment", "pitch_moment")
#: Outputs of Table 6.1 that the model has if the records have them.
_CORNER_OUTPUTS = ("velocity", "displacement", "tire_force", "hub_acceleration", "chassis_acceleration")
_CAR_OUTPUTS = ("ride_height", "front.ride_height", "rear.ride_height", "driver.acceleration")


# ---- Choice of the baseline test, and the linear damping around which a vehicle is identified (6.3.1) ---------------

#: RMS deviation of a shock's force from `c v`, relative to `c v`, above which the shock is reported as nonlinear [1].
_NEAR_LINEAR = 0.3
#: Minimum relative difference in damping between an alternate shock and the baseline shock [1].
_OTHER = 0.1


class Baseline(NamedTuple):
    """The baseline test and the damping of its shocks."""

    test: int  #: Index of the baseline test among the records.
    damping: Mapping[str, float]  #: Least-squares slope of force over velocity (C-bar) [N.s/m], by port.
    #: RMS deviation of the shock's force from that line, relative to the line's RMS [1], by port.
    deviations: Mapping[str, float]
    #: Indices of all records: the baseline first, then alternate tests in the order of the ports.
    order: tuple[int, ...]

    def notes(self) -> tuple[str, ...]:
        """Return notes on the baseline for the user."""
        far = [f"{port or 'the port'} ({100.0 * part:.0f} %)" for port, part in self.deviations.items()
               if part > _NEAR_LINEAR]  # fmt: skip
        return (f"baseline shocks deviate from a straight line: {', '.join(far)}",) if far else ()

    def experiment(
        self, prepared: Prepared, *, name: str, damping: float | None = None, outputs: Sequence[str] = ()
    ) -> Experiment:
        """Return the experiment about this baseline.

        Args:
            prepared: Prepared records of the baseline and the alternate tests.
            name: Name of the vehicle.
            damping: Damping of all ports about which the vehicle is identified [N.s/m]; None: that of the baseline.
            outputs: Outputs of the model; empty: all possible ones.
        """
        rates = {port: slope if damping is None else damping for port, slope in self.damping.items()}
        whole = experiment_of(prepared.channels, rates, name=name, sources=prepared.sources)
        whole = replace(whole, means=prepared.means[self.test])
        return whole.of(*outputs) if outputs else whole


def find_baseline(records: Sequence[TimeSeries], ports: Sequence[str], *, test: int | None = None) -> Baseline:
    """Find the baseline test: at each corner it has the shock that most tests have.

    Args:
        records: Records with `force` and `velocity` of every port.
        ports: Ports: "lf", ...; "" for a quarter car.
        test: Index of the baseline test, if known.

    Raises:
        InputError: All tests have the same shock at a port, so the effect of its force cannot be separated.
    """
    slopes = np.array([[_slope(record, port) for port in ports] for record in records])
    usual = np.sort(slopes, axis=0)[len(slopes) // 2]  # with two tests, the larger damping
    chosen = int(np.argmin(np.abs(slopes / usual - 1.0).max(axis=1))) if test is None else test
    changes = np.abs(slopes / slopes[chosen] - 1.0)
    for place, port in enumerate(ports):
        if len(records) > 1 and changes[:, place].max() < _OTHER:
            raise InputError(
                f"no test has another shock at {port or 'the port'}: the damping is {slopes[chosen, place]:.0f} N.s/m "
                f"within {100.0 * _OTHER:.0f} % in all {len(records)} tests; add a test with about half of it (6.1.4)"
            )
    deviations = {port: _deviation(records[chosen], port, slopes[chosen, i]) for i, port in enumerate(ports)}
    others = sorted((k for k in range(len(records)) if k != chosen), key=lambda k: (int(np.argmax(changes[k])), k))
    damping = {port: float(slopes[chosen, i]) for i, port in enumerate(ports)}
    return Baseline(chosen, damping, deviations, (chosen, *others))


def _slope(record: TimeSeries, port: str) -> float:
    v, force = _moving(record, port)
    return float(v @ force / (v @ v))


def _deviation(record: TimeSeries, port: str, slope: float) -> float:
    v, force = _moving(record, port)
    return float(np.std(force - slope * v) / np.std(slope * v))


def _moving(record: TimeSeries, port: str) -> tuple[Array, Array]:
    v, force = (record[channel(port, quantity)] for quantity in ("velocity", "force"))
    return v - v.mean(), force - force.mean()
