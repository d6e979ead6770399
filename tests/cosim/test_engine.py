"""The compiled and the interpreted loop agree bit by bit, release the GIL, and can be interrupted."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time as clock
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cosim import (
    Adaptive,
    Algorithm,
    Automatic,
    Capabilities,
    GaussSeidel,
    Implicit,
    Jacobi,
    Result,
    RunInterrupted,
    Scenario,
    System,
    run,
)
from cosim.components.fmu_component import _FmuInstance
from cosim.engine import march
from cosim.systems.algorithm import VALUES
from eightpost.signals import Drivefile

Join = Callable[..., System]

#: Absolute tolerances of quarter car a that leave only the relative tolerance of an adaptive run in effect.
NOTHING = dict.fromkeys(("car_a.velocity", "car_a.displacement", "shock_a.force"), 1e-12)

EXPLICIT = [scheme(values=values) for scheme in (Jacobi, GaussSeidel) for values in VALUES]
REPEATING = [
    Implicit(),
    Adaptive(relative=1e-3),
    Adaptive(Jacobi(), relative=1e-2),
    Adaptive(Jacobi("extrapolated"), relative=1e-3),
    Adaptive(Implicit(), relative=1e-3),
]

#: All fields of a result except the series, the wall times, and fields that are equal by construction.
FIELDS = (
    "converged", "notes", "order", "step", "steps", "iterations", "rejected_steps", "largest_step", "partial", "energy",
    "coupled", "share_beyond_fit", "share_tire_off", "stated_error", "scheme", "held_direct", "equilibrium_sweeps",
)  # fmt: skip


def named(algorithm: Any) -> str:
    scheme = getattr(algorithm, "scheme", None)
    return " ".join(filter(None, (algorithm.name, named(scheme) if scheme else getattr(algorithm, "values", ""))))


def series_bits(result: Result) -> tuple[tuple[str, ...], bytes, bytes]:
    return result.series.names, result.series.time.tobytes(), result.series.values.tobytes()


def check_equal(one: Result, other: Result) -> None:
    """Check that all computed values of two results are bit-identical."""
    for name in FIELDS:
        assert getattr(one, name) == getattr(other, name), name
    assert np.isfinite(one.series.values).all()
    assert series_bits(one) == series_bits(other)


def both(system: System, scenario: Scenario, algorithm: Algorithm | Automatic, step: float | None = None) -> Result:
    """Run in both loops and check that the results are bit-identical."""
    compiled, plain = (
        run(system, scenario, algorithm=algorithm, step=step, engine=e, compared=False) for e in ("compiled", "python")
    )
    check_equal(compiled, plain)
    return compiled


@pytest.mark.repeated(2)
@pytest.mark.slow
@pytest.mark.parametrize("algorithm", [*EXPLICIT, *REPEATING], ids=named)
def test_the_compiled_and_the_interpreted_loop_give_bit_identical_results(
    seven_dof: Join, track: Drivefile, algorithm: Algorithm
) -> None:
    """At 4 ms the car takes two steps per step of its shocks: the drive has 500 points a second."""
    system = seven_dof(compression_scale=0.3, rebound_scale=0.3)
    result = both(system, Scenario(0.12, track, drive_start=2.0, settling=0.02), algorithm, 0.004)
    assert np.ptp(result.series["car.lf.velocity"]) > 0.01


def linear_damper(make: Any, *, ramps: bool) -> Any:
    ports = make.table(make.variable("velocity", "input", "m/s"), make.variable("force", "output", "N", ["velocity"]))
    capabilities = Capabilities(interpolates_inputs=ramps)
    return make.component(ports, lambda _, u: {"force": 900.0 * u["velocity"]}, capabilities=capabilities)


@pytest.mark.parametrize(
    ("algorithm", "ramps"), [(Jacobi("parabolic"), False), (GaussSeidel(), True)], ids=["holds", "ramps"]
)
def test_python_components_coupled_to_native_ones_give_bit_identical_results_in_both_loops(
    seven_dof: Join, track: Drivefile, make: Any, algorithm: Algorithm, ramps: bool
) -> None:
    system = seven_dof(parts={"rr": linear_damper(make, ramps=ramps)}, compression_scale=0.3, rebound_scale=0.3)
    result = both(system, Scenario(0.12, track, drive_start=2.0), algorithm, 0.004)
    assert np.ptp(result.series["rr.force"]) > 10.0


@pytest.mark.repeated(2)
@pytest.mark.parametrize("algorithm", EXPLICIT, ids=named)
def test_input_derivatives_are_set_only_if_coupling_values_change_over_a_step(
    seven_dof: Join, track: Drivefile, make: Any, algorithm: Algorithm
) -> None:
    damper = linear_damper(make, ramps=True)
    slopes: list[float] = []
    damper.set_derivatives = lambda _, values: slopes.extend(values)
    run(seven_dof(parts={"rr": damper}), Scenario(0.05, track), algorithm=algorithm, step=0.001, compared=False)
    assert len(slopes) == (0 if algorithm.values == "held" else 50)
    assert any(slopes) == bool(slopes)


def test_the_default_algorithm_gives_bit_identical_results_in_both_loops(quarter_cars: Join, bumps: Drivefile) -> None:
    both(quarter_cars(), Scenario(0.2, bumps, {"a": "car_a.road"}), Automatic())


INTERPRETED = """
import sys
from cosim import *
from eightpost.signals import Drivefile
car, shock, drive = sys.argv[1:]
system = System.load(
    {"car_a": car, "shock_a": shock}, [Bond.between("car_a", "shock_a")], constants={"car_a.aero_force": 0.0}
)
scenario = Scenario(0.4, Drivefile.read(drive), {"a": "car_a.road"})
for algorithm in (GaussSeidel(), Implicit(), Adaptive()):
    run(system, scenario, algorithm=algorithm, step=2e-3, engine="python", compared=False)
assert not {"llvmlite", "numba"} & set(sys.modules)
"""


@pytest.mark.nightly
def test_interpreted_runs_load_no_compiler(bumps: Drivefile, fmus: dict[str, Path], tmp_path: Path) -> None:
    bumps.write(tmp_path / "drive.parquet")
    arguments = map(str, (fmus["quarter_car"], fmus["lpnl2"], tmp_path / "drive.parquet"))
    subprocess.run([sys.executable, "-c", INTERPRETED, *arguments], check=True)


@pytest.mark.parametrize("algorithm", [GaussSeidel(), Implicit(), Adaptive()], ids=named)
def test_a_system_runs_again_from_the_start_without_new_fmu_instances(
    quarter_cars: Join, bumps: Drivefile, monkeypatch: pytest.MonkeyPatch, algorithm: Algorithm
) -> None:
    """Between the two runs, the same components run in another system with other parameters and another step."""
    made: list[str] = []
    new = _FmuInstance._new

    def counted(instance: _FmuInstance) -> Any:
        made.append(instance.name)
        return new(instance)

    monkeypatch.setattr(_FmuInstance, "_new", counted)
    system, scenario = quarter_cars(), Scenario(0.5, bumps, {"a": "car_a.road"})
    first = run(system, scenario, algorithm=algorithm, step=2e-3, compared=False)
    assert sorted(made) == ["car_a", "shock_a"]
    run(
        quarter_cars("a", dict(system.components), time_constant=0.004, gas_preload=900.0),
        scenario,
        step=5e-4,
        compared=False,
    )
    check_equal(first, run(system, scenario, algorithm=algorithm, step=2e-3, compared=False))
    assert len(made) == 2


def test_runs_in_two_threads_are_bit_identical_to_sequential_runs(quarter_cars: Join, bumps: Drivefile) -> None:
    algorithms: list[Algorithm] = [Implicit(), Adaptive(relative=1e-5), GaussSeidel(), Jacobi("extrapolated")]
    systems = [quarter_cars(time_constant=1e-3 * (k + 1)) for k in range(4)]

    def go(k: int) -> Result:
        return run(
            systems[k], Scenario(5.0, bumps, {"a": "car_a.road"}), algorithm=algorithms[k], step=5e-4, compared=False
        )

    alone = [go(k) for k in range(4)]
    with ThreadPoolExecutor(2) as threads:
        for one, other in zip(alone, threads.map(go, range(4)), strict=True):
            check_equal(one, other)


@pytest.mark.nightly
def test_the_compiled_loop_releases_the_gil(
    quarter_cars: Join, bumps: Drivefile, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One call of the loop covers the whole run; if it held the GIL, the counting thread would stop meanwhile."""
    monkeypatch.setattr(march, "COMPILED_CHUNK", 10**9)
    system, scenario = (
        quarter_cars(),
        Scenario(30.0, bumps, {"a": "car_a.road"}, record=("car_a.velocity",), record_step=1.0),
    )
    seen, ended = [clock.perf_counter()], threading.Event()

    def count() -> None:
        while not ended.is_set():
            seen.append(clock.perf_counter())
            clock.sleep(1e-3)

    thread = threading.Thread(target=count)
    thread.start()
    result = run(system, scenario, step=2e-5, engine="compiled", compared=False)
    ended.set()
    thread.join()
    assert result.stepping_seconds > 0.1
    assert max(after - before for before, after in pairwise(seen)) < 0.5 * result.stepping_seconds


@pytest.mark.nightly
@pytest.mark.parametrize("algorithm", [GaussSeidel(), Adaptive(relative=1e-9, absolute=NOTHING)], ids=named)
def test_ctrl_c_in_a_long_compiled_run_returns_the_partial_result_within_a_second(
    quarter_cars: Join, bumps: Drivefile, algorithm: Algorithm
) -> None:
    system, scenario = quarter_cars(), Scenario(30.0, bumps, {"a": "car_a.road"}, record_step=0.01)
    running, pressed = threading.Event(), [0.0]

    def press() -> None:
        assert running.wait(60.0)
        clock.sleep(2e-3)
        pressed[0] = clock.perf_counter()
        os.kill(os.getpid(), signal.SIGINT)

    thread = threading.Thread(target=press)
    thread.start()
    with pytest.raises(RunInterrupted) as raised:
        run(
            system,
            scenario,
            algorithm=algorithm,
            step=1e-5,
            engine="compiled",
            progress=lambda done, total: running.set() if done > 0.01 * total else None,
            compared=False,
        )
    seconds = clock.perf_counter() - pressed[0]
    thread.join()
    result = raised.value.result
    assert pressed[0] > 0.0
    assert seconds < 1.0
    assert result.partial
    assert not result.acceptable
    assert any("interrupted" in note for note in result.notes)
    reached = float(result.series.time[-1])
    assert 0.0 < reached < 30.0
    # The longer run stops later: a stop time is a point of the drive, and interpolation towards it rounds differently.
    # The last sample is at the interruption. Only adaptive runs depend on what they record.
    every = 0.01 if isinstance(algorithm, Adaptive) else 1e-5
    further = Scenario(reached + 0.02, bumps, {"a": "car_a.road"}, record_step=every)
    longer = run(system, further, algorithm=algorithm, step=1e-5, compared=False).series
    rows = np.searchsorted(longer.time, result.series.time)
    assert rows.size > 10
    assert longer.time[rows].tobytes() == result.series.time.tobytes()
    assert longer.values[:, rows].tobytes() == result.series.values.tobytes()
