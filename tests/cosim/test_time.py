"""Times without drift: steps, records and the drive have exactly the specified times."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from cosim import Adaptive, Algorithm, Capabilities, Connection, GaussSeidel, Implicit, Jacobi, Scenario, System, run
from eightpost.signals import Drivefile, TimeSeries

Join = Callable[..., System]

RAMPS = Capabilities(interpolates_inputs=True)
EXPLICIT = [Jacobi(), Jacobi("extrapolated"), GaussSeidel(), GaussSeidel(values="held")]
same_make = settings(max_examples=20, suppress_health_check=[HealthCheck.function_scoped_fixture])


def clock(make: Any) -> Any:
    """A component whose output is the end time of its last step; it accumulates no sum that could drift."""
    part = make.component(make.table(make.variable("y", "output", "s")), lambda t, _: {"y": t})
    step = part.step

    def follow(time: float, size: float) -> None:
        step(time, size)
        part.state = time + size

    part.step = follow
    return part


def steps_of(part: Any) -> list[tuple[float, float]]:
    """Start and size of each step since the run began."""
    started = max(k for k, entry in enumerate(part.log) if entry == ("started",))
    return [entry[:2] for entry in part.log[started:] if len(entry) == 4]


@same_make
@given(step=st.floats(1e-4, 0.05), steps=st.floats(1.0, 400.0), every=st.integers(1, 7))
@example(step=0.1, steps=3.0, every=1)  # 3 * 0.1 is not 0.3
@example(step=1e-3, steps=300.0, every=7)
@example(step=0.03125, steps=1.9999999999999432, every=1)  # two steps except for rounding
def test_steps_and_records_are_at_multiples_of_the_step_and_the_last_step_ends_at_the_stop_time(
    make: Any, step: float, steps: float, every: int
) -> None:
    part, stop = clock(make), steps * step
    result = run(System({"a": part}), Scenario(stop, record_step=every * step), step=step, compared=False)
    made = steps_of(part)
    assert [time for time, _ in made] == [k * step for k in range(len(made))]
    assert all(size == step for _, size in made[:-1])
    time, size = made[-1]
    assert time < stop
    assert 0.0 < size <= step * (1.0 + 1e-9)
    times = result.series.time
    assert times[-1] == stop
    assert times[:-1].tolist() == [k * step for k in range(0, len(made), every)]
    assert times[:-1] == pytest.approx(np.arange(len(times) - 1) * (every * step), rel=4e-16)
    # A last step that differs from the others only by rounding has exactly their size.
    assert abs(time + size - stop) <= 1e-9 * step
    own = np.append(times[:-1], time + size)
    assert np.abs(result.series["a.y"] - own).max() <= np.spacing(stop)


@pytest.mark.repeated
@pytest.mark.parametrize("algorithm", EXPLICIT, ids=lambda a: f"{a.name} {a.values}")
def test_recorded_outputs_have_their_values_at_the_recorded_times(make: Any, algorithm: Algorithm) -> None:
    """Both for an output on a connection, read in every step, and for one read only at recorded times."""
    parts = {"follower": make.gain(unit_in="s", unit_out="s"), "source": clock(make), "alone": clock(make)}
    system = System(parts, connections=(Connection("source.y", "follower.u"),))
    series = run(system, Scenario(30.0, record_step=0.1), algorithm=algorithm, step=1e-2, compared=False).series
    assert series.time == pytest.approx(0.1 * np.arange(301), rel=4e-16)
    for name in ("source.y", "alone.y"):
        assert series[name] == pytest.approx(series.time, rel=4e-16)


@pytest.mark.repeated(2)
@pytest.mark.parametrize(
    "algorithm", [Jacobi("extrapolated"), GaussSeidel(), Implicit(), Adaptive(relative=1e-3)], ids=lambda a: str(a.name)
)
@pytest.mark.parametrize("record_step", [0.002, 0.006, 0.01])
def test_tire_forces_of_native_cars_match_the_road_at_the_recorded_times(
    quarter_cars: Join, bumps: Drivefile, algorithm: Algorithm, record_step: float
) -> None:
    """F = k (z_R - z_2) with k = 1300 lbf/in, both at points of the drive, 4 ms apart, and between them."""
    scenario = Scenario(0.3, bumps, {"a": "car_a.road"}, record_step=record_step)
    series = run(
        quarter_cars(compression_scale=0.3, rebound_scale=0.3), scenario, algorithm=algorithm, step=0.002
    ).series
    assert series.time.tolist() == pytest.approx((record_step * np.arange(len(series))).tolist(), rel=4e-16)
    road = np.interp(series.time, bumps.series.time, bumps.series["a"])
    expected = 1300.0 * 4.4482216152605 / 0.0254 * (road - series["car_a.wheel_position"])
    assert series["car_a.tire_force"] == pytest.approx(expected, abs=1e-8 * np.abs(expected).max())


@pytest.mark.parametrize("record_step", [1e-3, 2.5e-3, 7e-3])
def test_adaptive_steps_end_at_record_times_drive_points_and_the_stop_time(
    quarter_cars: Join, bumps: Drivefile, record_step: float
) -> None:
    stop = 0.1
    scenario = Scenario(stop, bumps, {"a": "car_a.road"}, record_step=record_step)
    result = run(
        quarter_cars(), scenario, algorithm=Adaptive(relative=1e-2, largest=1.0), step=record_step, compared=False
    )
    count = int(np.ceil(stop / record_step - 1e-9))
    assert result.series.time.tolist() == [*(k * record_step for k in range(count)), stop]
    assert result.largest_step <= 0.004 * (1.0 + 1e-12)


def rough(seed: int, spacing: Sequence[float]) -> Drivefile:
    time = np.concatenate([[0.0], np.cumsum(spacing)])
    values = np.random.default_rng(seed).normal(size=time.size)
    return Drivefile(TimeSeries.from_channels(time, {"u": ("N", values)}))


def integral_errors(make: Any, drive: Drivefile, algorithm: Algorithm, step: float, can: Capabilities) -> float:
    """Largest error of x' = u, y = x at the coupling points."""
    part = make.integrator(capabilities=can)
    series = run(
        System({"a": part}), Scenario(drive.duration, drive), algorithm=algorithm, step=step, compared=False
    ).series
    exact = [0.0, *(end * drive.mean(0.0, end)[0] for end in series.time[1:])]
    return float(np.abs(series["a.y"] - exact).max())


@pytest.mark.nightly
@same_make
@given(
    seed=st.integers(0, 1000),
    parts=st.floats(0.1, 9.0),
    spacing=st.lists(st.floats(5e-4, 5e-3), min_size=40, max_size=60),
    algorithm=st.sampled_from(EXPLICIT),
    can=st.sampled_from([Capabilities(), Capabilities(variable_step=False)]),
)
def test_a_component_that_holds_its_inputs_receives_the_exact_mean_of_any_drive_at_any_step(
    make: Any, seed: int, parts: float, spacing: list[float], algorithm: Algorithm, can: Capabilities
) -> None:
    drive = rough(seed, spacing)
    whole = np.ceil(drive.duration / (parts * 0.002))
    assert integral_errors(make, drive, algorithm, drive.duration / whole, can) < 1e-13


@pytest.mark.parametrize("step", [0.003, 0.0013])
def test_a_component_that_interpolates_its_inputs_follows_drive_points_within_its_steps(make: Any, step: float) -> None:
    assert integral_errors(make, rough(0, [0.002] * 84), GaussSeidel(), step, RAMPS) < 1e-14


@pytest.mark.nightly
@same_make
@given(seed=st.integers(0, 1000), parts=st.floats(0.3, 1.0), algorithm=st.sampled_from(EXPLICIT))
def test_a_coupled_component_receives_the_exact_mean_of_the_drive_at_steps_up_to_its_interval(
    make: Any, seed: int, parts: float, algorithm: Algorithm
) -> None:
    """It takes one step per coupling step, with a linear input, wherever the drive's points lie."""
    drive = rough(seed, [0.002] * 84)
    step = drive.duration / np.ceil(drive.duration / (parts * 0.002))
    ports = make.table(
        *(make.variable(*port) for port in (("u", "input", "N"), ("v", "input", "N"), ("y", "output", "N")))
    )
    moved = make.component(
        ports,
        lambda x, _: {"y": x},
        lambda x, start, end, h: x + 0.5 * (start["u"] + end["u"] + start["v"] + end["v"]) * h,
        capabilities=RAMPS,
    )
    receiver = make.gain(0.0, capabilities=RAMPS)
    coupled = (Connection("moved.y", "receiver.u"), Connection("receiver.y", "moved.v"))
    system = System({"moved": moved, "receiver": receiver}, connections=coupled)
    scenario = Scenario(drive.duration, drive, {"u": "moved.u"})
    series = run(system, scenario, algorithm=algorithm, step=step, compared=False).series
    exact = [0.0, *(end * drive.mean(0.0, end)[0] for end in series.time[1:])]
    assert np.abs(series["moved.y"] - exact).max() < 1e-13
    assert len(steps_of(moved)) == len(series) - 1


def test_a_drive_is_read_from_the_given_drive_start(make: Any, bumps: Drivefile) -> None:
    part = make.gain(unit_in="m", unit_out="m", capabilities=RAMPS)
    series = run(
        System({"a": part}), Scenario(1.0, bumps, {"a": "a.u"}, drive_start=7.012), step=0.002, compared=False
    ).series
    road = np.interp(series.time + 7.012, bumps.series.time, bumps.series["a"])
    assert series["a.y"] == pytest.approx(road, abs=1e-15)
