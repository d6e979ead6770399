"""A linear rig whose response is known line by line, and a target that it can reach."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest

from eightpost.drivefile import ActuatorBands, Pass, Problem, Settings, Target, advance, start_response, target_names
from eightpost.signals import TimeSeries
from eightpost.vehicle import StructuralVehicle, read_vehicle, shipped

RATE, DURATION, HIGH = 200.0, 24.0, 25.0


def roads(seed, rows, samples):
    """Return roads (rows, samples) [m] that are at rest in the first and the last 5 s, with power up to about 15 Hz."""
    noise = np.random.default_rng(seed).standard_normal((rows, samples))
    frequency = np.fft.rfftfreq(samples, 1.0 / RATE)
    shape = np.where(frequency < 15.0, 1.0, np.exp(-(((frequency - 15.0) / 2.0) ** 2))) / (1.0 + frequency)
    moving = np.fft.irfft(np.fft.rfft(noise, axis=1) * shape, samples, axis=1)
    edge = round(5.0 * RATE)
    window = np.zeros(samples)
    window[edge:-edge] = np.hanning(samples - 2 * edge) ** 0.25
    return 0.003 * window * moving / moving.std()


@dataclass(frozen=True)
class LinearRig:
    """A car on a rig that follows its commands, simulated line by line, as if the drive were periodic."""

    vehicle: StructuralVehicle
    target: Target

    def with_target(self, values):
        """Return the rig with other values of the target."""
        series = self.target.series
        return replace(
            self, target=Target(TimeSeries(series.time, values, series.names, series.units), self.target.high)
        )

    @property
    def start(self):
        return start_response(self.vehicle, self.target)

    def play(self, drive):
        lines = self.target.lines
        H = np.moveaxis(self.start.response.H, -1, 0)
        moving = lines.rows(np.einsum("kij,kj->ki", H, lines.spectrum(drive - drive[:, :1])))
        return moving + (self.start.static @ drive[:, 0])[:, None]

    def passes(self, problem, count):
        """Return the outcome after each of `count` passes."""
        passes, outcomes = [], [advance(problem, [])]
        for _ in range(count):
            drive = outcomes[-1].drive
            passes.append(Pass(drive, self.play(drive)))
            outcomes.append(advance(problem, passes))
        return outcomes


def rig_of(vehicle, seed=1):
    """Return the rig of a car, with the target that its own roads cause; the rig does not know these roads."""
    count = round(DURATION * RATE)
    model = vehicle.with_damper()
    names = target_names(model.output_names)
    units = tuple("m/s2" if name.endswith("acceleration") else "m" for name in names)
    time = np.arange(count) / RATE
    blank = TimeSeries(time, np.random.default_rng(0).standard_normal((len(names), count)), names, units)
    whole = LinearRig(vehicle, Target(blank, HIGH))
    inputs = whole.start.response.inputs
    drive = np.zeros((len(inputs), whole.target.lines.samples))
    rows = [k for k, channel in enumerate(inputs) if channel.unit == "m"]
    drive[rows, whole.target.rest : whole.target.rest + count] = roads(seed, len(rows), count)
    caused = whole.play(drive)[:, whole.target.rest : whole.target.rest + count]
    return LinearRig(vehicle, Target(TimeSeries(time, caused, names, units), HIGH)), drive


def random_car(seed, spread=0.2):
    """Return the car of Table 5.1 with masses, springs, tires and dampers changed at random."""
    car = read_vehicle(shipped("seven_dof"))
    generator = np.random.default_rng(seed)
    own = car.parameters

    def changed(value):
        return value * float(np.exp(spread * generator.standard_normal()))

    fields = ("unsprung_mass", "spring_rate", "tire_stiffness", "damping")
    corners = {name: type(getattr(own, name))(*(changed(x) for x in getattr(own, name))) for name in fields}
    body = {name: changed(getattr(own, name)) for name in ("sprung_mass", "roll_inertia", "pitch_inertia")}
    return replace(car, parameters=replace(own, **corners, **body))


@pytest.fixture(scope="session")
def quarter():
    """The quarter car's rig and the roads behind its target."""
    return rig_of(read_vehicle(shipped("quarter_car")))


@pytest.fixture(scope="session")
def seven_dof():
    """The seven-DOF car's rig and the roads behind its target."""
    return rig_of(read_vehicle(shipped("seven_dof")))


@pytest.fixture(scope="session")
def settings():
    """Settings with the largest gain, a negligible regularisation, and no correction of the response."""
    return Settings(gain=1.0, regularisation=1e-7, is_updated=False, has_means=False)


def problem_of(rig, settings, vehicle=None, factor=1.0):
    """Return the problem of a rig's target that starts with the response of a car, multiplied by a factor."""
    start = start_response(vehicle or rig.vehicle, rig.target, actuators=ActuatorBands())
    return Problem(
        rig.target, replace(start, response=start.response.with_response(factor * start.response.H)), settings
    )
