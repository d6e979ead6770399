"""A simulated record equals the scalar law stepped through it, for every law and any port."""

import subprocess
import sys
from importlib.util import module_from_spec, spec_from_file_location

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from eightpost.errors import MissingChannelError
from eightpost.ident import simulate
from eightpost.shock import Lpf1, Lpnl2, Polylinear, Port, records
from eightpost.shock.compiled import _number_of
from eightpost.shock.records import law_numbers, record_loop, stepped_force
from eightpost.signals import TimeSeries

PORT = Port(1.2, 0.9, 1.1, 700.0, 200.0, 15.0, 0.004)
LAWS = {
    "polylinear": lambda curve, port: Polylinear(curve, port=port),
    "lpf1": lambda curve, port: Lpf1(curve, 1.3e-3, port=port),
    "lpnl2": lambda curve, port: Lpnl2(curve, 1.3e-3, 300.0, 1500.0, port=port),
}
velocities = arrays(np.float64, 30, elements=st.floats(-2.5, 2.5, allow_subnormal=False))


def stepped(law, series):
    """Return the force by stepping the scalar law with `follow` and `response`, as the FMU does."""
    velocity, displacement = series["velocity"].tolist(), series["displacement"].tolist()
    steps = [series.duration / (len(series) - 1)] * (len(series) - 1) if series.is_uniform else np.diff(series.time)
    lagged = law.static_force(velocity[0])
    forces = [law.response(lagged, velocity[0], displacement[0]).force]
    for n, step in enumerate(steps, start=1):
        lagged = law.follow(lagged, velocity[n - 1], velocity[n], float(step))
        forces.append(law.response(lagged, velocity[n], displacement[n]).force)
    return np.array(forces)


def record(velocity, time):
    return TimeSeries.from_channels(time, {"velocity": ("m/s", velocity), "displacement": ("m", 0.01 * velocity)})


@pytest.mark.nightly
@pytest.mark.parametrize("name", LAWS)
@given(velocity=velocities)
def test_an_even_record(curve, name, velocity):
    law, series = LAWS[name](curve, PORT), record(velocity, np.arange(30) / 2000.0)
    np.testing.assert_allclose(simulate(law, series), stepped(law, series), rtol=1e-12, atol=1e-8)


@pytest.mark.parametrize("name", LAWS)
def test_an_uneven_record(curve, name):
    generator = np.random.default_rng(3)
    law = LAWS[name](curve, PORT)
    series = record(generator.normal(size=60), np.cumsum(generator.uniform(2e-4, 2e-3, 60)))
    assert not series.is_uniform
    np.testing.assert_allclose(simulate(law, series), stepped(law, series), rtol=1e-12, atol=1e-9)


def test_without_displacement_the_gas_spring_rests_at_its_reference(curve):
    series = record(np.zeros(5), np.arange(5) / 100.0).select(["velocity"])
    np.testing.assert_allclose(
        simulate(Polylinear(curve, port=Port(gas_preload=50.0, gas_stiffness=9e3)), series), 50.0
    )


def test_without_velocity_it_says_so(curve):
    with pytest.raises(MissingChannelError, match="velocity"):
        simulate(Polylinear(curve), record(np.zeros(5), np.arange(5.0)).select(["displacement"]))


OWN = (1.3e-3, 400.0, 900.0)


@pytest.fixture
def driven_law(curve):
    velocity = np.sin(np.linspace(0.0, 30.0, 400))
    return Lpnl2(curve, *OWN), velocity, np.full(399, 1e-3)


def test_the_compiled_law_is_the_scalar_law(driven_law):
    law, velocity, step = driven_law
    found = stepped_force(Lpnl2, law.valve._replace(curve=law.curve.numbers()), OWN, velocity, step)
    lagged = [law.static_force(velocity[0])]
    for start, end, h in zip(velocity[:-1], velocity[1:], step, strict=True):
        lagged.append(law.advance(lagged[-1], start, end, h))
    expected = [law.response(f, v, 0.0).force for f, v in zip(lagged, velocity, strict=True)]
    np.testing.assert_allclose(found, expected, rtol=1e-11, atol=1e-8)


def test_the_machine_code_is_found_on_disk_the_second_time(driven_law, monkeypatch):
    law, velocity, step = driven_law
    valve = law.valve._replace(curve=law.curve.numbers())
    first, force = stepped_force(Lpnl2, valve, OWN, velocity, step), np.empty(velocity.size)
    monkeypatch.setattr(records, "compiled_by", None)
    record_loop.__wrapped__()(law_numbers([law]), velocity, step, np.empty((velocity.size, 2)), force)
    assert force.tolist() == first.tolist()


def test_samples_that_are_not_contiguous_are_stepped_alike(driven_law):
    law, velocity, step = driven_law
    valve, apart = law.valve._replace(curve=law.curve.numbers()), np.repeat(velocity, 2)[::2]
    found = stepped_force(Lpnl2, valve, OWN, apart, np.repeat(step, 2)[::2])
    assert found.tolist() == stepped_force(Lpnl2, valve, OWN, velocity, step).tolist()


@pytest.mark.nightly
def test_a_fit_steps_a_law_without_importing_numba():
    steps = "records.stepped_states(Hysteresis, law.valve._replace(curve=law.curve.numbers()), law.own, u, u[1:])"
    program = f"""
import sys
import numpy as np
from eightpost.shock import Hysteresis, StaticCurve, records
zero = (0.0,) * 25
curve = StaticCurve.through_knots(tuple(range(-12, 13)), zero, zero)
law, u = Hysteresis(curve, zero, (0.1, 0.1, 0.1)), np.ones(3)
assert {steps}[:, 0].tolist() == [1.0] * 3
assert "numba" not in sys.modules and "llvmlite" in sys.modules
"""
    subprocess.run([sys.executable, "-c", program], check=True)


def test_the_cache_key_changes_when_a_file_changes(tmp_path):
    path = tmp_path / "law.py"
    numbers = []
    for factor in (1, 2):
        path.write_text(f"def core(x):\n    return {factor} * x\n")
        module = module_from_spec(spec_from_file_location("law", path))
        module.__spec__.loader.exec_module(module)
        numbers.append(_number_of({module.core}))
    assert numbers[0] != numbers[1]
    assert min(numbers) > 0
