"""The dampers obey their equations: they conserve fluid, follow their valves at low speed, dissipate, and converge.

The valving that gives a curve is found among all combinations, with the level of the force left open.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import cumulative_trapezoid, solve_ivp
from scipy.interpolate import CubicSpline

from eightpost.errors import ParameterError
from eightpost.shock import LAWS, read_shock
from eightpost.signals import TimeSeries
from eightpost.units import convert
from eightpost.virtual import (
    BUILDS,
    CONFIGURATIONS,
    LinearDamper,
    cavitation,
    configuration,
    demo_damper,
    random_multisine,
    shim_build,
)
from eightpost.virtual.damper import PSI, PhysicalDamper, Valving, nearest_valving
from eightpost.virtual.kernel import NUMBERS, _filling, _plant, shock_force
from eightpost.virtual.shocks import TruthDamper
from eightpost.virtual.simulate import _bank
from eightpost.virtual.valves import SHIM_SETS, ShimStack
from tests.drawn import rounded

INCH, POUND, ATMOSPHERE = 0.0254, 4.4482216152605, 101_325.0


def motion(function, duration, rate=2000.0):
    time = np.arange(round(duration * rate) + 1) / rate
    return TimeSeries.from_channels(time, {"displacement": ("m", function(time))})


def sine(amplitude, frequency, duration, rate=2000.0):
    return motion(lambda t: amplitude * np.sin(2 * np.pi * frequency * t), duration, rate)


def main_flow(damper, drop):
    """Signed flow of the main piston: the formula of `Passage`, implemented independently."""
    p = damper.main_valve.forward if drop >= 0.0 else damper.main_valve.backward
    size = abs(drop)
    lift = size - p.preload if size >= 2.0 * p.preload else size**2 / (4.0 * p.preload)
    gap = p.opening * lift / math.sqrt(1.0 + (p.opening * lift / p.port) ** 2)
    return math.copysign(p.orifice * size / (size**2 + p.transition**2) ** 0.25 + gap * math.sqrt(size), drop)


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


def test_fluid_is_conserved_also_when_it_cavitates():
    damper = configuration(5)
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
    through = cumulative_trapezoid([main_flow(damper, d) for d in drop.tolist()], run.time, initial=0)
    np.testing.assert_allclose(held - held[0], through, atol=1e-4 * np.ptp(through))


@pytest.mark.parametrize(("build", "speed"), [("AA/AA", -12.0), ("C/B", 4.0)])
def test_the_force_at_a_steady_speed_is_the_sum_of_valve_and_gas_force(build, speed):
    damper = shim_build(build)
    v = speed * INCH
    run = damper.respond(motion(lambda t: v * (t - 0.1), 0.2), rate=2000.0)
    last = {name: run[name][-1] for name in run.names}
    gas = (last["gas_pressure"] - ATMOSPHERE) * damper.cylinder.rod_area
    # The chambers' stiffness lets a few percent of the flow go into the rise of gas pressure and stored fluid.
    assert last["force"] - gas - last["seal_drag"] == pytest.approx(damper.static_force(v), rel=0.01)


@pytest.mark.parametrize(("x", "psi"), [(-1.0, 50.0), (2.0, 150.0)])
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
        run = configuration(number).respond(random_multisine(1, duration=3.0).series, rate=1000.0)
        found[number] = cavitation(run).cavitates
    assert found == {1: False, 5: True, 7: False}


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


def test_the_stiffness_of_the_19_stacks_rises_with_the_cubes_of_the_shim_thicknesses():
    stiffness = [ShimStack(code, backing=0.0).stiffness for code in SHIM_SETS]
    assert len(stiffness) == 19
    # AA+ and A- have the same four shims, as all such pairs do, so the stiffness is never decreasing.
    assert (np.diff(stiffness) > -1e-9 * stiffness[-1]).all()
    assert stiffness[-1] / stiffness[0] == pytest.approx((0.020 / 0.004) ** 3)


def test_the_configurations_have_the_order_of_the_twelve_rows_of_table_3_1():
    rows = [(s.build, round(s.gas_pressure / PSI), s.clicks) for s in CONFIGURATIONS.values()]
    assert rows[:4] == [(1, 50, 1), (1, 50, 14), (1, 150, 1), (1, 150, 14)]
    assert [row[0] for row in rows] == [1] * 4 + [2] * 4 + [4] * 4
    assert configuration(9).main_valve.forward.opening > configuration(1).main_valve.forward.opening
    assert configuration(5).head_valve.forward.opening > configuration(1).head_valve.forward.opening


@pytest.mark.parametrize(
    ("make", "what"),
    [
        (lambda: configuration(13), "1 to 12"),
        (lambda: shim_build("B"), "COMPRESSION/REBOUND"),
        (lambda: shim_build("B/Q"), "'Q' in Table 7.2"),
        (lambda: shim_build("B/B", gas_pressure=-1.0), "gas pressure"),
        (lambda: shim_build("B/B", gas_pressure=math.nan), "gas pressure"),
        (lambda: shim_build("B/B", clicks=29), "0 to 28"),
        (lambda: configuration(1).respond(sine(0.2, 1.0, 1.0), rate=100.0), "travel"),
    ],
)
def test_invalid_builds_and_motions_are_refused(make, what):
    with pytest.raises(ParameterError, match=what):
        make()


# ---- The compiled steps, which the dynamometer and the rig share ----------------------------------------------------

STEP = 2e-4
TIME = STEP * np.arange(1001)
PLACE = 0.004 * (1.0 - np.cos(2 * np.pi * 4.0 * TIME)) + 0.001 * (1.0 - np.cos(2 * np.pi * 17.0 * TIME))
SPEED = 0.004 * 8 * np.pi * np.sin(2 * np.pi * 4.0 * TIME) + 0.001 * 34 * np.pi * np.sin(2 * np.pi * 17.0 * TIME)


def stepped(shock):
    """Return the force (N,) of a shock on the rig for the motion, step by step."""
    bank, work = _bank([shock]), np.empty((10, 3))
    state, forces = bank.starts[0].copy(), [0.0]
    for k in range(1, TIME.size):
        motion = SPEED[k - 1], SPEED[k], PLACE[k], STEP
        forces.append(shock_force(bank.kinds[0], bank.numbers[0], bank.laws[0], state, *motion, work))
    return np.array(forces)


@pytest.mark.repeated(2)
@pytest.mark.parametrize("name", LAWS)
def test_a_shock_law_gives_the_same_force_as_outside_the_rig(shocks, name):
    law = shocks[name].law
    state, expected = law.start(0.0), [0.0]
    for k in range(1, TIME.size):
        state = law.advance(state, SPEED[k - 1], SPEED[k], STEP)
        expected.append(law.response(state, SPEED[k], PLACE[k]).force)
    assert np.abs(stepped(law)[1:] - np.array(expected)[1:]).max() < 1e-9 * np.std(expected)


def test_a_linear_damper_is_linear():
    assert stepped(LinearDamper(1500.0))[1:] == pytest.approx(1500.0 * SPEED[1:])


@pytest.mark.parametrize(("damper", "tolerance"), [(demo_damper("A"), 5e-3), (configuration(1), 1e-2)])
def test_the_rigs_steps_are_close_to_the_fine_ones_of_the_dynamometer(damper, tolerance):
    command = TimeSeries.from_channels(TIME, {"displacement": ("m", PLACE)})
    expected = damper.respond(command, rate=1.0 / STEP)["force"]
    assert np.abs(stepped(damper) - expected)[50:].max() < tolerance * np.std(expected)


def test_the_physical_damper_agrees_with_its_equations_in_scipys_integrator():
    damper, command = configuration(5), random_multisine(4, duration=0.5).series
    run = damper.respond(command, rate=2000.0)
    path, fluid, gas, body = (
        CubicSpline(command.time, command["displacement"]),
        damper.fluid,
        damper.gas,
        damper.cylinder,
    )
    area, rod = math.pi / 4 * body.bore**2, math.pi / 4 * body.rod**2

    def flow(valve, drop):
        return main_flow(SimpleNamespace(main_valve=valve), drop)

    def rates(t, y):
        p_c, p_r, v_g = y
        x, v, p_g = path(t), path(t, 1), gas.charge * (gas.volume / v_g) ** gas.exponent
        through, out = flow(damper.main_valve, p_c - p_r), flow(damper.head_valve, p_c - p_g)
        slope = lambda p: (content(fluid, p * (1 + 1e-6)) - content(fluid, p * (1 - 1e-6))) / (2e-6 * p)  # noqa: E731
        v_c, v_r = area * (body.compression_length - x), (area - rod) * (body.rebound_length + x)
        filled = area * v * content(fluid, p_c), -(area - rod) * v * content(fluid, p_r)
        return [(filled[0] - through - out) / (v_c * slope(p_c)), (filled[1] + through) / (v_r * slope(p_r)), -out]

    start = [run["compression_pressure"][0], run["rebound_pressure"][0],
             gas.volume * (gas.charge / run["gas_pressure"][0]) ** (1 / gas.exponent)]  # fmt: skip
    atol = [10.0, 10.0, 1e-12]
    found = solve_ivp(rates, (0.0, 0.3), start, method="LSODA", t_eval=run.time[:601], rtol=1e-8, atol=atol).y
    force = found[0] * area - found[1] * (area - rod) - ATMOSPHERE * rod
    assert np.abs((run["force"] - run["seal_drag"])[:601] - force).max() < 0.2 * POUND


def test_the_jacobian_of_the_compiled_steps_equals_finite_differences():
    numbers, unused = np.zeros(NUMBERS), np.zeros((3, 3))
    numbers[:] = configuration(6).row.numbers
    for x, v, *states in ((0.004, 0.1, 1.2, 1.0, 1.0), (0.0, -0.4, 3.0, -2.0, 0.9), (0.01, 0.2, -1.0, 3.5, 1.2)):
        y, rates, jacobian = np.array(states), np.zeros(3), np.zeros((3, 3))
        _plant(numbers, x, v, y, rates, jacobian)
        columns = []
        for step in 1e-6 * np.eye(3):
            ends = np.zeros((2, 3))
            for sign, end in zip((1.0, -1.0), ends, strict=True):
                _plant(numbers, x, v, y + sign * step, end, unused)
            columns.append((ends[0] - ends[1]) / 2e-6)
        expected = np.stack(columns, axis=1)
        np.testing.assert_allclose(jacobian, expected, atol=1e-6 * np.abs(expected).max(axis=1).min())


@pytest.mark.parametrize("pressure", [1e4, 1e5, 5e5, 5e6])
def test_the_softness_of_the_equations_equals_the_slope_of_the_fluids_formula(pressure):
    damper = configuration(2)
    fluid, step, numbers = damper.fluid, 1e-4 * pressure, np.zeros(NUMBERS)
    numbers[:] = damper.row.numbers
    slope = np.log(content(fluid, pressure + step) / content(fluid, pressure - step)) / (2 * step)
    excess, held, softness, _ = _filling(numbers, fluid.level(pressure))
    assert (excess, held) == pytest.approx((pressure - fluid.vapour_pressure, content(fluid, pressure)))
    assert softness == pytest.approx((pressure - fluid.vapour_pressure) * slope, rel=1e-5)


def test_the_seal_drag_is_kept_at_rest_and_reverses_with_the_rod():
    path = np.concatenate([np.linspace(0, 1e-3, 200), np.full(50, 1e-3), np.linspace(1e-3, 0, 200)])
    command = TimeSeries.from_channels(np.arange(450) / 1000.0, {"displacement": ("m", path)})
    drag = shim_build("B/B").respond(command, rate=1000.0)["seal_drag"]
    assert 3.0 * POUND <= drag[225] <= 5.0 * POUND
    assert drag[-1] == pytest.approx(-drag[190], rel=1e-6)
    assert drag[190] == pytest.approx(4.5 * POUND, rel=1e-6)


# ---- Demonstration dampers ------------------------------------------------------------------------------------------


def valve_force(damper: TruthDamper, run: TimeSeries) -> np.ndarray:
    """Return the port's force minus gas spring and seal drag, which follow from their formulas."""
    gas = damper.gas_stiffness * run["displacement"] + damper.gas_preload
    return run["force"] - gas - damper.seal_drag * np.tanh(run["velocity"] / damper.seal_velocity)


@pytest.mark.parametrize("build", "ABC")
def test_the_valve_is_monotone_zero_at_rest_and_inverted_by_the_static_force(build):
    damper = demo_damper(build)
    forces = np.linspace(-3000.0, 3000.0, 301)
    flow = np.array([damper.valve_velocity(force) for force in forces])
    assert damper.valve_velocity(0.0) == 0.0
    assert (np.diff(flow) > 0.0).all()
    assert [damper.static_force(v) for v in flow[::30]] == pytest.approx(forces[::30], abs=1e-6)


@pytest.mark.parametrize("build", "ABC")
def test_a_slow_sine_follows_the_static_curve(build):
    damper = demo_damper(build)
    run = damper.respond(sine(0.0254, 0.1, 10.0), rate=50.0)
    static = np.array([damper.static_force(v) for v in run["velocity"]])
    np.testing.assert_allclose(valve_force(damper, run), static, atol=0.01 * np.abs(static).max())


@pytest.mark.repeated
@pytest.mark.parametrize("build", "ABC")
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


def test_an_unknown_build_and_an_uneven_command_are_refused():
    with pytest.raises(ValueError, match="'D'; there are A, B, C"):
        demo_damper("D")
    uneven = TimeSeries.from_channels([0.0, 0.1, 0.3, 0.4], {"displacement": ("m", [0.0, 0.1, 0.0, 0.0])})
    with pytest.raises(ValueError, match="evenly spaced"):
        demo_damper("A").respond(uneven, rate=100.0)


BANK = Path(__file__).resolve().parents[2] / "examples" / "bank"


@pytest.mark.nightly
def test_the_static_curve_of_a_valving_is_found_again_with_a_level_that_is_not_its_own():
    valving = Valving("C", "E", head="A", clicks=12, jet=0.5e-6, dish=0.1e-3)
    found = nearest_valving(wanted(valving, -40.0))
    assert found.valving == valving and found.limits == ()
    assert found.level == pytest.approx(-40.0, abs=0.1) and found.residual < 0.1
    assert found.combinations > 10_000_000


def wanted(valving, level):
    """Return the static force of a valving, with its seals and a level."""
    damper = valving.damper()
    return lambda velocity: damper.static_force(velocity) + np.copysign(damper.seals.drag, velocity) + level


@pytest.mark.parametrize("level", [-40.0, 60.0])
def test_among_few_parts_the_valving_of_a_curve_is_found_with_its_level(monkeypatch, level):
    monkeypatch.setattr("eightpost.virtual.damper._CODES", ("B", "C", "E", "F"))
    monkeypatch.setattr("eightpost.virtual.damper.JETS", (0.3e-6, 0.5e-6, 0.8e-6))
    monkeypatch.setattr("eightpost.virtual.damper.DISHES", (0.0, 0.1e-3, 0.2e-3))
    valving = Valving("C", "E", head="C", clicks=12, jet=0.5e-6, dish=0.1e-3)
    found = nearest_valving(wanted(valving, level))
    assert (found.valving, found.limits, found.combinations) == (valving, (), 3 * 3 * 4**3 * 29)
    assert (found.level, found.residual) == (pytest.approx(level, abs=0.1), pytest.approx(0.0, abs=0.1))
    assert found.velocity == pytest.approx(-found.velocity[::-1])
    force = wanted(valving, level)
    assert found.force == pytest.approx([force(v) for v in found.velocity.tolist()], abs=0.5)
    far = nearest_valving(lambda velocity: 1e5 * velocity)
    assert {"jet", "dish", "compression", "rebound", "head"} >= set(far.limits) > {"jet"}
    assert far.relative == pytest.approx(far.residual / (1e5 * np.sqrt(np.mean(far.velocity**2))))


@pytest.mark.nightly
@pytest.mark.parametrize("build", ["C/B", "B/C"])
def test_from_the_fit_of_a_dynamometer_test_the_shims_of_the_shock_are_found(build):
    shock = read_shock(BANK / f"{build.replace('/', '_')}.json")
    found = nearest_valving(shock.law.curve.force)
    assert (found.valving.compression, found.valving.rebound, found.valving.head) == (*build.split("/"), "B")
    assert found.relative < 0.02


def test_a_curve_without_force_is_refused():
    with pytest.raises(ParameterError, match="no force at any velocity"):
        nearest_valving(lambda _velocity: 0.0)


SPEEDS = (-1.0, -0.4, -0.15, -0.05, -0.01, 0.0, 0.01, 0.05, 0.15, 0.4, 1.0)
DAMPERS = {
    "configuration 1": configuration(1),
    "configuration 6": configuration(6),
    "configuration 9": configuration(9),
    "C over AA, 14 clicks, 0 psi": shim_build("C/AA", clicks=14, gas_pressure=0.0),
    "F over B, 400 psi": shim_build("F/B", clicks=28, gas_pressure=400.0 * PSI),
    "valving": Valving("C", "E", head="A", clicks=12, jet=0.5e-6, dish=0.1e-3).damper(),
}


@pytest.mark.parametrize("name", DAMPERS)
def test_a_damper(name: str, unchanged: Callable[..., None]) -> None:
    damper: PhysicalDamper = DAMPERS[name]
    run = damper.respond(random_multisine(1, duration=0.5).series, rate=1000.0)
    unchanged({
        "damper": rounded(repr(damper)),
        "numbers": np.array(damper.row.numbers),
        "start": damper.row.start,
        "static": np.array([damper.static_force(v) for v in SPEEDS]),
        "pressures": np.array([damper.steady_pressures(v) for v in SPEEDS]),
        "damping": damper.nominal_damping(),
        "travel": damper.cylinder.travel,
        "run": dict(zip(run.names, run.values, strict=True)),
        "cavitation": cavitation(run),
    })  # fmt: skip


def test_the_stacks_of_shims(unchanged: Callable[..., None]) -> None:
    stacks = {code: ShimStack(code) for code in SHIM_SETS}
    unchanged({code: np.array([stack.stiffness, stack.lift]) for code, stack in stacks.items()})


@pytest.mark.parametrize("build", "ABC")
def test_a_demonstration_damper(build: str, unchanged: Callable[..., None]) -> None:
    damper = demo_damper(build)
    run = damper.respond(random_multisine(1, duration=0.5).series, rate=1000.0)
    static = np.array([damper.static_force(v) for v in SPEEDS])
    unchanged({"damper": rounded(repr(damper)), "static": static, "run": dict(zip(run.names, run.values, strict=True))})


def test_the_valvings_that_come_closest(monkeypatch: pytest.MonkeyPatch, unchanged: Callable[..., None]) -> None:
    monkeypatch.setattr("eightpost.virtual.damper._CODES", ("B", "C", "E"))
    monkeypatch.setattr("eightpost.virtual.damper.JETS", (0.3e-6, 0.8e-6))
    monkeypatch.setattr("eightpost.virtual.damper.DISHES", (0.0, 0.2e-3))
    digressive = nearest_valving(lambda v: float(1500.0 * np.tanh(v / 0.2) + 800.0 * v + 30.0))
    straight = nearest_valving(lambda v: 4000.0 * v if v > 0.0 else 9000.0 * v)
    unchanged({"digressive": digressive, "straight": straight})
