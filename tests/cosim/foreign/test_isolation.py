"""FMUs in separate processes give identical results and leave no process or folder behind, also after a failure."""

import gc
import os
import signal
import subprocess
import sys
import threading
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

import cosim
from cosim import (
    Automatic,
    Bond,
    FmuComponent,
    GaussSeidel,
    Implicit,
    IsolatedComponent,
    Jacobi,
    RunInterrupted,
    Scenario,
    System,
    open_component,
    run,
)
from cosim.system_file import read_case
from eightpost.__main__ import main
from eightpost.errors import StepError


def car_and_shock(fmus, *, isolate):
    parts = {name: open_component(fmus[file], name, isolate=isolate) for name, file in
             (("car", "quarter_car"), ("shock", "lpnl2"))}  # fmt: skip
    inputs = [v.name for v in parts["car"].variables.values() if v.causality == "input"]
    constants = {f"car.{name}": 0.0 for name in inputs if name not in ("force", "road")}
    return System(parts, (Bond.between("car", "shock"),), constants=constants)


@pytest.fixture(scope="module")
def systems(fmus):
    """The same system in this process and with each FMU in a separate process."""
    return car_and_shock(fmus, isolate=False), car_and_shock(fmus, isolate=True)


@pytest.mark.repeated
@pytest.mark.parametrize(("algorithm", "step"), [
    (GaussSeidel(), 1e-3), (Jacobi(), 1e-3), (Implicit(), 4e-3), (cosim.Adaptive(), 1e-3), (Automatic(), None),
], ids=["gauss-seidel", "jacobi", "implicit", "adaptive", "default"])  # fmt: skip
def test_an_isolated_run_equals_a_direct_run_bit_for_bit(algorithm, step, systems, road):
    """The runs save and restore states and interpolate inputs, so every call of the loop is covered."""
    scenario = Scenario(stop=0.04, drive=road, targets={"road": "car.road"}, record_step=4e-3)
    direct, isolated = (run(s, scenario, algorithm=algorithm, step=step, engine="python") for s in systems)
    assert direct.steps == isolated.steps and direct.iterations == isolated.iterations
    assert direct.series.names == isolated.series.names
    assert np.ptp(direct.series["car.velocity"]) > 0.01
    for name in direct.series.names:
        np.testing.assert_array_equal(direct.series[name], isolated.series[name], err_msg=name)


def test_an_isolated_component_is_restored_to_a_saved_state(kind, foreign, begun, march):
    part = begun(kind(foreign(flags='canGetAndSetFMUstate="true"'), "odd"))
    march(part, 4)
    state = part.save()
    march(part, 8)
    assert part.get(("angle",))[0] == pytest.approx(3.0)
    part.restore(state)
    assert part.get(("angle",))[0] == pytest.approx(1.0)
    part.free(state)
    with pytest.raises(StepError, match="does not know this state"):
        part.restore(state)
    part.finish()


@pytest.mark.nightly
def test_the_working_folder_of_an_isolated_component_is_removed_with_it(
    foreign, begun, march, tmp_path, temporary, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    part = begun(IsolatedComponent(foreign(), "odd"), "write")
    march(part, 3)
    (log,) = tmp_path.rglob("solver.log")
    assert log.parent.parent.parent == temporary
    assert log.read_text() == "0\n0.001\n0.002\n"
    part.finish()
    del part
    gc.collect()
    assert list(temporary.iterdir()) == []


def test_processes_started_by_an_isolated_fmu_end_with_it(foreign, begun, march, eventually, alive):
    part = begun(IsolatedComponent(foreign(), "odd"), "start process")
    march(part, 1)
    group = part._process._process.pid
    part.finish()
    part.close()
    assert eventually(lambda: not alive(group))


def interrupt_after(seconds):
    """Send SIGINT to this process after a delay [s], as Ctrl-C in a terminal does."""
    timer = threading.Timer(seconds, os.kill, (os.getpid(), signal.SIGINT))
    timer.start()
    return timer


@pytest.mark.slow
def test_ctrl_c_in_a_run_keeps_the_partial_result_and_leaves_no_process_or_folder(
    foreign, pair, temporary, alive, eventually
):
    system, scenario = pair(IsolatedComponent(foreign(), "odd"), stop=100.0)
    group = system.components["odd"]._process._process.pid
    timer = interrupt_after(2.0)
    with pytest.raises(RunInterrupted) as caught:
        run(system, scenario, step=1e-3, engine="python")
    timer.join()
    assert caught.value.result.partial and caught.value.result.series.time.size > 1
    for component in system.components.values():
        component.close()
    assert eventually(lambda: not alive(group))
    assert list(temporary.iterdir()) == []


@pytest.mark.nightly
def test_ctrl_c_while_an_fmu_hangs_at_the_start_ends_its_process(foreign, begun, runs, alive):
    part = IsolatedComponent(foreign(), "odd")
    group = part._process._process.pid
    timer = interrupt_after(0.7)
    with pytest.raises(KeyboardInterrupt):
        begun(part, "hang at start")
    timer.join()
    assert not alive(group)
    part.finish()
    runs(begun(part))


#: Without the package's own imports, which take seconds.
PARENT = """
import sys, types
package = sys.modules["cosim"] = types.ModuleType("cosim")
package.__path__ = [sys.argv[3]]
from cosim.components.isolated import IsolatedComponent
part = IsolatedComponent(sys.argv[1], "odd")
part.begin(0.0, 1.0, {"manner": sys.argv[2]})
part.end_initialization()
print(part._process._process.pid, flush=True)
part.set(("piston.u",), (250.0,))
part.step(0.5, 1e-3)
print("stepped", flush=True)
if sys.stdin.read(1):
    raise ValueError("an error of the caller's own")
"""


@pytest.fixture
def parent(foreign, temporary):
    """Start a process that steps an isolated foreign FMU."""

    def start(manner):
        environment = {**os.environ, "TMPDIR": str(temporary)}
        command = [sys.executable, "-c", PARENT, str(foreign()), manner, str(Path(cosim.__file__).parent)]
        pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
        return subprocess.Popen(command, env=environment, **pipes)

    return start


@pytest.mark.repeated
@pytest.mark.parametrize("manner", ["write", "hang"])
def test_a_child_process_ends_if_its_parent_is_killed_and_leaves_no_folder(
    manner, parent, temporary, eventually, alive
):
    with parent(manner) as process:
        child = int(process.stdout.readline())
        if manner == "write":
            assert process.stdout.readline() == b"stepped\n"
        process.kill()
    assert eventually(lambda: not alive(child))
    assert eventually(lambda: list(temporary.iterdir()) == [])


SYSTEM = """
schema = 1
[components.odd]
fmu = "{fmu}"
parameters = {{ manner = "{manner}" }}
inputs = {{ "piston.u" = 250.0 }}
[scenario]
stop = "0.6 s"
coupling_step = "1 ms"
record = ["odd.angle"]
"""


@pytest.mark.nightly
def test_the_run_command_reports_a_crash_and_compiles_missing_libraries(
    source_fmu, tmp_path, monkeypatch, foreign_library
):
    monkeypatch.setenv("EIGHTPOST_CACHE", str(tmp_path / "cache"))
    path = source_fmu(model='#include "foreign_fmu.h"\n')
    line = ["run", str(tmp_path / "case.toml"), "-o", str(tmp_path / "out"), "--step", "1 ms"]
    (tmp_path / "case.toml").write_text(SYSTEM.format(fmu=path.name, manner="polite"))
    refused = CliRunner().invoke(main, line)
    assert (refused.exit_code, "compile=yes" in refused.output) == (2, True)
    for manner, code, message in (
        ("polite", 0, "wrote "),
        ("segfault", 1, "'odd' (sources.fmu) crashed (SIGSEGV) in: step"),
    ):
        (tmp_path / "case.toml").write_text(SYSTEM.format(fmu=path.name, manner=manner))
        ran = CliRunner().invoke(main, [*line, "--isolate", "--set", "compile=yes"])
        assert ran.exit_code == code, ran.output
        assert message in " ".join(ran.output.split())


def test_the_fmus_of_a_system_file_are_isolated_on_request(foreign, tmp_path):
    (tmp_path / "case.toml").write_text(SYSTEM.format(fmu=foreign().name, manner="polite"))
    for isolate, kind in ((False, FmuComponent), (True, IsolatedComponent)):
        case = read_case(tmp_path / "case.toml", isolate=isolate)
        assert type(case.system.components["odd"]) is kind
