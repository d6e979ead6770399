"""The physical damper conserves its fluid, follows its valves at low speed, dissipates, cavitates, and converges."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import cumulative_trapezoid

from eightpost.errors import ParameterError
from eightpost.signals import TimeSeries
from eightpost.units import convert
from eightpost.virtual import BUILDS, CONFIGURATIONS, cavitation, configuration, random_multisine, shim_build
from eightpost.virtual.damper import _filling
from eightpost.virtual.valves import SHIM_SETS, Bleed, Fluid, Seals, ShimStack

INCH, POUND, PSI, ATMOSPHERE = 0.0254, 4.4482216152605, 6894.757293168, 101_325.0


def motion(function, duration, rate=2000.0):
    time = np.arange(round(duration * rate) + 1) / rate
    return TimeSeries.from_channels(time, {"displacement": ("m", function(time))})


def sine(amplitude, frequency, duration):
    return motion(lambda t: amplitude * np.sin(2 * np.pi * frequency * t), duration)


def content(fluid, p):
    """Fluid per chamber volume: the formula of the docstring, implemented independently for arrays."""
    gas = fluid.gas_fraction * ((ATMOSPHERE - fluid.vapour_pressure) / (p - fluid.vapour_pressure)) ** (
        1 / fluid.gas_exponent
    )
    liquid = (1 - fluid.gas_fraction) * np.exp((ATMOSPHERE - p) / fluid.bulk_modulus)
    return np.exp((p - ATMOSPHERE) / fluid.wall_modulus) / (liquid + gas)


def volumes(damper, run):
    body, x = damper.cylinder, run["displacement"]
    area, rod = math.pi / 4 * body.bore**2, math.pi / 4 * body.rod**2
    return area * (body.compression_length - x), (area - rod) * (body.rebound_length + x)


@pytest.mark.parametrize("number", [1, 5])
def test_fluid_is_conserved(number):
    damper = configuration(number)
    run = damper.respond(random_multisine(3, duration=0.6).series, rate=2000.0)
    chambers = volumes(damper, run)
    fluid = sum(
        volume * content(damper.fluid, run[f"{name}_pressure"])
        for volume, name in zip(chambers, ("compression", "rebound"), strict=True)
    )
    gas = damper.gas.volume * (damper.gas.charge / run["gas_pressure"]) ** (1 / damper.gas.exponent)
    assert np.ptp(fluid - gas) < 1e-5 * np.ptp(chambers[0])


def test_the_gain_of_the_rebound_chamber_is_the_flow_through_the_main_piston():
    damper = configuration(1)
    run = damper.respond(sine(0.01, 5.0, 0.3), rate=20_000.0)
    held = volumes(damper, run)[1] * content(damper.fluid, run["rebound_pressure"])
    drop = run["compression_pressure"] - run["rebound_pressure"]
    through = cumulative_trapezoid([damper.plant.main.flow(d) for d in drop.tolist()], run.time, initial=0)
    np.testing.assert_allclose(held - held[0], through, atol=1e-4 * np.ptp(through))


@pytest.mark.parametrize("build", ["AA/AA", "C/B"])
@pytest.mark.parametrize("speed", [4.0, -12.0])
def test_the_force_at_a_steady_speed_is_the_sum_of_valve_and_gas_force(build, speed):
    damper = shim_build(build)
    v = speed * INCH
    run = damper.respond(motion(lambda t: v * (t - 0.1), 0.2), rate=2000.0)
    last = {name: run[name][-1] for name in run.names}
    gas = (last["gas_pressure"] - ATMOSPHERE) * damper.cylinder.rod_area
    # The chambers' stiffness lets a few percent of the flow go into the rise of gas pressure and stored fluid.
    assert last["force"] - gas - last["seal_drag"] == pytest.approx(damper.static_force(v), rel=0.01)


@pytest.mark.parametrize("x", [-1.0, 0.0, 2.0])
@pytest.mark.parametrize("psi", [50.0, 150.0])
def test_the_force_at_rest_is_the_gas_force_of_the_polytropic_law(x, psi):
    damper = shim_build("B/B", gas_pressure=psi * PSI)
    run = damper.respond(motion(lambda t: np.full(t.size, x * INCH), 0.01), rate=1000.0)
    rod = math.pi / 4 * damper.cylinder.rod**2
    volume = damper.gas.volume - rod * x * INCH
    pressure = (psi * PSI + ATMOSPHERE) * (damper.gas.volume / volume) ** damper.gas.exponent - ATMOSPHERE
    assert run["force"][-1] == pytest.approx(pressure * rod, rel=0.005)


def test_the_gas_rate_at_150_psi_is_about_4_pounds_per_inch():
    damper = shim_build("B/B")
    levels = [damper.respond(motion(lambda t, x=x: np.full(t.size, x * INCH), 0.01), rate=1000.0) for x in (-0.5, 0.5)]
    rate = (levels[1]["force"][-1] - levels[0]["force"][-1]) / POUND
    assert rate == pytest.approx(4.0, abs=0.3)


@pytest.mark.parametrize("build", BUILDS)
def test_the_seven_builds_have_their_nominal_damping(build):
    # Mixed builds lie between the builds of their two sides, because the slope is fitted over both directions.
    nominal = {"AA": 9.0, "B": 20.0, "C": 30.0}
    sides = [nominal[code] for code in build.split("/")]
    slope = convert(shim_build(build).nominal_damping(), "N.s/m", "lbf.s/in")
    assert slope == pytest.approx(sum(sides) / 2, rel=0.05)


def test_cavitation_limits_the_compression_force_and_gas_and_head_valve_raise_the_limit():
    weak, charged = (shim_build("F/F", gas_pressure=psi * PSI) for psi in (0.0, 150.0))
    for damper in (weak, charged):
        head_only = damper.steady_pressures(1.0)[0]
        limit = (head_only - ATMOSPHERE) * damper.cylinder.rod_area
        limit += (head_only - damper.fluid.vapour_pressure) * damper.cylinder.rebound_area
        gas = (damper.gas.charge - ATMOSPHERE) * damper.cylinder.rod_area
        assert damper.static_force(1.0) == pytest.approx(limit - gas)
        run = damper.respond(motion(lambda t: 0.005 - 0.02 * np.cos(2 * np.pi * 10 * t), 0.2), rate=4000.0)
        assert min(run["rebound_pressure"].min(), run["compression_pressure"].min()) > damper.fluid.vapour_pressure
    assert charged.static_force(1.0) > weak.static_force(1.0) + 100.0 * POUND
    assert cavitation(run).lowest == run["rebound_pressure"].min()


@pytest.mark.nightly
def test_only_the_soft_head_valve_at_low_gas_pressure_cavitates():
    found = {}
    for number in (1, 5, 7):
        run = configuration(number).respond(random_multisine(1, duration=3.0).series, rate=1000.0, tolerance=1e-5)
        found[number] = cavitation(run).cavitates
    assert found == {1: False, 5: True, 7: False}


def test_a_finer_tolerance_changes_the_force_by_less_than_the_resolution_of_a_load_cell():
    command = random_multisine(4, duration=1.0).series
    usual, fine = (configuration(5).respond(command, rate=2000.0, tolerance=tol)["force"] for tol in (1e-6, 1e-9))
    assert np.abs(usual - fine).max() < 0.2 * POUND


def test_the_jacobian_equals_finite_differences_of_the_rates():
    plant = configuration(6).plant
    rates, jacobian = (make(lambda t: (0.004, 0.3 * t)) for make in (plant.rates, plant.jacobian))
    for a, b, w, t in ((1.2, 1.0, 1.0, 0.4), (3.0, -2.0, 0.9, 1.0), (-1.0, 3.5, 1.2, -1.5), (2.0, 2.5, 1.1, 0.0)):
        states = np.array([a, b, w])
        columns = [np.subtract(rates(states + step, t), rates(states - step, t)) / 2e-6 for step in 1e-6 * np.eye(3)]
        expected = np.stack(columns, axis=1)
        np.testing.assert_allclose(jacobian(states, t), expected, atol=1e-6 * np.abs(expected).max(axis=1).min())


@pytest.mark.parametrize("pressure", [1e4, 1e5, 5e5, 5e6])
def test_the_softness_of_the_equations_equals_the_slope_of_the_fluids_formula(pressure):
    fluid = Fluid(gas_fraction=0.01)
    step = 1e-4 * pressure
    slope = np.log(content(fluid, pressure + step) / content(fluid, pressure - step)) / (2 * step)
    _, _, softness = _filling(fluid)(fluid.level(pressure))
    assert softness == pytest.approx((pressure - fluid.vapour_pressure) * slope, rel=1e-5)


@settings(max_examples=12, deadline=None)
@given(
    compression=st.sampled_from(sorted(SHIM_SETS)),
    rebound=st.sampled_from(sorted(SHIM_SETS)),
    clicks=st.integers(0, 28),
    psi=st.floats(10.0, 300.0),
    frequency=st.floats(2.0, 12.0),
    speed=st.floats(1.0, 25.0),
)
def test_every_build_dissipates_energy_over_a_cycle_and_stays_above_vapour_pressure(
    compression, rebound, clicks, psi, frequency, speed
):
    damper = shim_build(f"{compression}/{rebound}", clicks=clicks, gas_pressure=psi * PSI)
    amplitude = speed * INCH / (2 * np.pi * frequency)
    run = damper.respond(sine(amplitude, frequency, 3.0 / frequency), rate=4000.0)
    work = cumulative_trapezoid(run["force"] * run["velocity"], run.time, initial=0)
    at = np.interp([1.0 / frequency, 2.0 / frequency], run.time, work)
    assert at[1] > at[0] > 0.0
    assert run["rebound_pressure"].min() > damper.fluid.vapour_pressure
    assert run["warming"][-1] == pytest.approx(work[-1] / damper.heat_capacity)


def test_clicks_close_the_bleed_and_stiffen_only_the_rebound_side():
    few, many, most = (shim_build("B/B", clicks=clicks) for clicks in (1, 14, 28))
    assert most.piston.bleed.area == 0.0
    assert 1.05 * abs(few.static_force(-0.05)) < abs(many.static_force(-0.05)) < abs(most.static_force(-0.05))
    assert many.static_force(0.05) == pytest.approx(few.static_force(0.05))


def test_the_stiffness_of_the_19_stacks_rises_with_the_cubes_of_the_shim_thicknesses():
    stiffness = [ShimStack(code, backing=0.0).stiffness for code in SHIM_SETS]
    assert len(stiffness) == 19
    # AA+ and A- have the same four shims, as all such pairs do, so the stiffness is never decreasing.
    assert (np.diff(stiffness) > -1e-9 * stiffness[-1]).all()
    assert stiffness[-1] / stiffness[0] == pytest.approx((0.020 / 0.004) ** 3)


def test_the_seal_drag_is_kept_at_rest_and_reverses_with_the_rod():
    path = np.concatenate([np.linspace(0, 1e-3, 200), np.full(50, 1e-3), np.linspace(1e-3, 0, 200)])
    drag = Seals().force(path)
    assert 3.0 * POUND <= drag[225] <= 5.0 * POUND
    assert drag[225] == drag[199]
    assert drag[-1] == pytest.approx(-drag[225], rel=1e-6)


def test_the_configurations_have_the_order_of_the_twelve_rows_of_table_3_1():
    rows = [(s.build, round(s.gas_pressure / PSI), s.clicks) for s in CONFIGURATIONS.values()]
    assert rows[:4] == [(1, 50, 1), (1, 50, 14), (1, 150, 1), (1, 150, 14)]
    assert [row[0] for row in rows] == [1] * 4 + [2] * 4 + [4] * 4
    assert configuration(9).piston.compression.stack.stiffness < configuration(1).piston.compression.stack.stiffness
    assert configuration(5).head.compression.stack.stiffness < configuration(1).head.compression.stack.stiffness


@pytest.mark.parametrize(
    ("make", "what"),
    [
        (lambda: configuration(13), "1 to 12"),
        (lambda: shim_build("B"), "COMPRESSION/REBOUND"),
        (lambda: shim_build("B/Q"), "'Q' in Table 7.2"),
        (lambda: shim_build("B/B", gas_pressure=-1.0), "gas pressure"),
        (lambda: shim_build("B/B", gas_pressure=math.nan), "gas pressure"),
        (lambda: Bleed(29, area_per_click=1e-7), "0 to 28"),
        (lambda: configuration(1).respond(sine(0.2, 1.0, 1.0), rate=100.0), "travel"),
    ],
)
def test_invalid_builds_and_motions_are_refused(make, what):
    with pytest.raises(ParameterError, match=what):
        make()
