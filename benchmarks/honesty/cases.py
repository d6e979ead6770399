"""Random systems, each drawn from an integer seed alone."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from dataclasses import asdict, dataclass, field, replace
from functools import cache
from pathlib import Path
from unittest.mock import patch

import numpy as np

from benchmarks.table import log_uniform
from builder.build import build
from builder.toolchain import PLATFORMS, Zig, this_platform
from cosim import Bond, Capabilities, Component, FmuComponent, Scenario, System
from eightpost.array_types import Array
from eightpost.corners import CORNERS
from eightpost.shock import LAWS as CLASSES
from eightpost.shock import Port, Shock, StaticCurve, fit_parameters, write_shock
from eightpost.signals import Drivefile, TimeSeries
from eightpost.vehicle import Corners, IdentifiedVehicle, QuarterCar, SevenDof, StructuralVehicle, write_vehicle

Random = np.random.Generator

LAWS = ("polylinear", "lpf1", "lpnl2")

#: Order of the polynomial that is fitted to a drawn nose.
_NOSE_ORDER = 9
#: Share of shocks whose force falls somewhere.
_FALLING = 0.2


@dataclass(frozen=True)
class DrawnShock:
    """Randomly drawn shock."""

    law: str  #: Name of the law.
    curve: StaticCurve  #: Static curve.
    port: Port  #: Motion ratio, scales, gas spring, seal drag.
    own: Mapping[str, float]  #: Parameters of the law, by name, SI.
    nose_slope: float  #: Slope of the curve at zero [N.s/m].
    falls: bool  #: Whether the force falls somewhere.

    @property
    def parameters(self) -> dict[str, float]:
        """Parameters of the FMU by name."""
        found = dict(asdict(self.port)) | dict(self.own)
        for name, value in asdict(self.curve).items():
            if isinstance(value, tuple):
                found |= {f"curve.{name}[{k}]": number for k, number in enumerate(value, start=1)}
            else:
                found[f"curve.{name}"] = value
        return found


def some(random: Random, share: float, value: float, otherwise: float = 0.0) -> float:
    """Return `value` in a share of the draws, else `otherwise`."""
    return value if random.random() < share else otherwise


def log_uniforms(random: Random, low: float, high: float, count: int) -> Array:
    """Return numbers (count,) whose logarithms are uniform between two bounds."""
    return np.asarray(np.exp(random.uniform(np.log(low), np.log(high), size=count)))


def draw_shock(random: Random, law: str) -> DrawnShock:
    """Return a random shock of a law."""
    port = _port(random)
    falls = bool(random.random() < _FALLING)
    curve, nose = draw_curve(random, falls=falls)
    own = {}
    if law != "polylinear":
        own["time_constant"] = log_uniform(random, 1e-4, 1e-2)
    if law == "lpnl2":
        own["lag_full_force"] = log_uniform(random, 50.0, 1500.0)
        own["lag_zero_force"] = own["lag_full_force"] + log_uniform(random, 50.0, 2000.0)
    return DrawnShock(law, curve, port, own, nose, falls)


def _port(random: Random) -> Port:
    return Port(
        motion_ratio=some(random, 0.3, log_uniform(random, 0.6, 1.4), 1.0),
        compression_scale=some(random, 0.4, random.uniform(0.4, 1.8), 1.0),
        rebound_scale=some(random, 0.4, random.uniform(0.4, 1.8), 1.0),
        gas_stiffness=some(random, 0.5, log_uniform(random, 300.0, 2e4)),
        gas_preload=some(random, 0.5, random.uniform(50.0, 1500.0)),
        seal_friction=some(random, 0.5, log_uniform(random, 5.0, 100.0)),
        friction_velocity=log_uniform(random, 1e-3, 2e-2),
    )


def draw_curve(random: Random, *, falls: bool) -> tuple[StaticCurve, float]:
    """Return a digressive curve with a knee on each side, and its slope at zero [N.s/m].

    Args:
        random: Random generator.
        falls: Whether the force falls over a part of one side.
    """
    nose = log_uniform(random, 1e3, 1e5)
    knee_force = log_uniform(random, 100.0, 1500.0)
    speed = float(np.clip(knee_force / nose * random.uniform(1.5, 3.5), 0.003, 0.5))
    width = speed * random.uniform(0.02, 0.6)
    sides = [_Side.draw(random, nose, speed) for _ in range(2)]
    falling = int(random.integers(2)) if falls else -1
    inner = _nose(nose, speed, width, sides)
    starts = sum(inner), -sum(a * (-1.0) ** k for k, a in enumerate(inner, start=1))  # at both transitions
    outer = [
        side.outer(random, speed, start, falls=k == falling)
        for k, (side, start) in enumerate(zip(sides, starts, strict=True))
    ]
    curve = StaticCurve(
        inner=inner,
        compression=outer[0],
        rebound=tuple(-b for b in outer[1]),  # type: ignore[arg-type]
        transition_speed=speed,
        transition_width=width,
        compression_speed=speed + sides[0].span,
        rebound_speed=speed + sides[1].span,
        compression_slope=sides[0].slope * random.uniform(0.5, 1.5),
        rebound_slope=sides[1].slope * random.uniform(0.5, 1.5),
    )
    return curve, nose


@dataclass(frozen=True)
class _Side:
    """Return one side of a curve: f = slope v + height (1 - exp(-v / knee)), v > 0, up to `span` beyond it."""

    slope: float
    height: float
    knee: float
    span: float

    @classmethod
    def draw(cls, random: Random, nose: float, speed: float) -> _Side:
        slope = float(np.clip(nose * random.uniform(0.02, 0.5), 200.0, 6000.0))
        slope = min(slope, 0.7 * nose)
        knee = speed / random.uniform(1.5, 3.5)
        return cls(slope, (nose - slope) * knee, knee, random.uniform(0.3, 1.5))

    def force(self, v: Array) -> Array:
        return self.slope * v + self.height * (1.0 - np.exp(-v / self.knee))

    def outer(self, random: Random, speed: float, start: float, *, falls: bool) -> tuple[float, ...]:
        """Return the coefficients of the cubic that continues from `start` [N] at the transition speed [m/s]."""
        first, last = self.slope, self.slope * random.uniform(0.3, 2.0)
        if falls:
            share = random.uniform(0.1, 0.6)  # share of the span
            first = -2.0 * start * random.uniform(0.1, 0.6) / (share * self.span)
            last = -first * (1.0 - share) / share
        return start, first * speed, 0.5 * (last - first) * speed**2 / self.span, 0.0


def _nose(nose: float, speed: float, width: float, sides: list[_Side]) -> tuple[float, ...]:
    """Return the polynomial closest to both sides below the transition; its slope at zero is `nose`."""
    s = np.linspace(-1.0, 1.0, 401) * (1.0 + 0.5 * width / speed)
    v = np.abs(s) * speed
    wanted = np.where(s > 0.0, sides[0].force(v), -sides[1].force(v)) - nose * speed * s
    powers = np.arange(2, _NOSE_ORDER + 1)
    found = np.linalg.lstsq(s[:, None] ** powers, wanted, rcond=None)[0]
    return (nose * speed, *found.tolist(), *[0.0] * (15 - _NOSE_ORDER))


def draw_times(random: Random, kind: str, end: float) -> Array:
    """Return the points (N,) of a drive from 0 to at least `end` [s]; closely spaced for roads that need it."""
    if kind != "white" and random.random() < 0.15:  # uneven spacing
        times = np.append(0.0, np.cumsum(log_uniforms(random, 2e-4, 1e-2, int(end / 2e-4))))
        return np.asarray(times[: int(np.searchsorted(times, end)) + 1])
    low, high = {"white": (200.0, 5000.0), "spikes": (500.0, 5000.0)}.get(kind, (100.0, 2000.0))
    step = 1.0 / (5000.0 if kind == "white" and random.random() < 0.2 else log_uniform(random, low, high))
    return np.asarray(step * np.arange(int(np.ceil(end / step)) + 1))


def multisine(random: Random, time: Array) -> Array:
    """Return twelve sines of 0.5 to 40 Hz with road velocities of 0.03 to 0.4 m/s."""
    rates = log_uniforms(random, 0.5, 40.0, 12)
    phases = random.uniform(0.0, 2.0 * np.pi, size=12)
    power = random.uniform(0.8, 1.6)
    row = np.asarray(np.sin(2.0 * np.pi * np.outer(time, rates) + phases) @ rates**-power)
    speed = np.sqrt(np.mean((np.diff(row) / np.diff(time)) ** 2))
    return row * log_uniform(random, 0.03, 0.4) / float(speed)


def bumps(random: Random, time: Array) -> Array:
    """Return a few smooth bumps, each up to 40 mm high."""
    row = np.zeros_like(time)
    for _ in range(int(random.integers(2, 6))):
        length, middle = log_uniform(random, 0.015, 0.3), random.uniform(0.05, time[-1])
        inside = np.clip((time - middle) / length, -0.5, 0.5)
        row += log_uniform(random, 0.003, 0.04) * random.choice([-1.0, 1.0]) * np.cos(np.pi * inside) ** 2
    return row


def steps(random: Random, time: Array) -> Array:
    """Return steps of up to 20 mm from one point to the next."""
    row = np.zeros_like(time)
    for _ in range(int(random.integers(2, 7))):
        first = int(random.integers(1, time.size))
        row[first:] += log_uniform(random, 0.002, 0.02) * random.choice([-1.0, 1.0])
    return row


def chirp(random: Random, time: Array) -> Array:
    """Return a sine sweep from 0.5 Hz to at most 60 Hz with constant road velocity."""
    first, last = 0.5, random.uniform(15.0, 60.0)
    growth = np.log(last / first) / time[-1]
    phase = 2.0 * np.pi * first * np.expm1(growth * time) / growth
    return log_uniform(random, 0.05, 0.4) / (2.0 * np.pi * first * np.exp(growth * time)) * np.sin(phase)


def white(random: Random, time: Array) -> Array:
    """Return a random height at every point."""
    return log_uniform(random, 5e-5, 1e-3) * random.standard_normal(time.size)


def spikes(random: Random, time: Array) -> Array:
    """Return a few single points far from the others."""
    row = np.zeros_like(time) if random.random() < 0.7 else multisine(random, time)
    for place in random.integers(1, time.size, size=int(random.integers(2, 7))):
        row[place] += log_uniform(random, 0.001, 0.02) * random.choice([-1.0, 1.0])
    return row


def zeros(_: Random, time: Array) -> Array:
    """Return a flat road."""
    return np.zeros_like(time)


ROADS: Mapping[str, Callable[[Random, Array], Array]] = {
    road.__name__: road for road in (multisine, bumps, steps, chirp, white, spikes, zeros)
}


def draw_load(random: Random, time: Array, size: float) -> Array:
    """Return a load of up to about `size`, in its unit."""
    rates = log_uniforms(random, 0.5, 20.0, 4)
    return np.asarray(size * np.mean(np.sin(2.0 * np.pi * np.outer(time, rates) + rates), axis=1))


QUARTER_CARS, SEVEN_DOFS = 32, 8
#: Unsprung masses [kg].
LIGHTEST, HEAVIEST = 8.0, 60.0


@cache
def vehicle(name: str) -> StructuralVehicle:
    """Return a vehicle of the bank, without dampers, `quarter_00` to `quarter_31` or `seven_00` to `seven_07`."""
    kind, _, number = name.partition("_")
    make = _quarter_car if kind == "quarter" else _seven_dof
    return StructuralVehicle(name, make(int(number)))


def _quarter_car(k: int) -> QuarterCar:
    random = np.random.default_rng((k, 4))
    share = (k + random.random()) / QUARTER_CARS  # masses cover their range evenly
    return QuarterCar(
        sprung_mass=log_uniform(random, 80.0, 600.0),
        unsprung_mass=LIGHTEST * (HEAVIEST / LIGHTEST) ** share,
        suspension_stiffness=log_uniform(random, 1.5e4, 3e5),
        tire_stiffness=log_uniform(random, 1e5, 4.5e5),
    )


def _seven_dof(k: int) -> SevenDof:
    random = np.random.default_rng((k, 7))
    front, rear = (log_uniform(random, LIGHTEST, HEAVIEST) for _ in range(2))
    mass, track, a, b = (random.uniform(*ends) for ends in ((450, 1300), (1.3, 1.8), (1.1, 1.7), (1.1, 1.7)))
    return SevenDof(
        track_width=track,
        cg_to_front_axle=a,
        cg_to_rear_axle=b,
        sprung_mass=mass,
        roll_inertia=mass * (track * random.uniform(0.3, 0.45)) ** 2,
        pitch_inertia=mass * ((a + b) * random.uniform(0.35, 0.5)) ** 2,
        unsprung_mass=Corners.axles(front, rear),
        spring_rate=Corners.axles(log_uniform(random, 3e4, 3e5), log_uniform(random, 3e4, 3e5)),
        tire_stiffness=Corners.axles(log_uniform(random, 1.5e5, 4e5), log_uniform(random, 1.5e5, 4e5)),
        front_anti_roll_rate=float(random.choice([0.0, 2e4])),
        driver_ahead_of_cg=0.1,
        driver_left_of_centreline=0.3,
    )


def build_fmus(names: Iterable[str], folder: Path) -> None:
    """Build an FMU of each vehicle and law, `<name>.fmu`; with the suffix `_python`, a python FMU."""
    wanted = sorted(set(names))
    with patch.object(Zig, "platforms", (this_platform(),) if this_platform().name in PLATFORMS else ()):
        for target in ("native", "python"):
            chosen = [name for name in wanted if name.endswith("_python") == (target == "python")]
            if chosen:
                build([_model_file(folder / "models", name) for name in chosen], folder, target=target)


def _model_file(folder: Path, name: str) -> Path:
    """Write the file that an FMU is built from."""
    folder.mkdir(parents=True, exist_ok=True)
    path, model = folder / f"{name}.json", name.removesuffix("_python")
    if model in LAWS:
        law = CLASSES[model]
        own = {p.name: p.start for p in fit_parameters(law)}
        ends = (400.0, 400.0, 0.0, 0.0), (-400.0, -400.0, 0.0, 0.0)
        curve = StaticCurve((400.0, *[0.0] * 14), *ends, 0.4, 0.01, 2.0, 2.0, 1000.0, 1000.0)  # systems set their own
        write_shock(Shock(name, law(curve, port=Port(), **own)), path)
    else:
        write_vehicle(path, IdentifiedVehicle(name, vehicle(model).coupled(), static={}))
    return path


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
        return {"port_spring" if name == "spring" else f"bristle_{name}": value for name, value in asdict(self).items()}


@dataclass(frozen=True)
class DrawnCar:
    """One vehicle with its shocks."""

    name: str  #: Name of the component.
    model: str  #: Name of the vehicle in the bank (`vehicle`).
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
            found |= {f"{port}.friction_force": force, f"{port}.friction_velocity": velocity}
        for port, bristle in self.bristles.items():
            found |= {f"{port}.{name}": value for name, value in bristle.parameters.items()}
        return {name.lstrip("."): value for name, value in found.items()}


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
        """Return a new system from the FMUs in a folder (`build_fmus`)."""
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
        masses = [mass for car in self.cars for mass in np.atleast_1d(vehicle(car.model).parameters.unsprung_mass)]
        bristles = [bristle for car in self.cars for bristle in car.bristles.values()]
        drive, record = self.scenario.drive, self.scenario.record_step
        return "; ".join([
            f"{len(self.cars)} x {'/'.join(sorted({car.model.partition('_')[0] for car in self.cars}))}",
            ", ".join(f"{count} {law}" for law, count in sorted(Counter(shock.law for shock in shocks).items())),
            f"nose to {max(shock.nose_slope * shock.port.motion_ratio**2 for shock in shocks):.2g} N.s/m",
            f"wheel from {min(masses):.0f} kg",
            *(["falls"] if any(shock.falls for shock in shocks) else []),
            f"seal {max(shock.port.seal_friction for shock in shocks):.0f} N",
            *([f"bristles to {max(bristle.force for bristle in bristles):.0f} N"] if bristles else []),
            f"{self.road} {(len(drive.series.time) - 1) / drive.duration:.0f} Hz" if drive else self.road,
            f"from {self.scenario.drive_start:g} s, {self.scenario.stop:g} s",
            f"recorded {'all' if record is None else f'{1e3 * record:g} ms'}",
            *([f"holds: {', '.join(sorted(self.held))}"] if self.held else []),
            *([f"python: {', '.join(sorted(self.python))}"] if self.python else []),
        ])  # fmt: skip


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
    record = None
    if random.random() >= 0.15:
        record = log_uniform(random, 3e-4, min(1.0, 0.4 * stop))
        record = float(f"{record:.2g}") if random.random() < 0.7 else record
    settling = some(random, 0.5, round(random.uniform(0.05, 0.4) * stop, 3))
    targets = {name: name for name in drive.names} if drive else {}
    begin = start if drive else 0.0
    scenario = Scenario(stop, drive, targets, record_step=record, settling=settling, drive_start=begin)
    return scenario, kind


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
