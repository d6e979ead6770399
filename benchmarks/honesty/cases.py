"""Random systems, each drawn from an integer seed alone."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from benchmarks.honesty.cars import QUARTER_CARS, SEVEN_DOFS, vehicle
from benchmarks.honesty.roads import ROADS, draw_load, draw_times
from benchmarks.honesty.shocks import LAWS, DrawnShock, Random, draw_shock, log_uniform, some
from cosim import Bond, Capabilities, Component, FmuComponent, Scenario, System
from eightpost.corners import CORNERS
from eightpost.signals import Drivefile, TimeSeries

#: Version of the draws: increase it if the same seed is to give another system.
VERSION = 1
#: First seed of the systems with a bristle at every port, and port springs in half of the cars.
BRISTLES_FROM = 1_000_000
#: Loads of a vehicle other than its roads, and their typical size in their unit.
_LOADS = {"aero_force": 300.0, "heave_force": 800.0, "roll_moment": 300.0, "pitch_moment": 500.0}


class HeldFmu(FmuComponent):
    """FMU component that holds its inputs over each step, as the FMUs of most tools do."""

    @property
    def capabilities(self) -> Capabilities:
        """Abilities of the FMU, except ramps of its inputs."""
        return replace(super().capabilities, interpolates_inputs=False)


@dataclass(frozen=True)
class DrawnBristle:
    """Friction that sticks and the spring at a port, SI; the names are those of the vehicle FMU, without prefix."""

    force: float = 0.0
    reach: float = 1e-4
    static_ratio: float = 1.0
    stribeck_velocity: float = 0.01
    spring: float = 0.0

    @property
    def parameters(self) -> dict[str, float]:
        """Parameters of the vehicle FMU, without the prefix of the port."""
        return {
            "bristle_force": self.force,
            "bristle_reach": self.reach,
            "bristle_static_ratio": self.static_ratio,
            "bristle_stribeck_velocity": self.stribeck_velocity,
            "port_spring": self.spring,
        }


@dataclass(frozen=True)
class DrawnCar:
    """One vehicle with its shocks."""

    name: str  #: Name of the component.
    model: str  #: Name of the vehicle in the bank (`cars.vehicle`).
    shocks: Mapping[str, DrawnShock]  #: Shocks by port: "" for a quarter car, else a corner.
    #: Suspension friction that creeps by port: force [N] and velocity [m/s].
    friction: Mapping[str, tuple[float, float]]
    bristles: Mapping[str, DrawnBristle] = field(default_factory=dict)  #: Friction that sticks and springs by port.

    def shock_name(self, port: str) -> str:
        """Return the name of the component at a port."""
        return f"{self.name}_{port or 'shock'}"

    @property
    def parameters(self) -> dict[str, float]:
        """Parameters of the vehicle FMU."""
        found = {}
        for port, (force, velocity) in self.friction.items():
            prefix = f"{port}." if port else ""
            found |= {f"{prefix}friction_force": force, f"{prefix}friction_velocity": velocity}
        for port, bristle in self.bristles.items():
            found |= {f"{port}.{name}" if port else name: value for name, value in bristle.parameters.items()}
        return found


@dataclass(frozen=True)
class Case:
    """System with its scenario and a description."""

    seed: int  #: Seed that the case is drawn from.
    cars: tuple[DrawnCar, ...]  #: Vehicles with their shocks.
    scenario: Scenario  #: Duration, drive, recording.
    road: str  #: Kind of road.
    held: frozenset[str] = field(default_factory=frozenset)  #: Components that hold their inputs.
    python: frozenset[str] = field(default_factory=frozenset)  #: Components that are python FMUs.

    @property
    def fmu_names(self) -> dict[str, str]:
        """FMU name for each component."""
        names = {}
        for car in self.cars:
            names[car.name] = car.model
            names |= {car.shock_name(port): shock.law for port, shock in car.shocks.items()}
        return {name: f"{fmu}_python" if name in self.python else fmu for name, fmu in names.items()}

    def system(self, folder: Path) -> System:
        """Return a new system from the FMUs in a folder (`cars.build_fmus`)."""
        components: dict[str, Component] = {}
        for name, fmu in self.fmu_names.items():
            kind = HeldFmu if name in self.held else FmuComponent
            components[name] = kind(folder / f"{fmu}.fmu", name)
        bonds, parameters = [], {}
        for car in self.cars:
            parameters[car.name] = car.parameters
            for port, shock in car.shocks.items():
                bonds.append(Bond.between(f"{car.name}.{port}" if port else car.name, car.shock_name(port)))
                parameters[car.shock_name(port)] = shock.parameters
        return System(components, tuple(bonds), constants=self._constants(), parameters=parameters)

    def _constants(self) -> dict[str, float]:
        """Return zeros for all inputs without a bond or a channel of the drive."""
        driven = set(self.scenario.drive.names) if self.scenario.drive else set()
        return {
            f"{car.name}.{name}": 0.0
            for car in self.cars
            for name in vehicle(car.model).coupled().input_names
            if not name.endswith("force") or name in _LOADS
            if f"{car.name}.{name}" not in driven
        }

    @property
    def description(self) -> str:
        """Description in one line."""
        shocks = [shock for car in self.cars for shock in car.shocks.values()]
        laws = ", ".join(
            f"{sum(s.law == law for s in shocks)} {law}" for law in LAWS if any(s.law == law for s in shocks)
        )
        masses = [m for car in self.cars for m in _unsprung(car.model)]
        nose = max(shock.nose_slope * shock.port.motion_ratio**2 for shock in shocks)
        parts = [
            f"{len(self.cars)} x {'/'.join(sorted({car.model.partition('_')[0] for car in self.cars}))}",
            laws,
            f"nose to {nose:.2g} N.s/m",
            f"wheel from {min(masses):.0f} kg",
        ]
        if any(shock.falls for shock in shocks):
            parts.append("falls")
        if seal := max(shock.port.seal_friction for shock in shocks):
            parts.append(f"seal {seal:.0f} N")
        bristles = [bristle for car in self.cars for bristle in car.bristles.values()]
        if bristles:
            parts.append(f"bristles to {max(b.force for b in bristles):.0f} N")
        parts.append(self._driven())
        if self.held:
            named = ", ".join(sorted(self.held)) if len(self.held) < 6 else f"{len(self.held)} components"
            parts.append(f"holds: {named}")
        if self.python:
            parts.append(f"python: {', '.join(sorted(self.python))}")
        return "; ".join(parts)

    def _driven(self) -> str:
        drive, record = self.scenario.drive, self.scenario.record_step
        points = f" {(len(drive.series.time) - 1) / drive.duration:.0f} Hz" if drive else ""
        return (
            f"{self.road}{points} from {self.scenario.drive_start:g} s, {self.scenario.stop:g} s, "
            f"recorded {'all' if record is None else f'{1e3 * record:g} ms'}"
        )


def _unsprung(model: str) -> tuple[float, ...]:
    found = vehicle(model).parameters.unsprung_mass
    return tuple(found) if isinstance(found, tuple) else (found,)


def draw_case(seed: int) -> Case:
    """Return the system of a seed; it is always the same."""
    random = np.random.default_rng((VERSION, seed))
    cars = _draw_cars(random)
    names = [name for car in cars for name in (car.name, *(car.shock_name(port) for port in car.shocks))]
    slow = len(cars) == 1 and len(names) == 2 and random.random() < 0.05
    held, python = frozenset[str](), frozenset[str]()
    if slow:
        python = frozenset(names[: int(random.integers(1, 3))][-1:])
    elif random.random() < 0.12:
        count = len(names) if random.random() < 0.2 else min(len(names), int(random.integers(1, 3)))
        held = frozenset(random.choice(names, size=count, replace=False).tolist())
    scenario, road = _draw_scenario(random, cars, short=slow)
    if seed >= BRISTLES_FROM:
        own = np.random.default_rng((VERSION, seed, 8))
        cars = tuple(replace(car, bristles=_draw_bristles(own, car)) for car in cars)
    return Case(seed, cars, scenario, road, held, python)


def _draw_cars(random: Random) -> tuple[DrawnCar, ...]:
    chance = random.random()
    count = 1 if chance < 0.82 else int(random.integers(2, 6)) if chance < 0.95 else int(random.integers(6, 21))
    share = 0.3 if count == 1 else 0.1
    return tuple(_draw_car(random, f"car{k}", seven=bool(random.random() < share)) for k in range(count))


def _draw_car(random: Random, name: str, *, seven: bool) -> DrawnCar:
    ports = CORNERS if seven else ("",)
    model = f"seven_{random.integers(SEVEN_DOFS):02d}" if seven else f"quarter_{random.integers(QUARTER_CARS):02d}"
    laws = random.choice(LAWS, size=len(ports)) if random.random() < 0.5 else [random.choice(LAWS)] * len(ports)
    shocks = {port: draw_shock(random, str(law)) for port, law in zip(ports, laws, strict=True)}
    friction = {}
    if random.random() < 0.1:
        friction = {port: (log_uniform(random, 10.0, 200.0), log_uniform(random, 2e-3, 2e-2)) for port in ports}
    return DrawnCar(name, model, shocks, friction)


def _draw_bristles(random: Random, car: DrawnCar) -> dict[str, DrawnBristle]:
    has_springs = random.random() < 0.5
    return {
        port: DrawnBristle(
            force=log_uniform(random, 10.0, 300.0),
            reach=log_uniform(random, 3e-5, 3e-4),
            static_ratio=random.uniform(1.0, 1.4),
            stribeck_velocity=log_uniform(random, 3e-3, 3e-2),
            spring=random.uniform(-5e4, 5e4) if has_springs else 0.0,
        )
        for port in car.shocks
    }


def _draw_scenario(random: Random, cars: tuple[DrawnCar, ...], *, short: bool) -> tuple[Scenario, str]:
    ports = sum(len(car.shocks) for car in cars)
    longest = 0.6 if short else 4.0 if ports == 1 else 2.5 if ports <= 4 else 1.2 if ports <= 12 else 0.7
    stop = random.uniform(0.5 * longest, longest)
    stop = round(stop, 2) if random.random() < 0.7 else stop
    start = some(random, 0.5, round(random.uniform(0.02, 1.0), 3))
    kind = str(random.choice(["multisine", "bumps", "steps", "chirp", "white", "spikes", "zeros", "none"],
                             p=[0.26, 0.13, 0.12, 0.12, 0.17, 0.12, 0.04, 0.04]))  # fmt: skip
    drive = None if kind == "none" else _draw_drive(random, cars, kind, start + stop)
    record = _draw_record_step(random, stop)
    settling = some(random, 0.5, round(random.uniform(0.05, 0.4) * stop, 3))
    targets = {name: name for name in drive.names} if drive else {}
    begin = start if drive else 0.0
    scenario = Scenario(stop, drive, targets, record_step=record, settling=settling, drive_start=begin)
    return scenario, kind


def _draw_record_step(random: Random, stop: float) -> float | None:
    if random.random() < 0.15:
        return None
    step = log_uniform(random, 3e-4, min(1.0, 0.4 * stop))
    return float(f"{step:.2g}") if random.random() < 0.7 else step


def _draw_drive(random: Random, cars: tuple[DrawnCar, ...], kind: str, end: float) -> Drivefile:
    time = draw_times(random, kind, end)
    rows: dict[str, tuple[str, np.ndarray]] = {}
    for car in cars:
        resting = len(cars) > 1 and random.random() < 0.15
        for channel in vehicle(car.model).coupled().inputs:
            if channel.name.endswith("road"):
                row = ROADS["zeros" if resting else kind](random, time)
            elif channel.name in _LOADS and kind != "zeros" and not resting and random.random() < 0.15:
                row = draw_load(random, time, _LOADS[channel.name])
            else:
                continue
            rows[f"{car.name}.{channel.name}"] = channel.unit, row
    return Drivefile(TimeSeries.from_channels(time, rows))
