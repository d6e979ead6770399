"""A force law gives the forces of the FMU stepped with the same ramps, at any trial point and without side effects."""

import math
from functools import partial

import numpy as np
import pytest
from hypothesis import HealthCheck, assume, example, given, settings
from hypothesis import strategies as st

from cosim import ExtrapolatedForce, FmuComponent, ForceLaw, HeldForce
from eightpost.errors import InputError
from eightpost.shock import LAWS
from tests.unchanged import refusals

PORT = ("velocity", "displacement")
CORNERS = ("lf", "rf", "lr", "rr")

#: Velocities within the inner polynomial of the test curve, where the laws are smooth [m/s]; travel [m]; step [s].
POINTS = st.tuples(st.floats(-0.3, 0.3), st.floats(-0.02, 0.02))
STEPS = st.floats(1e-4, 8e-3)


def stepped(fmu, points, times):
    """Forces of the FMU as a plain co-simulation component: ramps from point to point."""
    component = FmuComponent(fmu, "plain")
    component.begin(0.0, math.inf, {})
    component.set(PORT, points[0])
    component.end_initialization()
    forces = component.get(("force",))
    for k in range(1, len(points)):
        h = times[k] - times[k - 1]
        component.set(PORT, points[k - 1])
        component.set_derivatives(PORT, [(b - a) / h for a, b in zip(points[k - 1], points[k], strict=True)])
        component.step(times[k - 1], h)
        forces += component.get(("force",))
    component.close()
    return forces


@pytest.fixture(scope="module")
def laws(fmus):
    """One open force law for each kind of shock."""
    opened = {name: ForceLaw(fmus[name]) for name in LAWS}
    yield opened
    for law in opened.values():
        law.close()


@pytest.mark.nightly
@pytest.mark.parametrize("name", LAWS)
@settings(max_examples=15, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(points=st.lists(POINTS, min_size=2, max_size=6), h=STEPS)
def test_accepted_points_have_the_forces_of_a_plain_run_with_the_same_ramps_to_the_bit(fmus, laws, name, points, h):
    times = [h * k for k in range(len(points))]
    law = laws[name]
    found = [law.start(0.0, *points[0])]
    found += [law.accept(t, *point) for t, point in zip(times[1:], points[1:], strict=True)]
    assert found == stepped(fmus[name], points, times)


@pytest.mark.repeated(2)
@pytest.mark.parametrize("name", LAWS)
@settings(max_examples=15)
@given(data=st.data(), h=STEPS)
def test_trial_points_in_any_order_leave_no_trace_and_have_the_force_of_the_accepted_point(laws, name, data, h):
    law, points = laws[name], data.draw(st.lists(POINTS, min_size=3, max_size=4))
    law.start(0.0, *points[0])
    plain = [law.accept(k * h, *point) for k, point in enumerate(points) if k]
    law.start(0.0, *points[0])
    disturbed = []
    for k, point in enumerate(points[1:], 1):
        trials = data.draw(st.lists(st.tuples(st.floats(0.0, 3.0), POINTS, st.booleans()), max_size=4))
        for ahead, trial, derivative in trials:
            (law.jacobian if derivative else law.force)((k - 1) * h + ahead * h, *trial)
        tried = law.force(k * h, *point)
        disturbed.append(law.accept(k * h, *point))
        assert disturbed[-1] == tried and law.time == k * h
    assert disturbed == plain


def test_the_force_at_the_accepted_time_follows_a_jump_of_velocity_with_the_lag_unchanged(laws, shocks):
    law, model = laws["lpnl2"], shocks["lpnl2"].law
    law.start(0.0, 0.1, 0.005)
    law.accept(2e-3, 0.105, 0.005)
    lagged = model.static_force(0.1)
    lagged = model.advance_lag(lagged, model.static_force(0.1), model.static_force(0.105), 2e-3)
    for velocity in (0.105, 0.0, -0.15, 0.35):
        static = model.static_force(velocity)
        weight = model.lag_weight(static)
        port = model.port
        expected = weight * lagged + (1.0 - weight) * static + port.gas_preload + port.gas_stiffness * 0.005
        expected += port.seal_friction * math.tanh(velocity / port.friction_velocity)
        assert law.force(2e-3, velocity, 0.005) == pytest.approx(expected, abs=2e-3)
        assert law.force(2e-3 + 2e-9, velocity, 0.005) == pytest.approx(law.force(2e-3, velocity, 0.005), abs=0.01)


def test_a_jump_at_the_accepted_time_can_be_accepted(laws):
    law = laws["lpnl2"]
    law.start(0.0, 0.1)
    assert law.force(1e-9, -0.2) == law.force(0.0, -0.2)  # a shorter ramp counts as a jump
    jumped = law.accept(0.0, -0.2)
    assert jumped == law.force(0.0, -0.2)
    assert law.time == 0.0
    after = law.force(1e-3, -0.2)
    law.start(0.0, 0.1)
    assert law.force(1e-3, -0.2) != after  # the ramp from 0.1 m/s, not from the jump


def slopes_beside(force, point, k, distance):
    """Difference quotients on both sides of a point, which may be a kink."""
    quotients = []
    for side in (-distance, distance):
        near, far = list(point), list(point)
        near[k] += 0.8 * side
        far[k] += 1.2 * side
        quotients.append((force(*far) - force(*near)) / (far[k] - near[k]))
    return np.array(quotients)


@pytest.mark.repeated(2)
@pytest.mark.parametrize("name", LAWS)
@given(first=POINTS, second=POINTS, h=st.one_of(st.just(0.0), STEPS))
@example(first=(1e-8, 0.0), second=(0.0, 0.0), h=0.0078125)  # a kink of the slope, where the time constant has its own
@settings(max_examples=25)
def test_the_jacobian_is_the_derivative_of_the_force(laws, name, first, second, h):
    pieces = abs(second[0] - first[0]) / 0.01  # of a step of a law; one more is a tiny jump
    assume(round(pieces) == 0 or abs(pieces - round(pieces)) > 1e-3)
    law = laws[name]
    law.start(0.0, *first)
    found = law.jacobian(h, *second)
    for k in range(2):
        sides, farther = (slopes_beside(partial(law.force, h), second, k, distance) for distance in (2.5e-6, 5e-6))
        jump = abs(sides[1] - sides[0])  # more than 0.5 at a kink, where the Jacobian is that of either side
        kink = 2.0 * abs(sides.mean() - farther.mean()) + (jump if jump > 0.5 else 0.0)
        assert found[k] == pytest.approx(sides.mean(), rel=1e-6, abs=1e-3 + kink)


@pytest.mark.parametrize("name", ["lpf1", "lpnl2"])
def test_the_jacobian_is_right_where_the_step_of_a_law_has_one_more_piece(laws, name):
    """At a change of 0.25 m/s, 25 pieces of 0.01 m/s become 26."""
    law = laws[name]
    law.start(0.0, 0.0)
    before, there, after = (law.jacobian(8e-3, 0.25 + change)[0] for change in (-2e-5, 0.0, 2e-5))
    assert there == pytest.approx(0.5 * (before + after), rel=1e-3)
    plain = (law.force(8e-3, 0.25 + 1e-7) - law.force(8e-3, 0.25 - 1e-7)) / 2e-7
    assert plain != pytest.approx(there, rel=0.1)  # a plain difference is not


def test_the_jacobian_of_a_law_without_lag_is_the_directional_derivative_of_the_fmu(laws, component, shocks):
    law, plain = laws["polylinear"], component("polylinear")
    law.start(0.0, 0.1)
    plain.set(PORT, (0.17, 0.01))
    plain.end_initialization()
    known = [plain._fmu.rows.references[name] for name in PORT]
    wanted = [plain._fmu.rows.references["force"]]
    direct = [plain._slave.getDirectionalDerivative(wanted, [one], [1.0])[0] for one in known]
    assert law.jacobian(3e-3, 0.17, 0.01) == pytest.approx(direct, rel=1e-6)
    assert direct[1] == shocks["polylinear"].law.port.gas_stiffness


def test_four_corners_at_once_are_four_shocks_with_their_own_files_and_parameters(fmus):
    velocity, displacement = np.array([0.1, -0.2, 0.05, 0.3]), np.array([0.0, 0.01, -0.01, 0.002])
    files, own = [fmus[name] for name in LAWS], [{"compression_scale": 1.5}, {}, {"gas_stiffness": 0.0}, {}]
    with ForceLaw(files, corners=CORNERS, parameters=dict(zip(CORNERS, own, strict=True))) as four:
        found = [four.start(0.0, velocity, displacement), four.accept(2e-3, -velocity, displacement)]
        found.append(four.force(3e-3, 0.5 * velocity, displacement))
        slopes = four.jacobian(3e-3, 0.5 * velocity, displacement)
    for i, (file, parameters) in enumerate(zip(files, own, strict=True)):
        with ForceLaw(file, parameters=parameters) as law, ForceLaw(file) as plain:
            assert (plain.start(0.0, velocity[i], displacement[i]) != found[0][i]) == bool(parameters)
            assert law.start(0.0, velocity[i], displacement[i]) == found[0][i]
            assert law.accept(2e-3, -velocity[i], displacement[i]) == found[1][i]
            assert law.force(3e-3, 0.5 * velocity[i], displacement[i]) == found[2][i]
            assert law.jacobian(3e-3, 0.5 * velocity[i], displacement[i]) == (slopes[0][i], slopes[1][i])


def test_results_are_not_changed_by_later_evaluations(fmus):
    with ForceLaw(fmus["lpnl2"], corners=CORNERS) as four:
        first = four.start(0.0, 0.1)
        second, slopes = four.force(1e-3, 0.2), four.jacobian(1e-3, 0.2)
        kept = first.copy(), second.copy(), slopes[0].copy()
        four.force(2e-3, -0.3)
        four.jacobian(2e-3, -0.3)
        for now, before in zip((first, second, slopes[0]), kept, strict=True):
            np.testing.assert_array_equal(now, before)


def motion(t):
    """Return velocities and displacements of two corners."""
    phase = np.array([0.0, 0.9])
    return 0.4 * np.sin(60.0 * t + phase), -0.4 / 60.0 * np.cos(60.0 * t + phase)


@pytest.mark.parametrize("name", LAWS)
def test_forces_and_derivatives_of_a_law_are_unchanged(fmus, unchanged, name):
    parameters = {"lf": {"rebound_scale": 1.3, "gas_stiffness": 900.0}, "rr": {"gas_preload": 40.0}}
    forces, tried, slopes, times = [], [], [], 2e-3 * np.arange(40)
    with ForceLaw([fmus[name]] * 2, corners=("lf", "rr"), parameters=parameters) as law:
        forces.append(law.start(0.0, *motion(0.0)))
        for t in times[1:].tolist():
            tried.append(law.force(t - 1e-3, *motion(t - 6e-4)))
            slopes.append(np.stack(law.jacobian(t, *motion(t))))
            forces.append(law.accept(t, *motion(t)))
        again = law.accept(times[-1], *motion(times[-1]))
        with pytest.raises(InputError, match="before"):
            law.force(times[-2], *motion(0.0))
    unchanged({"forces": np.array(forces), "tried": np.array(tried), "again": again}, relative=1e-6)
    unchanged(np.array(slopes), "slopes", relative=1e-4)


@pytest.mark.parametrize("changed", ["time", "velocity", "displacement", "nothing"])
def test_a_point_that_was_tried_is_accepted_as_it_is_only_at_its_own_time_and_motion(fmus, changed):
    with ForceLaw(fmus["lpnl2"]) as law:
        forces = []
        for is_tried in (False, True):
            law.start(0.0, 0.05, 0.001)
            if is_tried:
                time, velocity, travel = 2e-3 * (changed != "time") + 1e-3, 0.12, 0.002
                law.force(time, velocity + 0.1 * (changed == "velocity"), travel + 0.01 * (changed == "displacement"))
            forces.append(law.accept(3e-3, 0.12, 0.002))
        assert forces[0] == forces[1]


@pytest.mark.parametrize("name", LAWS)
def test_the_interpreted_and_the_compiled_law_agree_to_the_bit(fmus, name):
    with ForceLaw(fmus[name], engine="python") as plain, ForceLaw(fmus[name], engine="compiled") as fast:
        for law in (plain, fast):
            law.start(0.0, 0.1, 0.01)
            law.accept(1e-3, 0.2, 0.012)
        for question in ("force", "jacobian", "accept"):
            ask = [getattr(law, question)(2.5e-3, -0.1, 0.01) for law in (plain, fast)]
            assert ask[0] == ask[1]


# ---- Loops for hosts that cannot repeat a step ----------------------------------------------------------------------


def test_loop_a_steps_with_the_velocity_of_now_and_returns_the_force_at_the_end(fmus, component):
    plain, times, velocities = component("lpnl2"), (0.0, 1e-3, 3e-3), (0.1, -0.2, 0.3)
    plain.set(PORT, (0.1, 0.0))
    plain.end_initialization()
    with HeldForce(fmus["lpnl2"]) as loop:
        assert loop.start(0.0, 0.1) == plain.get(("force",))[0]
        for t, v in zip(times, velocities, strict=True):
            h = 2e-3 if t else 1e-3
            plain.set(PORT, (v, 0.0))
            plain.step(t, h)
            assert loop.step(t, h, v) == plain.get(("force",))[0]


def test_loop_b_extrapolates_the_forces_of_ramps_to_the_middle_of_the_next_step(fmus):
    times, velocities = (0.0, 1e-3, 2e-3, 5e-3), (0.1, -0.2, 0.3, 0.1)
    forces = stepped(fmus["lpnl2"], [(v, 0.0) for v in velocities], times)
    with ExtrapolatedForce(fmus["lpnl2"]) as loop:
        assert loop.start(0.0, 0.1) == forces[0]
        assert loop.step(0.0, 1e-3, 0.1) == forces[0]
        assert loop.step(1e-3, 1e-3, -0.2) == pytest.approx(1.5 * forces[1] - 0.5 * forces[0], rel=1e-12)
        assert loop.step(2e-3, 3e-3, 0.3) == pytest.approx(forces[2] + 1.5 * (forces[2] - forces[1]), rel=1e-12)
        assert loop.step(5e-3, 3e-3, 0.1) == pytest.approx(forces[3] + 0.5 * (forces[3] - forces[2]), rel=1e-12)


@pytest.mark.parametrize("kind", [HeldForce, ExtrapolatedForce])
def test_loops_without_a_jacobian_take_no_difference_for_one(fmus, kind):
    with pytest.raises(TypeError, match="unexpected keyword argument 'difference'"):
        kind(fmus["lpf1"], difference=1e-4)


# ---- Errors ---------------------------------------------------------------------------------------------------------


def test_what_a_law_refuses_names_the_corner_and_leaves_the_law_as_it_was(fmus, unchanged):
    file, closed = fmus["lpf1"], ForceLaw(fmus["lpf1"])
    closed.start(0.0, 0.0)
    closed.close()
    with ForceLaw(file, corners=CORNERS) as law, HeldForce(file) as loop:
        law.start(1.0, 0.0)
        law.accept(1.25, 0.1)
        before = law.force(1.26, 0.1)
        loop.start(0.0, 0.0)
        loop.step(0.0, 1e-3, 0.1)
        calls = {
            f"{ask.__name__} at {bad}": partial(ask, 1.26, 0.0, [0.0, 0.0, bad, 0.0])
            for ask in (law.force, law.accept, law.jacobian) for bad in (math.nan, math.inf, -math.inf)
        } | {
            "not started": lambda: ForceLaw(file).force(0.0, 0.0), "closed": lambda: closed.accept(0.0, 0.0),
            "before the accepted time": lambda: law.force(1.2, 0.1), "accepted before": lambda: law.accept(1.2, 0.1),
            "no time": lambda: law.force(math.nan, 0.0), "no step": lambda: loop.step(1e-3, 0.0, 0.1),
            "beyond the FMU": lambda: law.force(1.26, [0.1, 1e300, 0.0, 0.0]),
            "a step that begins later": lambda: loop.step(5e-3, 1e-3, 0.1),
        }  # fmt: skip
        unchanged(refusals(calls))
        np.testing.assert_array_equal(law.force(1.26, 0.1), before)
        assert law.time == 1.25
        np.testing.assert_array_equal(law.force(1.25 - 1e-12, 0.1), law.force(1.25, 0.1))  # rounding of a host's time
    unchanged(
        refusals({"start": lambda: ForceLaw(file, corners=CORNERS).start(0.0, [0.0, math.nan, 0.0, 0.0])}), "start"
    )


def test_ports_and_options_that_do_not_fit_are_refused(fmus, unchanged):
    ports = [
        {"velocity": "speed"}, {"force": "velocity"}, {"velocity": "displacement"}, {"force": None},
        {"speed": "velocity"}, {"velocity": ("velocity", 0.0)},
    ]  # fmt: skip
    options = [{"corners": ("a", "b")}, {"engine": "fast"}, {"difference": 0.0}, {"parameters": {"left": {"k": 1e-3}}}]
    calls = {str(one): partial(ForceLaw, fmus["lpf1"], ports=one) for one in ports}
    unchanged(refusals(calls | {str(one): partial(ForceLaw, [fmus["lpf1"]], **one) for one in options}))
