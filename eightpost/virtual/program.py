"""Simulated cars (truths) of the virtual rig by name, and programs of rig tests with their actuators and sensors."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache, partial
from typing import Literal

import numpy as np
from scipy.signal import butter, lfilter, lfilter_zi

from eightpost import __version__, units
from eightpost.array_types import Array
from eightpost.corners import CORNERS
from eightpost.errors import InputError, ParameterError
from eightpost.rig.geometry import Geometry
from eightpost.rig.rig_test import RigConditions, RigTest
from eightpost.signals.drivefile import Drivefile
from eightpost.signals.timeseries import TimeSeries
from eightpost.units import convert
from eightpost.virtual.car import AnyCar, Car, Friction, Springs, Tires, base_car, flexible_truth
from eightpost.virtual.drivefiles import (
    HEAVE_SINES,
    LEAD,
    RATE,
    SIGNS,
    TABLE_4_4,
    TILT_SINES,
    bump_drive,
    quarter_random,
    random_drive,
    sine_drive,
    static_drive,
    track_drive,
)
from eightpost.virtual.shocks import Shock, shocks_named
from eightpost.virtual.simulate import RigSensors, Run, commands, sensor_channels, simulate, with_math

# ---- Quarter car and seven-DOF car ----------------------------------------------------------------------------------

_INCH = convert(1.0, "in", "m")
_POUND = convert(1.0, "lbf", "N")
_RATE = convert(1.0, "lbf/in", "N/m")
_DAMPING = convert(1.0, "lbf.s/in", "N.s/m")
_MASS = convert(1.0, "lbm", "kg")


def _column(values: Sequence[float], unit: float = 1.0) -> Array:
    return unit * np.array(values, dtype=np.float64)[:, None]


def quarter_truth() -> Car:
    """Return the quarter car of Table 4.1, linear; q = (chassis, wheel)."""
    one = np.ones((1, 1))
    chassis, wheel = np.array([[1.0, 0.0]]), np.array([[0.0, 1.0]])
    return Car(
        name="quarter_car",
        corners=("",),
        mass=np.array([675.0, 75.0]) * _MASS,
        shock=wheel - chassis,
        spring=wheel - chassis,
        wheel=wheel,
        chassis=chassis,
        loads=("aero_force",),
        load_units=("N",),
        load=-chassis,
        stiffness=np.zeros((2, 2)),
        damping=np.zeros((2, 2)),
        springs=Springs.linear(1280.0 * _RATE * one),
        tires=Tires(1300.0 * _RATE * one, 0.0 * one, np.inf * one),
        friction=Friction.none(1),
        points={},
    )


_TRACK, _FRONT, _REAR = 70.0 * _INCH, 60.0 * _INCH, 50.0 * _INCH


def _geometry(front_aero: float, rear_aero: float, front_track: float, rear_track: float) -> Geometry:
    """Return the geometry of the car in Table 5.1 for aeroloader positions [m]; the overhangs are our own choice."""
    overhang = 45.0 * _INCH
    return Geometry(_FRONT, _REAR, front_aero, rear_aero, front_track, rear_track, overhang, overhang)


def seven_dof_truth() -> Car:
    """Return the car of Table 5.1, linear, without anti-roll bars; q = (z, roll, pitch, four wheels)."""
    half = 0.5 * _TRACK
    places = ((half, _FRONT), (-half, _FRONT), (half, -_REAR), (-half, -_REAR))
    chassis = np.array([[1.0, left, -ahead, 0, 0, 0, 0] for left, ahead in places])
    wheel = np.eye(7)[3:]
    return Car(
        name="seven_dof",
        corners=CORNERS,
        mass=np.array([2550.0, 1.5e6 * _INCH**2, 5.5e6 * _INCH**2, 101.0, 101.0, 124.0, 124.0]) * _MASS,
        shock=wheel - chassis,
        spring=wheel - chassis,
        wheel=wheel,
        chassis=chassis,
        loads=("heave_force", "roll_moment", "pitch_moment"),
        load_units=("N", "N.m", "N.m"),
        load=np.eye(7)[:3],
        stiffness=np.zeros((7, 7)),
        damping=np.zeros((7, 7)),
        springs=Springs.linear(_column((1280, 1280, 588, 588), _RATE)),
        tires=Tires(_column((2000,) * 4, _RATE), _column((0,) * 4), _column((np.inf,) * 4)),
        friction=Friction.none(4),
        points=_points(np.eye(7)[0], np.eye(7)[2], lambda _: np.eye(7)[1]),
        geometry=_geometry(_FRONT, _REAR, _TRACK, _TRACK),
    )


#: Coordinates of the stand-in: heave, front roll, rear roll, pitch, left and right front wheel, axle heave, axle roll.
_Z, _ROLL_F, _ROLL_R, _PITCH, _LF, _RF, _AXLE, _AXLE_ROLL = range(8)

#: Half distances on the rear axle [m]: shocks and springs are inboard of the wheels. With r the ratio of the distances,
#: the opposite wheel moves a shock by (1 - r) / (1 + r) as much as its own wheel: 10 dB less at r = 0.52 (6.2).
_REAR_SHOCK, _REAR_SPRING = 0.26 * _TRACK, 0.31 * _TRACK

#: Shock travel per wheel travel at the front (our choice).
_FRONT_RATIO = 0.85

#: Torsional stiffness of the chassis between the axles (our choice; similar to a stock car) [N.m/rad].
_CHASSIS_TWIST = convert(8000.0, "lbf.ft/deg", "N.m/rad")
_TWIST_DAMPING = 0.03

#: Front anti-roll bar, moment per relative roll angle (our choice) [N.m/rad].
_BAR = 4.0e4

#: Sliding friction and breakaway force of rod ends, bushings and spring seats along each shock [N]. The dissertation
#: gives no values, but shows their effects: hysteresis in the spring rating (6.4.4) and third harmonics in tire force
#: and hub acceleration for sines below 6 to 8 Hz (6.4.3). The sliding friction is that of our prototypes and 4 to 6
#: times the friction of a shock's own seals (3.4.3). With 4000 lbf/in, three times the front spring, it starts to slide
#: after 0.004 to 0.005 in. Left and right differ slightly, as on real cars.
_SLIDING = _column((15, 14, 19, 20), _POUND), _column((17, 16, 22, 23), _POUND)


def stand_in_truth() -> Car:
    """Return the 8-post stand-in: the seven-DOF car with additional features of a real car.

    These are a solid rear axle with inboard springs and shocks, two chassis halves that twist against each other, an
    anti-roll bar, progressive springs, bump stops, tire damping, tires that lift off, and stick-slip friction along
    every shock. The loads are the four aeroloaders, positive down.
    """
    hubs, sides = np.stack([_unit(_LF), _unit(_RF)]), (1.0, -1.0)
    chassis = np.stack([_chassis_at(ahead, side * 0.5 * _TRACK) for ahead in (_FRONT, -_REAR) for side in sides])

    def axle(half: float) -> Array:
        return np.stack([_unit(_AXLE) + side * half * _unit(_AXLE_ROLL) for side in sides])

    def inboard(half: float) -> Array:
        return axle(half) - np.stack([_chassis_at(-_REAR, side * half) for side in sides])

    aero = _geometry(70.0 * _INCH, 62.0 * _INCH, 40.0 * _INCH, 40.0 * _INCH)
    stations = ((aero.front_aero, aero.front_aero_track), (-aero.rear_aero, aero.rear_aero_track))
    twist = _unit(_ROLL_F) - _unit(_ROLL_R)
    bar = _unit(_ROLL_F) - (_unit(_LF) - _unit(_RF)) / _TRACK
    mass = [2550.0, 0.5 * 1.5e6 * _INCH**2, 0.5 * 1.5e6 * _INCH**2, 5.5e6 * _INCH**2]
    mass += [101.0, 101.0, 248.0, 248.0 * (0.33 * 70.0 * _INCH) ** 2]
    loss = _TWIST_DAMPING * 2.0 * np.sqrt(_CHASSIS_TWIST * 0.25 * mass[_ROLL_F] * _MASS)
    return Car(
        name="eight_post",
        corners=CORNERS,
        mass=np.array(mass) * _MASS,
        shock=np.vstack([_FRONT_RATIO * (hubs - chassis[:2]), inboard(_REAR_SHOCK)]),
        spring=np.vstack([hubs - chassis[:2], inboard(_REAR_SPRING)]),
        wheel=np.vstack([hubs, axle(0.5 * _TRACK)]),
        chassis=chassis,
        loads=tuple(f"{corner}.aero" for corner in CORNERS),
        load_units=("N",) * 4,
        load=-np.stack([_chassis_at(ahead, side * 0.5 * track) for ahead, track in stations for side in sides]),
        stiffness=np.outer(twist, twist) * _CHASSIS_TWIST + np.outer(bar, bar) * _BAR,
        damping=np.outer(twist, twist) * loss,
        springs=Springs(
            _column((1280, 1280, 700, 700), _RATE),
            _column((0.6, 0.6, 0.8, 0.8)),
            _column((2.2, 2.2, 2.8, 2.8), _INCH),
            _column((6000,) * 4, _RATE / _INCH),
        ),
        tires=Tires(
            _column((2000,) * 4, _RATE), _column((2.5,) * 4, _DAMPING), _column((715.0, 715.0, 785.0, 785.0), _POUND)
        ),
        friction=Friction(*_SLIDING, _column((4000,) * 4, _RATE)),
        points=_points(_unit(_Z), _unit(_PITCH), _roll_at),
        geometry=aero,
    )


def _unit(index: int) -> Array:
    return np.asarray(np.eye(8)[index])


def _roll_at(ahead: float) -> Array:
    """Return the row of the chassis' roll at a distance `ahead` of the centre of gravity [m], linear along the car."""
    share = (ahead + _REAR) / (_FRONT + _REAR)
    return share * _unit(_ROLL_F) + (1.0 - share) * _unit(_ROLL_R)


def _chassis_at(ahead: float, left: float) -> Array:
    return _unit(_Z) - ahead * _unit(_PITCH) + left * _roll_at(ahead)


def _points(heave: Array, pitch: Array, roll_at: Callable[[float], Array]) -> dict[str, Array]:
    """Return the rows for heave, pitch and roll at the centre of gravity, and for the driver 20 in back, 15 in left."""
    back, left = 20.0 * _INCH, 15.0 * _INCH
    return {
        "heave": heave,
        "pitch": pitch,
        "roll": roll_at(0.0),
        "driver": heave + back * pitch + left * roll_at(-back),
    }


#: Functions that create the simulated cars, by their names on the command line and in files.
TRUTHS: dict[str, Callable[[], AnyCar]] = {
    "quarter_car": quarter_truth,
    "seven_dof": seven_dof_truth,
    "eight_post": stand_in_truth,
    "flexible": base_car,
}


def truth_named(name: str, seed: int | None = None) -> AnyCar:
    """Return a simulated car.

    Args:
        name: Name of the car, one of `TRUTHS`.
        seed: Seed of its random parameters; None gives its base parameters. Only the flexible car has them.

    Raises:
        ParameterError: The car has no random parameters.
    """
    if seed is None:
        return TRUTHS[name]()
    if name != "flexible":
        raise ParameterError(f"the {name} has no random parameters; leave out the seed of the car, or use flexible")
    return flexible_truth(seed)


# ==== Programs of rig tests: actuators, drift of sensors, one test after another, by name =============================

# ---- Response of hydraulic wheelloaders and pneumatic aeroloaders to their commands (6.1.1) -------------------------


@dataclass(frozen=True, slots=True)
class Actuators:
    """Actuators modelled as second-order low-passes."""

    wheelloader: float = 125.0  #: Bandwidth of the wheelloaders [Hz]; 125 in 6.1.1.
    aeroloader: float = 9.0  #: Bandwidth of the aeroloaders [Hz]; 9 in 6.1.1.

    def follow(self, command: TimeSeries, car: AnyCar) -> TimeSeries:
        """Return the roads and loads (`car.inputs`) at 1250 Hz for commands with the same names."""
        grid = command.resample(RATE)
        roads = car.named("road")
        channels = {}
        for name in car.inputs:
            bandwidth = self.wheelloader if name in roads else self.aeroloader
            numerator, denominator = butter(2, bandwidth, fs=RATE)
            state = lfilter_zi(numerator, denominator) * grid[name][0]  # in steady state at the first value
            channels[name] = (grid.unit(name), lfilter(numerator, denominator, grid[name], zi=state)[0])
        return TimeSeries.from_channels(grid.time, channels)


# ---- Random drift of a rig and a car from run to run ----------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Drift:
    """Standard deviations of the random changes from run to run."""

    friction: float = 0.05  #: Relative change of all friction forces together [1].
    tire: float = 0.004  #: Relative change of the tires' stiffness, warm or cold [1].
    load_zero: float = convert(2.0, "lbf", "N")  #: Zero offset of the load cells [N].
    travel_zero: float = convert(0.002, "in", "m")  #: Zero offset of the potentiometers [m].

    def of(self, car: AnyCar, generator: np.random.Generator) -> AnyCar:
        """Return the car with the random changes of one run."""
        friction, tire = 1.0 + np.array([self.friction, self.tire]) * generator.standard_normal(2)
        return car.changed(max(float(friction), 0.0), float(tire))

    def zero(self, name: str, generator: np.random.Generator) -> float:
        """Return the zero offset of a measured channel in one run, in its SI unit."""
        spread = {
            "displacement": self.travel_zero,
            "force": self.load_zero,
            "tire_force": self.load_zero,
            "aero": self.load_zero,
        }.get(name.rpartition(".")[2], 0.0)
        return spread * float(generator.standard_normal())


NO_DRIFT = Drift(0.0, 0.0, 0.0, 0.0)


# ---- Simulation of one test on the virtual rig ----------------------------------------------------------------------


def run_test(
    car: AnyCar,
    drivefile: Drivefile,
    shocks: Sequence[Shock],
    *,
    seed: int = 0,
    sensors: RigSensors | None = None,
    drift: Drift | None = None,
    actuators: Actuators | None = None,
    lead: float = LEAD,
    conditions: RigConditions | None = None,
) -> RigTest:
    """Run a test and return its record at 1250 Hz with the channels of Table 6.1.

    Args:
        car: Car to test.
        drivefile: Commands with the car's `inputs` as channels.
        shocks: One shock per corner.
        seed: Seed of noise and drift.
        sensors: Sensor noise; default that of a rig, `RigSensors.perfect()` for none.
        drift: Standard deviations of the random drift; `NO_DRIFT` for none.
        actuators: Bandwidths of the actuators.
        lead: Lead-in before the record [s]; see `simulate`.
        conditions: Conditions to write into the file; the name of the car and the seed are added.
    """
    generator, drift = np.random.default_rng(seed), drift or Drift()
    car = drift.of(car, generator)
    drive = (actuators or Actuators()).follow(drivefile.series, car)
    motion = simulate(car, [Run(drive, tuple(shocks))], lead=lead)[0]
    channels = sensor_channels(car, motion, sensors or RigSensors(), generator)
    channels = {n: (u, row + drift.zero(n, generator)) for n, (u, row) in channels.items()}
    series = TimeSeries.from_channels(motion.time, channels | commands(car, drivefile.series))
    known = RigConditions(truth=car.name, seed=seed)
    return RigTest(with_math(car, motion, series), (conditions or RigConditions()).over(known))


# ---- Programs of rig tests for identification, linearity checks and validation (4.5.1, 6.1.3, 6.1.5) ----------------


#: Duration [s] of the random tests on the quarter-car rig (4.5.1) and the 8-post rig (6.1.3), of single-input tests.
QUARTER_RANDOM, RANDOM, SINGLE = 120.0, 800.0, 100.0

#: Whether alternate tests repeat the drive file of the baseline (6.1.5), or each test has another draw.
Draws = Literal["same", "other"]


@dataclass(frozen=True, slots=True)
class _PlannedTest:
    """One test of a program."""

    name: str  #: Name of the output file, without suffix.
    drivefile: str  #: Description of the drive file.
    draw: Callable[[], Drivefile]  #: Function that creates the drive file; tests with the same drive file share it.
    alternate: str | None = None  #: Corner with the alternate shock, None if all corners have the baseline shock.


def identification_program(
    car: AnyCar, seed: int, *, duration: float | None = None, draws: Draws = "same"
) -> tuple[_PlannedTest, ...]:
    """Return `baseline` and one `alternate_<corner>` per corner with the random drive file (6.1.5).

    Args:
        car: Car to identify.
        seed: Seed of the drive file.
        duration: Duration [s]; default 800, for a quarter car 120.
        draws: "other" uses the following seeds for the alternate tests, which gives the local polynomial method and the
            global H1 estimator more information. The difference method of the dissertation (Eq 4.26) needs "same".
    """
    length = duration or _random_length(car)
    first = cache(partial(_random_test, car, seed, duration=length))
    planned = [_PlannedTest("baseline", _random(length, seed), first)]
    for k, corner in enumerate(car.corners, start=1):
        own = seed + k if draws == "other" else seed
        draw = cache(partial(_random_test, car, own, duration=length)) if draws == "other" else first
        planned.append(_PlannedTest(f"alternate_{corner}".rstrip("_"), _random(length, own), draw, corner))
    return tuple(planned)


def _random_length(car: AnyCar) -> float:
    """Return the duration of the random test in the dissertation for a car [s]."""
    return RANDOM if len(car.corners) == 4 else QUARTER_RANDOM


def _random_test(car: AnyCar, seed: int, *, duration: float) -> Drivefile:
    """Return a car's random drive file: noise of Table 6.3, for a quarter car the multisine of Table 4.3."""
    if len(car.corners) == 1:
        return quarter_random(seed, duration=duration)
    return random_drive(car, seed, duration=duration)


def bump_test(car: AnyCar, *, duration: float | None = None) -> Drivefile:
    """Return a car's bump test: 0.4 in, 10 s period, 50 s; for a quarter car 1 in, 20 s, 60 s (4.5.1)."""
    if len(car.corners) == 1:
        return bump_drive(car, height=_INCH, period=20.0, duration=duration or 60.0)
    return bump_drive(car, duration=duration or 50.0)


def _single_program(car: AnyCar, seed: int) -> tuple[_PlannedTest, ...]:
    """Return `single_<input>` for each input alone, 100 s each (6.1.3), each with another draw."""
    return tuple(
        _PlannedTest(
            f"single_{name.replace('.', '_')}",
            f"{name} alone, random, {SINGLE:g} s, seed {seed + k}",
            partial(random_drive, car, seed + k, duration=SINGLE, active=(name,)),
        )
        for k, name in enumerate(car.inputs)
    )


def _sine_program(car: AnyCar) -> tuple[_PlannedTest, ...]:
    """Return `sine_<mode>_<frequency>hz` of Table 6.2 in heave, pitch and roll, or of Table 4.4 for a quarter car."""
    tables = {"heave": HEAVE_SINES, "pitch": TILT_SINES, "roll": TILT_SINES}
    if len(car.corners) == 1:
        tables = {"heave": TABLE_4_4}
    return tuple(
        _PlannedTest(
            f"sine_{mode}_{frequency:g}hz",
            f"sine, {mode}, {frequency:g} Hz, {amplitude:g} in",
            partial(sine_drive, car, frequency, amplitude * _INCH, mode=mode),
        )
        for mode, table in tables.items()
        for frequency, amplitude in table
    )


def _static_program(car: AnyCar) -> tuple[_PlannedTest, ...]:
    """Return `static_<mode>` and `static_<corner>` of the spring rating (6.1.3); none for a car without aeroloaders."""
    if car.loads != car.named("aero"):
        return ()
    kinds = {mode: mode for mode in SIGNS} | dict(zip(car.corners, car.loads, strict=True))
    return tuple(
        _PlannedTest(f"static_{name}", f"static loading, {name}", partial(static_drive, car, kind))
        for name, kind in kinds.items()
    )


def _track_program(car: AnyCar, seed: int) -> tuple[_PlannedTest, ...]:
    """Return `track_baseline` and `track_alternate_<corner>` (6.1.5); none for a quarter car."""
    if car.geometry is None:
        return ()
    lap, words = cache(partial(track_drive, car, seed)), f"track, seed {seed}"
    baseline = _PlannedTest("track_baseline", words, lap)
    return (baseline, *(_PlannedTest(f"track_alternate_{corner}", words, lap, corner) for corner in car.corners))


#: Names of the programs on the command line.
PROGRAMS = ("identification", "single", "sine", "bump", "static", "track", "all")


def program(
    name: str, car: AnyCar, seed: int, *, duration: float | None = None, draws: Draws = "same"
) -> tuple[_PlannedTest, ...]:
    """Return a program's tests.

    Args:
        name: Name of the program, one of `PROGRAMS`.
        car: Car to test; `all` leaves out tests for which the car has no actuators.
        seed: Seed of the drive files.
        duration: Duration of the random test [s]; see `identification_program`.
        draws: Choice of random draws; see `identification_program`.

    Raises:
        ParameterError: The program does not exist, or has no tests for this car.
    """
    if name not in PROGRAMS:
        raise ParameterError(f"there is no program {name!r}; there are {', '.join(PROGRAMS)}")
    programs: dict[str, Callable[[], tuple[_PlannedTest, ...]]] = {
        "identification": partial(identification_program, car, seed, duration=duration, draws=draws),
        # Other seeds than the identification, because validation records must differ from those of the fit.
        "single": partial(_single_program, car, seed + 100),
        "sine": partial(_sine_program, car),
        "bump": lambda: (_PlannedTest("bump", "bump", partial(bump_test, car)),),
        "static": partial(_static_program, car),
        "track": partial(_track_program, car, seed + 200),
    }
    selected = programs if name == "all" else {name: programs[name]}
    tests = tuple(test for tests in selected.values() for test in tests())
    if not tests:
        raise ParameterError(f"there are no {name} tests for the {car.name}: it lacks the actuators")
    return tests


def _random(duration: float, seed: int) -> str:
    return f"random, {duration:g} s, seed {seed}"


# ==== The virtual rig as a bench: tests by their names, and records with their conditions ============================


@dataclass(frozen=True, slots=True)
class Bench:
    """A car on the virtual rig."""

    car: AnyCar  #: Car under test.
    is_noisy: bool  #: Whether the sensors have noise and the rig drifts from run to run.
    run: int  #: Seed of noise and drift; another number is another run.
    note: str  #: Note that marks the records as synthetic.

    @classmethod
    def of(
        cls,
        truth: str,
        *,
        car_seed: int | None = None,
        friction: bool = True,
        noise: bool = True,
        run: int = 0,
        seed: int = 1,
    ) -> Bench:
        """Return the bench of a car.

        `car_seed` draws the flexible car's parameters, `run` noise and drift; the note states the drive files' `seed`.
        """
        car = truth_named(truth, car_seed)
        car = car if friction else car.without_friction()
        words = f"{car.name}, friction {'on' if friction else 'off'}, noise {'rig' if noise else 'none'}"
        return cls(car, noise, run, f"SYNTHETIC: eightpost rig {__version__}, {words}, drivefile seed {seed}")

    def shocks(self, names: Sequence[str]) -> tuple[str, ...]:
        """Return a shock's name for each corner, from one name for all or one for each.

        Raises:
            InputError: The number of names is neither 1 nor that of the corners.
        """
        corners = len(self.car.corners)
        if len(names) not in (1, corners):
            raise InputError(f"give --shock once or {corners} times, not {len(names)} times")
        return (*names,) * corners if len(names) == 1 else (*names,)

    def record(self, drivefile: Drivefile, shocks: Sequence[str], words: str, number: int = 0) -> RigTest:
        """Run a test with a named shock at each corner; each `number` is another run with its own drift and noise."""
        bank = shocks_named(shocks)
        return run_test(
            self.car,
            drivefile,
            [bank[name] for name in shocks],
            seed=self.run + number,
            sensors=RigSensors() if self.is_noisy else RigSensors.perfect(),
            drift=None if self.is_noisy else NO_DRIFT,
            conditions=RigConditions(drivefile=words, shocks=tuple(shocks), synthetic=self.note),
        )

    def record_planned(self, planned: _PlannedTest, number: int, baseline: Sequence[str], alternate: str) -> RigTest:
        """Run a test of a program, with the shock `alternate` at the corner that the test names."""
        corners = zip(self.car.corners, baseline, strict=True)
        names = [alternate if corner == planned.alternate else shock for corner, shock in corners]
        return self.record(planned.draw(), names, planned.drivefile, number)

    def drivefile(
        self,
        test: str,
        seed: int,
        *,
        duration: float | None = None,
        only: str = "",
        mode: str = "heave",
        frequency: float = 2.0,
        amplitude: float = 0.0127,
    ) -> Drivefile:
        """Return the drive file of a test: random, single, sine, bump, static or track.

        Without a duration [s], its length is that of the dissertation. `only` names the actuator of a single or static
        test; mode, frequency [Hz] and amplitude [m] are those of a sine.

        Raises:
            InputError: A single test has no actuator.
        """
        car = self.car
        if test == "single":
            if not only:
                raise InputError(f"--test single needs --set only, one of {', '.join(car.inputs)}")
            return random_drive(car, seed, duration=duration or SINGLE, active=(only,))
        if test == "random":
            return _random_test(car, seed, duration=duration or _random_length(car))
        if test == "sine":
            return sine_drive(car, frequency, amplitude, mode=mode, duration=duration or 20.0)
        if test == "bump":
            return bump_test(car, duration=duration)
        if test == "static":
            return static_drive(car, only or mode)
        return track_drive(car, seed, duration=duration or 33.0)

    def summary(self, test: RigTest) -> str:
        """Return a sentence about a record."""
        car, series = self.car, test.series
        loads = [units.convert(series[name].std(), "N", "lbf") for name in car.named("tire_force")]
        speeds = [units.convert(series[name].std(), "m/s", "in/s") for name in car.named("velocity")]
        return (
            f"{car.name}, shocks {', '.join(test.conditions.shocks)}: {series.duration:.1f} s at "
            f"{series.sample_rate:.0f} Hz, {len(series.names)} channels; tire force std "
            f"{' '.join(f'{x:.0f}' for x in loads)} lbf, shock velocity std "
            f"{' '.join(f'{x:.2f}' for x in speeds)} in/s"
        )
