"""An FMU's fault ends the step with an error that states the component, time, cause, inputs and remedy.

After the fault no function is called that FMI does not allow.
"""

import gc
import logging
from dataclasses import replace

import numpy as np
import pytest

from cosim import Adaptive, FmuComponent, GaussSeidel, IsolatedComponent, run
from eightpost.errors import FmuError, InputError, StepError

STATES = 'canGetAndSetFMUstate="true" canHandleVariableCommunicationStepSize="true"'


@pytest.mark.repeated
@pytest.mark.parametrize(
    ("manner", "cause"),
    [
        (
            "fatal",
            r"fmi2DoStep returned fmi2Fatal. Last messages: matrix 3 of piston.u is singular, pivot 0. "
            r"Its inputs: piston.u = 250 mm/s. What to do: it is not called again in this process; load it again",
        ),
        (
            "error",
            r"fmi2DoStep returned fmi2Error. Last messages: matrix 3 of piston.u is singular, pivot 0. "
            r"Its inputs: piston.u = 250 mm/s. What to do: its inputs may be out of its range",
        ),
        (
            "pending",
            r"fmi2DoStep returned fmi2Pending.*piston.u = 250 mm/s. What to do: it steps in the background "
            r"\(canRunAsynchronuously\), and this master waits for each step",
        ),
        ("unknown status", r"fmi2DoStep returned 17, which is no status of FMI.*What to do: tell its maker"),
    ],
)
def test_the_message_on_a_failed_step_states_component_time_cause_inputs_and_remedy(odd, manner, cause, foreign, pair):
    part = odd if manner != "fatal" else type(odd)(foreign(guid="{fatal}"), "odd")
    system, scenario = pair(part, manner)
    with pytest.raises(StepError, match=rf"^component 'odd' \(foreign.fmu\) failed to step (at|from) 0.5 s.*: {cause}"):
        run(system, scenario, step=1e-3, engine="python")
    with pytest.raises(StepError, match="is not running"):
        system.components["shock"].get(("force",))


@pytest.mark.repeated
@pytest.mark.parametrize("engine", ["python", "compiled"])
def test_an_fmu_that_ends_the_simulation_ends_the_run_as_the_stop_time_would(odd, engine, pair):
    """fmi2Discard with fmi2Terminated (FMI 2.0.4, 4.2.1)."""
    system, scenario = pair(odd, "end")
    result = run(system, scenario, step=1e-3, engine=engine)
    assert (result.ended_by, result.ended_at, result.partial) == ("odd", pytest.approx(0.5), False)
    assert result.acceptable and result.series.time[-1] == pytest.approx(0.5)
    assert result.notes[0] == (
        "component 'odd' (foreign.fmu) ended the simulation at 0.5 s of 1 s: the result ends there"
    )
    whole = run(*pair(odd, "polite", stop=0.5), step=1e-3, engine=engine)
    assert (whole.ended_by, whole.ended_at) == ("", None)
    for name in whole.series.names:
        np.testing.assert_array_equal(whole.series[name], result.series[name])


@pytest.mark.repeated
def test_the_default_algorithm_ends_where_an_fmu_ends_the_simulation(odd, pair):
    result = run(*pair(odd, "end"), engine="python")
    assert result.ended_by == "odd" and result.ended_at == pytest.approx(0.5, abs=2e-3)
    assert not result.partial


def test_an_adaptive_run_ends_where_an_fmu_ends_the_simulation(foreign, pair):
    system, scenario = pair(FmuComponent(foreign(flags=STATES), "odd"), "end")
    result = run(system, replace(scenario, record_step=0.01), algorithm=Adaptive(least=1e-5), step=5e-3)
    assert result.ended_by == "odd" and result.ended_at == pytest.approx(0.5, abs=1e-4)
    assert not result.partial and result.series.time[-1] == pytest.approx(0.5)


@pytest.mark.repeated
def test_an_end_before_the_settling_time_is_an_error(odd, pair):
    system, scenario = pair(odd, "end")
    with pytest.raises(StepError, match=r"ended the simulation \(fmi2Terminated\).*What to do: end the run before"):
        run(system, replace(scenario, settling=0.6), step=1e-3, engine="python")


@pytest.mark.repeated
def test_the_message_on_a_discarded_step_states_the_time_reached_and_the_remedy(odd, begun, march):
    part = begun(odd, "discard")
    march(part, 3)
    with pytest.raises(StepError, match=r"step from 0.003 s by 0.002 s: .*fmi2Discard. It reached 0.004 s.*smaller"):
        part.step(3e-3, 2e-3)
    part.finish()


def test_an_adaptive_run_reduces_steps_that_a_component_discards(foreign, pair):
    system, scenario = pair(FmuComponent(foreign(flags=STATES), "odd"), "discard", stop=0.1)
    loose = Adaptive(relative=1.0, largest=0.01)
    result = run(system, replace(scenario, record_step=0.01), algorithm=loose, step=5e-3)
    assert result.acceptable and result.rejected_steps > 0
    assert 1e-4 < result.largest_step <= 1.5e-3
    assert result.series.time[-1] == 0.1


@pytest.mark.parametrize("algorithm", [GaussSeidel(), Adaptive()], ids=["gauss-seidel", "adaptive"])
def test_no_function_is_called_after_fmi2fatal_even_if_states_are_saved(algorithm, foreign, pair):
    """This FMU ends the process at any call after fmi2Fatal, including a call that frees a state."""
    system, scenario = pair(FmuComponent(foreign(guid="{fatal}", flags=STATES), "odd"), "fatal")
    with pytest.raises(StepError, match="fmi2Fatal"):
        run(system, scenario, algorithm=algorithm, step=1e-3, engine="python")
    odd = system.components["odd"]
    assert not odd.usable
    with pytest.raises(StepError, match=r"failed fatally before.*none of its functions may be called.*--isolate"):
        odd.begin(0.0, 1.0, {})
    odd.finish()
    odd.close()


def test_fmi2fatal_disables_all_instances_of_the_fmu_in_the_process(foreign, begun, march):
    path = foreign(guid="{all}")
    first, second = begun(FmuComponent(path, "first"), "fatal"), begun(FmuComponent(path, "second"))
    other = begun(FmuComponent(foreign("other.fmu", guid="{other}"), "other"))
    with pytest.raises(StepError, match="fmi2Fatal"):
        march(first)
    with pytest.raises(StepError, match="is not running"):
        march(second, 1)
    march(other, 1)
    assert (first.usable, second.usable, other.usable) == (False, False, True)
    march(begun(FmuComponent(path, "loaded again")), 4)


@pytest.mark.repeated
def test_a_component_can_begin_again_after_a_failed_run(odd, begun, march, runs):
    for manner in ("error", "end", "pending", *(["fatal"] if type(odd) is IsolatedComponent else [])):
        part = begun(odd, manner)
        with pytest.raises(StepError):
            march(part)
        part.finish()
        runs(begun(part))


def test_the_log_level_of_a_message_follows_its_fmi_status(foreign, begun, march, caplog):
    for manner, level in (("fatal", logging.CRITICAL), ("error", logging.ERROR)):
        with pytest.raises(StepError):
            march(begun(FmuComponent(foreign(guid="{fatal}"), "odd"), manner))
        assert (caplog.records[-1].name, caplog.records[-1].levelno) == ("cosim.fmu.odd", level)


def test_components_can_begin_again_after_a_failed_initialization(foreign, pair):
    """Before the first step an FMU must not be terminated, only reset or freed (FMI 2.0.4, 4.2.4)."""
    system, scenario = pair(FmuComponent(foreign(), "odd"))
    system.components["odd"].begin(0.0, 1.0, {})
    system.components["odd"].finish()
    assert run(system, scenario, step=1e-2, engine="python").steps == 100


@pytest.mark.nightly
@pytest.mark.parametrize(("manner", "how"), [
    ("segfault", r"crashed \(SIGSEGV\)"), ("exit", r"crashed \(its process ended with code 3\)"),
    ("hang", r"did not respond within 0.7 s and was ended"),
])  # fmt: skip
def test_an_isolated_crash_or_hang_is_a_failed_step_and_the_other_components_are_finished(manner, how, foreign, pair):
    system, scenario = pair(IsolatedComponent(foreign(), "odd", time_limit=0.7), manner)
    with pytest.raises(
        StepError,
        match=rf"^component 'odd' \(foreign.fmu\) {how} in: step from 0.5 s by 0.001 s.*piston.u = 250 mm/s. W",
    ):
        run(system, scenario, step=1e-3, engine="python")
    with pytest.raises(StepError, match="is not running"):
        system.components["shock"].get(("force",))


@pytest.mark.nightly
def test_a_crash_is_reported_with_the_last_output_and_a_new_process_is_started(foreign, begun, march, runs):
    part = begun(IsolatedComponent(foreign(), "odd"), "abort")
    with pytest.raises(StepError) as caught:
        march(part)
    assert str(caught.value) == (
        "component 'odd' (foreign.fmu) crashed (SIGABRT) in: step from 0.5 s by 0.001 s: it printed 'solver: assertion "
        "failed'. Last messages: pressure 7 is low, 0.25 bar. Its inputs: piston.u = 250 mm/s. What to do: check "
        "whether these inputs are in its range, try a smaller coupling step, and report the fault to its maker; it can "
        "be started again, in a new process"
    )
    with pytest.raises(StepError, match="is not running"):
        part.get(("angle",))
    runs(begun(part))


def test_a_time_limit_must_be_positive(foreign):
    with pytest.raises(InputError, match="time limit must be positive, not 0"):
        IsolatedComponent(foreign(), "odd", time_limit=0)


def test_a_refused_file_leaves_no_temporary_folder(kind, foreign, source_fmu, temporary):
    for path in (foreign(kind="ModelExchange"), source_fmu(model=""), temporary / "gone.fmu"):
        with pytest.raises(FmuError):
            kind(path, "odd")
    gc.collect()
    assert list(temporary.iterdir()) == []


@pytest.mark.repeated
def test_a_failed_component_leaves_no_temporary_folder(kind, foreign, begun, march, temporary):
    part = begun(kind(foreign(guid="{fatal}"), "odd"), "fatal")
    with pytest.raises(StepError):
        march(part)
    del part
    gc.collect()
    assert list(temporary.iterdir()) == []
