"""Sets of tests: what is run on a rig to identify a car, to judge linearity, and to validate (4.5.1, 6.1.3, 6.1.5)."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, partial
from typing import TYPE_CHECKING, Literal

from eightpost.errors import ParameterError
from eightpost.rig.post.drivefiles import (
    HEAVE_SINES,
    SIGNS,
    TABLE_4_4,
    TILT_SINES,
    bump_drive,
    quarter_random,
    random_drive,
    sine_drive,
    static_drive,
)
from eightpost.rig.post.lap import track_drive
from eightpost.units import convert

if TYPE_CHECKING:
    from collections.abc import Callable

    from eightpost.rig.post.car import Car
    from eightpost.signals.drivefile import Drivefile

_INCH = convert(1.0, "in", "m")

#: Length of the random tests [s]: 4.5.1 on the quarter-car rig, 6.1.3 on the 8-post rig; of its single-input tests.
QUARTER_RANDOM, RANDOM, SINGLE = 120.0, 800.0, 100.0

#: Whether alternate tests repeat the baseline's drivefile (6.1.5) or have another draw each.
Draws = Literal["same", "other"]


@dataclass(frozen=True, slots=True)
class PlannedTest:
    """One test of a program.

    Attributes:
        name: Of its file, without suffix.
        drivefile: What it is, in words.
        draw: Makes the drivefile; tests with the same one share it.
        alternate: The corner that has the alternate shock, None where all have the baseline's.
    """

    name: str
    drivefile: str
    draw: Callable[[], Drivefile]
    alternate: str | None = None


def identification_program(
    car: Car, seed: int, *, duration: float | None = None, draws: Draws = "same"
) -> tuple[PlannedTest, ...]:
    """Return `baseline` and one `alternate_<corner>` per corner under the random drivefile (6.1.5).

    Args:
        car: To be identified.
        seed: Of the drivefile.
        duration: [s]; 800, on a quarter car 120.
        draws: `other` gives each alternate test the next seeds; the local polynomial method and the global H1 then
            know more, the dissertation's way of differences (Eq 4.26) takes `same`.
    """
    length = duration or random_length(car)
    first = cache(partial(random_test, car, seed, duration=length))
    planned = [PlannedTest("baseline", _random(length, seed), first)]
    for k, corner in enumerate(car.corners, start=1):
        own = seed + k if draws == "other" else seed
        draw = cache(partial(random_test, car, own, duration=length)) if draws == "other" else first
        planned.append(PlannedTest(f"alternate_{corner}".rstrip("_"), _random(length, own), draw, corner))
    return tuple(planned)


def random_length(car: Car) -> float:
    """Return the length of the random test that the dissertation has for a car [s]."""
    return RANDOM if len(car.corners) == 4 else QUARTER_RANDOM


def random_test(car: Car, seed: int, *, duration: float) -> Drivefile:
    """Return a car's random drivefile: Table 6.3, on a quarter car the multisine of Table 4.3."""
    if len(car.corners) == 1:
        return quarter_random(seed, duration=duration)
    return random_drive(car, seed, duration=duration)


def bump_test(car: Car, *, duration: float | None = None) -> Drivefile:
    """Return a car's bump test: 0.4 in, 10 s period, 50 s; on a quarter car 1 in, 20 s, 60 s (4.5.1)."""
    if len(car.corners) == 1:
        return bump_drive(car, height=_INCH, period=20.0, duration=duration or 60.0)
    return bump_drive(car, duration=duration or 50.0)


def single_program(car: Car, seed: int) -> tuple[PlannedTest, ...]:
    """Return `single_<input>` for each input alone, 100 s each (6.1.3), every one with another draw."""
    return tuple(
        PlannedTest(
            f"single_{name.replace('.', '_')}",
            f"{name} alone, random, {SINGLE:g} s, seed {seed + k}",
            partial(random_drive, car, seed + k, duration=SINGLE, active=(name,)),
        )
        for k, name in enumerate(car.inputs)
    )


def sine_program(car: Car) -> tuple[PlannedTest, ...]:
    """Return `sine_<mode>_<frequency>hz` of Table 6.2 in heave, pitch and roll; on a quarter car those of Table 4.4."""
    tables = {"heave": HEAVE_SINES, "pitch": TILT_SINES, "roll": TILT_SINES}
    if len(car.corners) == 1:
        tables = {"heave": TABLE_4_4}
    return tuple(
        PlannedTest(
            f"sine_{mode}_{frequency:g}hz",
            f"sine, {mode}, {frequency:g} Hz, {amplitude:g} in",
            partial(sine_drive, car, frequency, amplitude * _INCH, mode=mode),
        )
        for mode, table in tables.items()
        for frequency, amplitude in table
    )


def bump_program(car: Car) -> tuple[PlannedTest, ...]:
    """Return `bump`."""
    return (PlannedTest("bump", "bump", partial(bump_test, car)),)


def static_program(car: Car) -> tuple[PlannedTest, ...]:
    """Return `static_<mode>` and `static_<corner>` of the spring rating (6.1.3), where the car has aeroloaders."""
    if car.loads != car.named("aero"):
        return ()
    kinds = {mode: mode for mode in SIGNS} | dict(zip(car.corners, car.loads, strict=True))
    return tuple(
        PlannedTest(f"static_{name}", f"static loading, {name}", partial(static_drive, car, kind))
        for name, kind in kinds.items()
    )


def track_program(car: Car, seed: int) -> tuple[PlannedTest, ...]:
    """Return `track_baseline` and `track_alternate_<corner>` (6.1.5), where the car has four wheels."""
    if car.geometry is None:
        return ()
    lap, words = cache(partial(track_drive, car, seed)), f"track, seed {seed}"
    baseline = PlannedTest("track_baseline", words, lap)
    return (baseline, *(PlannedTest(f"track_alternate_{corner}", words, lap, corner) for corner in car.corners))


#: The programs by the name that the command line uses.
PROGRAMS = ("identification", "single", "sine", "bump", "static", "track", "all")


def program(
    name: str, car: Car, seed: int, *, duration: float | None = None, draws: Draws = "same"
) -> tuple[PlannedTest, ...]:
    """Return a program's tests.

    Args:
        name: One of `PROGRAMS`.
        car: To be tested; `all` leaves out what it has no actuators for.
        seed: Of the drivefiles.
        duration: As of `identification_program`.
        draws: As of `identification_program`.

    Raises:
        ParameterError: There is no such program, or nothing in it for this car.
    """
    if name not in PROGRAMS:
        raise ParameterError(f"no program {name!r}; there are {', '.join(PROGRAMS)}")
    made: dict[str, Callable[[], tuple[PlannedTest, ...]]] = {
        "identification": partial(identification_program, car, seed, duration=duration, draws=draws),
        # Other seeds than the identification's: records to judge a model by must be others than it was made of.
        "single": partial(single_program, car, seed + 100),
        "sine": partial(sine_program, car),
        "bump": partial(bump_program, car),
        "static": partial(static_program, car),
        "track": partial(track_program, car, seed + 200),
    }
    wanted = made if name == "all" else {name: made[name]}
    tests = tuple(test for tests in wanted.values() for test in tests())
    if not tests:
        raise ParameterError(f"the {car.name} has no {name} tests: it lacks the actuators")
    return tests


def _random(duration: float, seed: int) -> str:
    return f"random, {duration:g} s, seed {seed}"
