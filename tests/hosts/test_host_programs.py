"""The programs of examples/hosts have the errors that docs/how_to/hosts.md states, and agree with each other."""

import math
from pathlib import Path

import numpy as np
import pytest

from eightpost.compilers import find_compiler
from eightpost.errors import FmuError

HOSTS = Path(__file__).parents[2] / "examples" / "hosts"
SECONDS = 1.0


@pytest.fixture(scope="module")
def run(program, motion_of):
    """Run a loop of a host program by its name: run("python_host", "C", 2e-3) returns its motion."""

    def once(name, loop, step):
        if name in ("c_host", "chrono_host"):
            try:
                find_compiler()
            except FmuError:
                pytest.skip("there is no C compiler here")
        if name == "libcosim_host":
            pytest.importorskip("libcosimpy", reason="libcosimpy has no wheel for this platform")
        return motion_of(program(name), loop, step)

    return once


@pytest.fixture(scope="module")
def error(program, run):
    """Error of the shock velocity and the tire force at a step [%]."""
    return lambda *case: program("reference").errors(run(*case), SECONDS)


@pytest.mark.nightly
def test_the_reference_is_the_monolithic_solution_of_the_tests(program, monolithic):
    reference = program("reference")
    law, found = reference.read_shock(reference.SHOCK).law, reference.reference(SECONDS)
    shock = monolithic.Shock(
        np.vectorize(law.static_force, otypes=[float]), np.vectorize(law.lag_weight, otypes=[float]), law.time_constant
    )
    drive = reference.Drivefile.read(reference.TRACK).series.window(0.0, SECONDS)
    rows = np.array([reference.track()(t) for t in drive.time.tolist()]).T
    exact = monolithic.coupled_run(reference.car().parameters, shock, drive.time, rows[:4], rows[4:], at=found.time)
    for ours, true in ((found.velocity, exact.shock_velocity), (found.tire_force, exact.tire_force)):
        assert np.abs(ours - true).max() < 2e-5 * true.std()


@pytest.mark.repeated
@pytest.mark.parametrize(("loop", "step", "velocity", "tire_force"), [
    ("A", 2e-3, 2.6, 1.7), ("A", 1e-3, 1.1, 0.7), ("B", 2e-3, 1.2, 0.7), ("B", 1e-3, 0.3, 0.17), ("C", 4e-3, 0.8, 0.4),
    ("C", 2e-3, 0.16, 0.08), ("C", 1e-3, 0.05, 0.03),
])  # fmt: skip
def test_the_loops_have_the_stated_errors(error, loop, step, velocity, tire_force):
    found = error("python_host", loop, step)
    assert 0.3 * velocity < found[0] < velocity
    assert 0.3 * tire_force < found[1] < tire_force


@pytest.mark.parametrize(("loop", "low", "high"), [("A", 1.0, 1.6), ("B", 1.8, 2.2)])
def test_loop_a_is_about_first_order_and_loop_b_second(error, loop, low, high):
    coarse, fine = (error("python_host", loop, step)[0] for step in (2e-3, 1e-3))
    assert low < math.log2(coarse / fine) < high


@pytest.mark.nightly
@pytest.mark.parametrize("loop", ["A", "B", "C"])
@pytest.mark.parametrize("name", ["c_host", "fmpy_host"])
def test_programs_with_the_same_integrator_have_the_same_motion(run, name, loop):
    ours, other = run("python_host", loop, 2e-3), run(name, loop, 2e-3)
    np.testing.assert_allclose(other.velocity, ours.velocity, atol=1e-9)
    np.testing.assert_allclose(other.tire_force, ours.tire_force, atol=1e-4)


@pytest.mark.nightly
def test_an_implicit_host_keeps_its_second_order(error):
    coarse, fine = (error("chrono_host", "C", step)[0] for step in (2e-3, 1e-3))
    assert 1.8 < math.log2(coarse / fine) < 2.3
    assert fine < 0.25


@pytest.mark.repeated
@pytest.mark.parametrize("name", ["libcosim_host", "fmpy_host"])
def test_hosts_that_step_in_parallel_have_errors_of_several_percent_at_1_ms(error, name):
    assert 3.0 < max(error(name, "J", 1e-3)) < 9.0


def test_an_error_needs_points_of_the_grid_and_a_diverged_run_has_an_infinite_one(program):
    reference = program("reference")
    exact = reference.reference(SECONDS)
    assert reference.errors(exact, SECONDS) == (0.0, 0.0)
    off = reference.Motion(exact.time + 0.4e-3, exact.velocity, exact.tire_force)
    with pytest.raises(ValueError, match="only 0 points of the run are multiples"):
        reference.errors(off, SECONDS)
    with np.errstate(all="ignore"):
        wild = reference.Motion(exact.time, np.full_like(exact.velocity, np.nan), exact.tire_force)
        assert reference.errors(wild, SECONDS) == (math.inf, math.inf)


def test_an_error_is_that_of_the_worst_corner(program):
    reference = program("reference")
    exact = reference.reference(SECONDS)
    settled = exact.time >= 0.5 * SECONDS
    shifted = exact.velocity.copy()
    shifted[2] += 0.01 * exact.velocity[2, settled].std()
    shifted[1] += 0.002 * exact.velocity[1, settled].std()
    found = reference.errors(reference.Motion(exact.time, shifted, exact.tire_force), SECONDS)
    assert found == (pytest.approx(1.0), 0.0)


@pytest.mark.parametrize("path", sorted(HOSTS.glob("*_host.py")), ids=lambda path: path.stem)
def test_every_program_says_what_it_is_how_to_run_it_and_prints_the_table(path):
    text = path.read_text(encoding="utf-8")
    assert text.startswith('"""') and f"python examples/hosts/{path.name}" in text.split('"""')[1]
    assert "reference.main(" in text and len(text.splitlines()) < 200
