"""The demonstration damper dissipates energy, follows its static curve at low speed and lags at high speed."""

import numpy as np
import pytest
from scipy.integrate import cumulative_trapezoid

from eightpost.signals import Drivefile, TimeSeries
from eightpost.units import convert
from eightpost.virtual.dynamometer import Sensors, measure, random_multisine
from eightpost.virtual.shocks import TruthDamper, demo_damper

BUILDS = ("A", "B", "C")


def sine(amplitude: float, frequency: float, duration: float, rate: float = 2000.0) -> TimeSeries:
    t = np.arange(round(duration * rate) + 1) / rate
    return TimeSeries.from_channels(t, {"displacement": ("m", amplitude * np.sin(2 * np.pi * frequency * t))})


def valve_force(damper: TruthDamper, run: TimeSeries) -> np.ndarray:
    """Return the port's force minus gas spring and seal drag, which follow from their formulas."""
    gas = damper.gas_stiffness * run["displacement"] + damper.gas_preload
    return run["force"] - gas - damper.seal_drag * np.tanh(run["velocity"] / damper.seal_velocity)


@pytest.mark.parametrize("build", BUILDS)
def test_the_valve_is_monotone_zero_at_rest_and_inverted_by_the_static_force(build):
    damper = demo_damper(build)
    forces = np.linspace(-3000.0, 3000.0, 301)
    flow = np.array([damper.valve_velocity(force) for force in forces])
    assert damper.valve_velocity(0.0) == 0.0
    assert (np.diff(flow) > 0.0).all()
    assert [damper.static_force(v) for v in flow[::30]] == pytest.approx(forces[::30], abs=1e-6)


@pytest.mark.parametrize("build", BUILDS)
def test_a_slow_sine_follows_the_static_curve(build):
    damper = demo_damper(build)
    run = damper.respond(sine(0.0254, 0.1, 10.0), rate=50.0)
    static = np.array([damper.static_force(v) for v in run["velocity"]])
    np.testing.assert_allclose(valve_force(damper, run), static, atol=0.01 * np.abs(static).max())


@pytest.mark.repeated
@pytest.mark.parametrize("build", BUILDS)
def test_the_damper_is_passive(build):
    """The work done is always at least the energy stored in the fluid spring: integral F dF / k(F)."""
    damper = demo_damper(build)
    run = damper.respond(random_multisine(2, duration=2.0).series, rate=20_000.0)
    force, scale = valve_force(damper, run), damper.stiffening_force
    work = cumulative_trapezoid(force * run["velocity"], run.time, initial=0.0)
    held = scale / damper.fluid_stiffness * (np.abs(force) - scale * np.log1p(np.abs(force) / scale))
    dissipated = work - (held - held[0])
    assert dissipated.min() > -1e-6 * dissipated.max()
    assert (np.diff(dissipated) > -1e-6 * dissipated.max()).all()


@pytest.mark.repeated
@pytest.mark.parametrize(("build", "slope"), [("A", 20.0), ("B", 28.0), ("C", 10.0)])
def test_the_builds_have_their_average_slope_and_a_lag_of_one_to_two_milliseconds(build, slope):
    damper = demo_damper(build)
    run = damper.respond(random_multisine(2, duration=4.0).series, rate=2000.0)
    force, velocity = valve_force(damper, run), run["velocity"]
    fitted = convert(float(force @ velocity / (velocity @ velocity)), "N.s/m", "lbf.s/in")
    assert fitted == pytest.approx(slope, rel=0.1)
    speeds = np.linspace(velocity.min(), velocity.max(), 300)
    static = np.interp(velocity, speeds, [damper.static_force(v) for v in speeds])
    # To first order F = F_s - tau dF/dt.
    slew = np.gradient(force, run.time)
    assert 0.8e-3 < (static - force) @ slew / (slew @ slew) < 2e-3


def test_the_curves_are_digressive_and_their_sides_differ():
    for build in BUILDS:
        damper = demo_damper(build)
        for sign in (1.0, -1.0):
            slow, fast = (damper.static_force(sign * v) / (sign * v) for v in (0.02, 0.6))
            assert fast < 0.75 * slow
        assert abs(damper.static_force(0.3) / damper.static_force(-0.3) + 1.0) > 0.15


def test_an_unknown_build_and_an_uneven_command_are_refused():
    with pytest.raises(ValueError, match="'D'; there are A, B, C"):
        demo_damper("D")
    uneven = TimeSeries.from_channels([0.0, 0.1, 0.3], {"displacement": ("m", [0.0, 0.1, 0.0])})
    with pytest.raises(ValueError, match="evenly sampled"):
        demo_damper("A").respond(uneven, rate=100.0)


def test_the_sensors_quantize_and_add_noise():
    drivefile = Drivefile(sine(0.01, 2.0, 1.0))
    damper, sensors = demo_damper("C"), Sensors()
    run, truth = measure(damper, drivefile, seed=1), damper.respond(drivefile.series, rate=2000.0)
    for name, unit, resolution in (("force", "lbf", 0.1), ("displacement", "in", 1e-4), ("velocity", "in/s", 0.01)):
        readings = convert(run[name], run.unit(name), unit) / resolution
        np.testing.assert_allclose(readings, np.round(readings), atol=1e-6)
        sensor = getattr(sensors, name)
        expected = np.hypot(sensor.noise, sensor.resolution / np.sqrt(12.0))
        assert np.std(run[name] - truth[name]) == pytest.approx(expected, rel=0.1)
    np.testing.assert_array_equal(run.values, measure(damper, drivefile, seed=1).values)
