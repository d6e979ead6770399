"""Communication points and step sizes that FMUs of others accept, and the source of a value that is not a number."""

import numpy as np
import pytest

from cosim import Adaptive, Connection, FmuComponent, GaussSeidel, Implicit, Jacobi, Scenario, System, run
from cosim.session.setup import coupling_times, summed_steps
from eightpost.errors import StepError, WiringError
from eightpost.signals import Drivefile, TimeSeries
from eightpost.verdict import Grade

from . import lag_fmus

PLAIN = {"compared": False, "engine": "python"}
EXPERIMENT = '<DefaultExperiment stepSize="0.004"/>'


@pytest.fixture
def loop(build, tmp_path):
    """Return a function that couples two FMUs, each with the output of the other as its input."""

    def make(*definitions, version=2, **declared):
        path = tmp_path / "lag.fmu"
        if version == 2:
            lag_fmus.write_two(path, build("-DFMI=2", *definitions), **declared)
        else:
            lag_fmus.write_three(path, build(*definitions), **declared)
        others = {f"{name}.{v}": 0.0 for name in "ab" for v in ("w[1]", "w[2]", "f")} if version == 3 else {}
        return System(
            {name: FmuComponent(path, name) for name in "ab"},
            connections=(Connection("a.x", "b.u"), Connection("b.x", "a.u", -1.0)),
            constants=others,
            parameters={"a": {}, "b": {}},
        )

    return make


@pytest.mark.parametrize(
    ("algorithm", "version"),
    [(Jacobi(), 2), (GaussSeidel(), 3), (Implicit(), 2), (Adaptive(relative=1e-5), 2), (Adaptive(relative=1e-5), 3)],
)
def test_a_communication_point_is_the_sum_of_the_steps_to_the_bit_also_after_a_rollback(loop, algorithm, version):
    result = run(loop("-DSTRICT", version=version), Scenario(0.35), algorithm=algorithm, step=0.003, **PLAIN)
    assert result.series.time[-1] == 0.35


def test_the_sum_of_the_steps_includes_the_points_of_the_drive(build, tmp_path):
    part = FmuComponent(lag_fmus.write_two(tmp_path / "lag.fmu", build("-DFMI=2", "-DSTRICT")), "lag")
    times = np.linspace(0.0, 0.4, 334)
    drive = Drivefile(TimeSeries.from_channels(times, {"u": ("m/s", np.sin(9.0 * times))}))
    result = run(System({"lag": part}), Scenario(0.4, drive), algorithm=GaussSeidel(), step=0.007, **PLAIN)
    assert result.steps == 58


@pytest.mark.parametrize(("stop", "step"), [(10.0, 1e-3), (0.35, 0.003), (1.0, 1.0), (100.0, 1.1e-3), (0.5, 0.3)])
def test_summed_steps_stay_with_the_multiples_of_the_step(stop, step):
    times = coupling_times(stop, step)
    points, steps = summed_steps(times, step)
    np.testing.assert_array_equal(points[:-1] + steps, points[1:])
    assert points[-1] == stop
    assert np.abs(points - times).max() < 1e-14 * 32 * stop
    others = np.flatnonzero(steps != step) + 1
    assert set(others) <= {*range(32, times.size, 32), times.size - 1}


def test_an_fmu_for_one_step_size_is_stepped_by_the_size_that_it_states_and_its_error_is_unknown(loop):
    result = run(loop("-DONLY=0.004", any_step=False, experiment=EXPERIMENT), Scenario(0.4), engine="python")
    assert (result.step, result.coupling_error) == (0.004, None)
    assert result.verdict.about("coupling").grade is Grade.UNKNOWN
    assert any("a, b: steps of 0.004 s only (stepSize)" in note for note in result.notes)


def test_without_a_stated_size_comparisons_that_the_fmu_refuses_leave_the_error_unknown(loop):
    system = loop("-DONLY=0.004", any_step=False)
    result = run(system, Scenario(0.4), algorithm=GaussSeidel(), step=0.004, engine="python")
    assert (result.step, result.coupling_error) == (0.004, None)
    with pytest.raises(StepError, match=r"accepts steps of one size only: give the size that its maker names"):
        run(system, Scenario(0.4), engine="python")


def test_a_refused_comparison_of_an_fmu_for_any_step_is_an_error(loop):
    with pytest.raises(StepError, match="failed to step at 0 s"):
        run(loop("-DONLY=0.004"), Scenario(0.4), algorithm=GaussSeidel(), step=0.004, engine="python")


def test_components_that_state_different_step_sizes_cannot_be_coupled_without_a_step(loop, build, tmp_path):
    one = loop("-DONLY=0.004", any_step=False, experiment=EXPERIMENT)
    other = lag_fmus.write_two(
        tmp_path / "other.fmu", build("-DFMI=2"), any_step=False, experiment=EXPERIMENT.replace("4", "5")
    )
    system = System({**one.components, "b": FmuComponent(other, "b")}, connections=one.connections)
    with pytest.raises(WiringError, match=r"a of 0\.004 s and b of 0\.005 s only"):
        run(system, Scenario(0.4), engine="python")


@pytest.mark.parametrize("algorithm", [Jacobi(), GaussSeidel()], ids=lambda a: a.name)
def test_a_value_that_is_not_a_number_is_reported_with_the_component_and_output_where_it_arose(loop, fmus, algorithm):
    """The receiver, a shock of ours, refuses it."""
    lag = loop("-DNAN_FROM=0.1005").components["b"]
    system = System(
        {"shock": FmuComponent(fmus["lpf1"], "shock"), "lag": lag},
        connections=(Connection("lag.x", "shock.velocity"),),
        constants={"lag.u": 1.0, "shock.displacement": 0.0},
    )
    with pytest.raises(StepError, match=r"'lag' \(lag\.fmu\): its output x is not a number after the step from 0\.1 s"):
        run(system, Scenario(0.4), algorithm=algorithm, step=0.001, **PLAIN)
