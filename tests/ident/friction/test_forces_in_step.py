"""Shock forces and hub accelerometers that a logger or rubber delays, laws of shocks and balances of wheels."""

import numpy as np
import pytest

from eightpost import identify
from eightpost.errors import InputError
from eightpost.ident import simulate
from eightpost.ident.preparation import Prepared
from eightpost.ident.vehicle.plan import forces_in_step, hubs_in_step, plan_identification
from eightpost.rig import RigTest
from eightpost.shock import Lpf1, Port, Shock, StaticCurve, write_shock
from eightpost.signals import TimeSeries

RATE, FINER, SECONDS = 125.0, 16, 8.0
FINE = np.arange(round(SECONDS * RATE * FINER)) / (RATE * FINER)
KNOTS = np.concatenate([-np.geomspace(2.0, 0.01, 12), [0.0], np.geomspace(0.01, 2.0, 12)])


def shock(name, size, port=None):
    """Return a digressive shock with a lag of 1.2 ms."""
    forces, slopes = size * np.tanh(KNOTS / 0.1), size / 0.1 / np.cosh(KNOTS / 0.1) ** 2
    curve = StaticCurve.through_knots(*(tuple(values.tolist()) for values in (KNOTS, forces, slopes)))
    return Shock(name, Lpf1(curve, 1.2e-3, **({} if port is None else {"port": port})))


HARD, SOFT = shock("hard", 300.0), shock("soft", 160.0)


def test_of(shocks, delays, seed):
    """Return a record at 125 Hz of ports with shocks whose forces are delayed [s]; its period is its length."""
    generator, channels = np.random.default_rng(seed), {}
    f = np.fft.rfftfreq(FINE.size, 1.0 / (RATE * FINER))
    for port, law, delay in zip(("lf", "rf"), shocks, delays, strict=True):
        lines = np.where((f > 0.5) & (f < 22.0), np.exp(2j * np.pi * generator.random(f.size)), 0.0)
        v = np.fft.irfft(lines, FINE.size)
        lines *= 0.12 / v.std()
        x = np.fft.irfft(lines / np.where(f > 0.0, 2j * np.pi * f, np.inf), FINE.size)
        motion = {"velocity": ("m/s", np.fft.irfft(lines, FINE.size)), "displacement": ("m", x)}
        # Twice, so that the lag is in its steady state in the second half.
        twice = {name: (unit, np.tile(values, 2)) for name, (unit, values) in motion.items()}
        time = np.arange(2 * FINE.size) / (RATE * FINER)
        force = simulate(law.law, TimeSeries.from_channels(time, twice))[FINE.size :]
        late = np.fft.irfft(np.fft.rfft(force) * (f < 50.0) * np.exp(-2j * np.pi * f * delay), FINE.size)
        for name, (unit, values) in (motion | {"force": ("N", late)}).items():
            channels[f"{port}.{name}"] = (unit, values[::FINER] - values[::FINER].mean())
    return TimeSeries.from_channels(FINE[::FINER], channels)


test_of.__test__ = False  # it makes a record


def prepared(*records, corners=("lf", "rf")):
    names = tuple(f"test {k}" for k in range(len(records)))
    return Prepared(records, ({},) * len(records), names, corners, ((),) * len(records), (), (), {})


def assert_in_step(found, expected, port):
    inner = slice(20, -20)  # the ends are not periodic any more
    force, right = (record[f"{port}.force"][inner] for record in (found, expected))
    assert np.std(force - right) < 0.01 * np.std(right)


def test_each_port_is_advanced_by_its_own_delay():
    late, right = (test_of((HARD, SOFT), delays, 1) for delays in ((1.7e-3, -0.6e-3), (0.0, 0.0)))
    found, note = forces_in_step(prepared(late), [SOFT, HARD], 0)
    assert_in_step(found.records[0], right, "lf")
    assert_in_step(found.records[0], right, "rf")
    assert note == "Shock forces were advanced to be in step with laws: lf 1.70 ms (hard), rf -0.60 ms (soft)."


@pytest.mark.parametrize("seconds", [6e-3, -6e-3])
def test_a_long_delay_is_found(seconds):
    _, note = forces_in_step(prepared(test_of((HARD, SOFT), (seconds, 0.0), 10)), [HARD, SOFT], 0)
    assert f"lf {1e3 * seconds:.2f} ms (hard), " in note


def test_forces_in_step_remain():
    right = test_of((HARD, SOFT), (0.0, 0.0), 2)
    found, _ = forces_in_step(prepared(right), [SOFT, HARD], 0)
    np.testing.assert_allclose(found.records[0]["lf.force"], right["lf.force"], atol=2.0)
    np.testing.assert_array_equal(found.records[0]["lf.velocity"], right["lf.velocity"])


def test_a_gas_spring_is_no_delay():
    stiff = shock("stiff", 300.0, Port(motion_ratio=0.9, gas_stiffness=20e3))
    _, note = forces_in_step(prepared(test_of((stiff, stiff), (0.5e-3, 1.5e-3), 3)), [stiff], 0)
    assert note.endswith("lf 0.50 ms (stiff), rf 1.50 ms (stiff).")


def test_a_test_with_another_shock_has_the_delay_by_its_own_law_or_else_that_of_the_baseline():
    tests = prepared(test_of((SOFT, HARD), (0.8e-3, 1.5e-3), 4), test_of((HARD, HARD), (1.5e-3, 1.5e-3), 5))
    right = test_of((SOFT, HARD), (0.0, 0.0), 4)
    all_known, _ = forces_in_step(tests, [HARD, SOFT], 1)
    assert_in_step(all_known.records[0], right, "lf")
    baseline_known, _ = forces_in_step(tests, [HARD], 1)
    early = test_of((SOFT, HARD), (-0.7e-3, 0.0), 4)
    assert_in_step(baseline_known.records[0], early, "lf")
    assert_in_step(baseline_known.records[0], right, "rf")


def test_a_baseline_with_other_shocks_is_refused():
    tests = prepared(test_of((SOFT, HARD), (0.0, 0.0), 6))
    with pytest.raises(InputError, match=r"test 0: no given shock has the force of rf\.force; the nearest one, soft, "
                       r"leaves 4\d % of it, more than 20 %"):  # fmt: skip
        forces_in_step(tests, [SOFT], 0)


def quarter(damper, delay, seed):
    """Return a test of a quarter car, of which only the shock is simulated."""
    both = test_of((damper, damper), (delay, delay), seed)
    names = ("force", "velocity", "displacement")
    channels = {name: (both.unit(f"lf.{name}"), both[f"lf.{name}"]) for name in names}
    return TimeSeries.from_channels(both.time, channels | {"road": ("m", both["rf.displacement"]),
                                                           "tire_force": ("N", both["rf.force"])})  # fmt: skip


def test_the_plan_of_an_identification_has_forces_and_damping_in_step():
    late, right = ([quarter(HARD, delay, 7), quarter(SOFT, delay, 8)] for delay in (3e-3, 0.0))
    expected = plan_identification(prepared(*right, corners=("",)))
    plan = plan_identification(prepared(*late, corners=("",)), shocks=[HARD, SOFT])
    assert plan.notes == ("Shock forces were advanced to be in step with laws: 3.00 ms (hard).",)
    assert plan.experiment.baseline_damping == pytest.approx(expected.experiment.baseline_damping, rel=1e-3)
    without = plan_identification(prepared(*late, corners=("",)))
    assert without.notes == ()
    assert without.experiment.baseline_damping[""] < 0.97 * expected.experiment.baseline_damping[""]


def wheels(*delays, seed=20):
    """Return a record of wheels in balance, whose hub accelerometers are late [s]."""
    record = test_of((HARD, HARD), (0.0, 0.0), seed)
    f = np.fft.rfftfreq(len(record), 1.0 / RATE)
    for k, (corner, delay) in enumerate(zip(("lf", "rf"), delays, strict=True)):
        a = 60.0 * test_of((HARD, HARD), (0.0, 0.0), seed + 1 + k)["lf.velocity"]
        late = np.fft.irfft(np.fft.rfft(a) * np.exp(-2j * np.pi * f * delay), a.size)
        force, x, v = (record[f"{corner}.{name}"] for name in ("force", "displacement", "velocity"))
        record = record.with_channel(f"{corner}.hub_acceleration", "m/s2", late)
        record = record.with_channel(f"{corner}.tire_force", "N", 45.0 * a + 0.9 * force + 7e4 * x - 300.0 * v)
    return record


@pytest.mark.parametrize("delay", [0.6e-3, -0.4e-3])
def test_late_hub_accelerometers_are_brought_in_step_with_the_balance_of_the_wheels(delay):
    found, note = hubs_in_step(prepared(wheels(delay, delay)))
    inner, right = slice(20, -20), wheels(0.0, 0.0)
    for name in ("lf.hub_acceleration", "rf.hub_acceleration"):
        assert np.std((found.records[0][name] - right[name])[inner]) < 0.01 * np.std(right[name])
    np.testing.assert_array_equal(found.records[0]["lf.tire_force"], right["lf.tire_force"])
    advanced = f"Hub accelerometers were advanced by {1e3 * delay:.2f} ms"
    assert note == f"{advanced} to be in step with the balance of the wheels."


def test_one_delay_of_all_hub_accelerometers_is_the_median():
    _, note = hubs_in_step(prepared(wheels(0.5e-3, 0.5e-3), wheels(0.5e-3, 3e-3)))
    assert "advanced by 0.50 ms" in note


def test_hub_accelerometers_whose_wheels_are_not_in_balance_remain():
    out = wheels(1e-3, 1e-3).with_channel("rf.tire_force", "N", wheels(0.0, 0.0, seed=30)["rf.tire_force"])
    for record in (out.with_channel("lf.tire_force", "N", out["rf.tire_force"]), test_of((HARD, SOFT), (0.0, 0.0), 3)):
        given = prepared(record)
        assert hubs_in_step(given) == (given, "")
    _, note = hubs_in_step(prepared(out))
    assert "advanced by 1.00 ms" in note  # by the other wheel


def test_identify_compares_the_tests_with_shocks_and_with_their_files(tmp_path):
    tests, other = [RigTest(quarter(damper, 0.0, 9)) for damper in (HARD, SOFT)], shock("other", 900.0)
    write_shock(other, tmp_path / "other.json")
    for given in (other, tmp_path / "other.json"):
        with pytest.raises(InputError, match=r"no given shock has the force of force; the nearest one, other, "):
            identify(tests, shocks=[given])
