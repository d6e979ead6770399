"""The probe of the first outputs finds jumps in the first step, and knows internal steps and inputs that jump."""

import math
from types import SimpleNamespace

import pytest

from builder.check.probes import simulation
from builder.check.probes.bench import CallError, Skip

START = 1.0


def jump(start, h):
    return 2.0 + h if h > 0.0 else 1.0


def jump_to_rest(start, h):
    return 2.0 if h > 0.0 else 1.0


def moving(start, h):
    return 1.0 + h


def internal_steps(start, h):
    """A change within the first internal step of 5 ms, which a tiny step already shows."""
    return 1.0 + math.ceil(h / 0.005)


def jump_at_the_start_time(start, h):
    return 2.0 + h if h > 0.0 and start == START else 1.0


def jump_where_it_can_start(start, h):
    if start != START:
        raise CallError("this time is refused")
    return jump(start, h)


def probed(monkeypatch, output, can=True, variability="continuous"):
    """Return what the probe finds for an FMU of one output without inputs."""
    monkeypatch.setattr(simulation, "_outputs", lambda _bench, _inputs, start, h: [output(start, h)])
    y = SimpleNamespace(name="y", variability=variability, number=lambda _: None)
    bench = SimpleNamespace(
        description=SimpleNamespace(can=lambda _: can),
        outputs=[y],
        inputs=[],
        held=lambda _: [],
        timing=SimpleNamespace(start=START, step=0.01),
    )
    return [one for one in simulation.probe_first_outputs(bench) if isinstance(one, Skip) or one[1]]


@pytest.mark.parametrize("output", [jump, jump_to_rest, jump_where_it_can_start])
def test_an_output_that_jumps_in_a_tiny_step_is_found(monkeypatch, output):
    jumps = [("first-outputs", "y is 1 before the first step, 2 1e-07 s later")]
    assert probed(monkeypatch, output) == 2 * jumps


@pytest.mark.parametrize("output", [moving, internal_steps, jump_at_the_start_time])
def test_motion_internal_steps_and_a_jump_at_the_start_time_alone_are_no_defects(monkeypatch, output):
    assert probed(monkeypatch, output) == []


def test_a_discrete_output_may_jump(monkeypatch):
    assert probed(monkeypatch, jump, variability="discrete") == []


def test_an_fmu_of_fixed_steps_is_not_probed(monkeypatch):
    assert [type(one) for one in probed(monkeypatch, jump, can=False)] == [Skip]
