"""The virtual rig as a bench: tests by their names, and records with their conditions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from eightpost import __version__, units
from eightpost.errors import InputError
from eightpost.rig.post.channels import RigSensors
from eightpost.rig.post.drivefiles import random_drive, sine_drive, static_drive, track_drive
from eightpost.rig.post.program import (
    NO_DRIFT,
    SINGLE,
    PlannedTest,
    bump_test,
    random_length,
    random_test,
    run_test,
)
from eightpost.rig.post.rig_test import RigConditions, RigTest
from eightpost.rig.post.shocks import shocks_named
from eightpost.rig.post.truths import AnyCar, truth_named
from eightpost.signals.drivefile import Drivefile


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

        Args:
            truth: Name of the car, one of `TRUTHS`.
            car_seed: Seed of the parameters of the flexible car; None gives its base parameters.
            friction: Whether the car has friction.
            noise: Whether the sensors have noise and the rig drifts.
            run: Seed of noise and drift.
            seed: Seed of the drive files, for the note.
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
        """Run a test.

        Args:
            drivefile: Commands of the actuators.
            shocks: Name of the shock at each corner.
            words: Description of the drive file.
            number: Number of the test; each is another run with its own drift and noise.
        """
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

    def record_planned(self, planned: PlannedTest, number: int, baseline: Sequence[str], alternate: str) -> RigTest:
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
        """Return the drive file of a single test.

        Args:
            test: Kind of the test: random, single, sine, bump, static or track.
            seed: Seed of the drive file.
            duration: Length of the test [s]; None: that of the dissertation.
            only: Actuator of a single or static test.
            mode: Mode of a sine or static test.
            frequency: Sine frequency [Hz].
            amplitude: Sine amplitude [m].

        Raises:
            InputError: A single test has no actuator.
        """
        car = self.car
        if test == "single":
            if not only:
                raise InputError(f"--test single needs --only, one of {', '.join(car.inputs)}")
            return random_drive(car, seed, duration=duration or SINGLE, active=(only,))
        if test == "random":
            return random_test(car, seed, duration=duration or random_length(car))
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
