"""FMI 3.0 FMUs that end early, fail, lack functions, or cannot be used are reported with a reason."""

import logging

import pytest

from cosim import FmuComponent
from eightpost.archive import write_archive
from eightpost.errors import FmuError, StepError, TerminatedError

from . import lag_fmus

STEP = 0.01


def stepped(part):
    for k in range(100):
        part.step(STEP * k, STEP)


def test_an_fmu_that_ends_the_simulation_ends_the_run_there(three, kind):
    part = lag_fmus.begun(kind(three, "lag"), manner="terminate")
    with pytest.raises(TerminatedError, match=r"It reached 0.5 s. It ended the simulation \(terminateSimulation\)"):
        stepped(part)
    part.finish()


@pytest.mark.repeated(2)
@pytest.mark.parametrize("manner", ["stop early", "discard"])
def test_a_step_that_stops_early_is_a_discarded_step(three, kind, manner):
    part = lag_fmus.begun(kind(three, "lag"), manner=manner)
    with pytest.raises(StepError, match=r"fmi3DoStep returned fmi3Discard. It reached 0.5025 s.*smaller coupling step"):
        stepped(part)
    part.finish()


def test_a_step_with_a_warning_is_a_step(three, kind):
    part = lag_fmus.begun(kind(three, "lag"), manner="warn")
    stepped(part)
    part.finish()


def test_an_fmu_may_stay_behind_by_the_internal_step_that_it_declares(build, tmp_path):
    flags = f'{lag_fmus.FLAGS} fixedInternalStepSize="0.01"'
    part = FmuComponent(lag_fmus.write_three(tmp_path / "slack.fmu", build(), flags=flags), "slack")
    stepped(lag_fmus.begun(part, manner="stop early"))
    part.finish()


@pytest.mark.repeated(2)
@pytest.mark.parametrize("manner", ["error", "fatal"])
def test_an_error_names_the_function_of_fmi_3_and_the_message_the_variables(three, kind, manner, caplog):
    part = lag_fmus.begun(kind(three, "lag"), manner=manner)
    status = f"fmi3{manner.capitalize()}"
    with (
        caplog.at_level(logging.DEBUG),
        pytest.raises(StepError, match=rf"fmi3DoStep returned {status}.*100 % of u and m is lost; #"),
    ):
        stepped(part)
    part.finish()
    if manner == "fatal" and kind is FmuComponent:
        with pytest.raises(StepError, match="failed fatally before \\(fmi3Fatal\\)"):
            part.begin(0.0, 1.0, {})


def test_a_library_without_optional_functions_runs_and_is_refused_if_it_declares_them(build, tmp_path):
    sparse = build("-DSPARSE")
    plain = 'canHandleVariableCommunicationStepSize="true" providesIntermediateUpdate="true"'
    part = FmuComponent(lag_fmus.write_three(tmp_path / "sparse.fmu", sparse, flags=plain, token="sparse"), "sparse")
    lag_fmus.begun(part).set(("u",), (2.0,))
    part.step(0.0, 0.1)
    assert part.get(("x",)) == pytest.approx([lag_fmus.exact(0.0, 0.1, 2.0, 0.0)], rel=1e-14)
    part.finish()
    part = FmuComponent(lag_fmus.write_three(tmp_path / "declared.fmu", sparse, token="declared"), "declared")
    with pytest.raises(StepError, match="its library has no fmi3GetFMUState, fmi3SetFMUState, fmi3FreeFMUState"):
        part.begin(0.0, 1.0, {})


def test_sources_of_an_fmi_3_fmu_are_compiled_on_request(tmp_path, monkeypatch):
    monkeypatch.setenv("EIGHTPOST_CACHE", str(tmp_path / "cache"))
    build_description = """<fmiBuildDescription fmiVersion="3.0"><BuildConfiguration modelIdentifier="lag">
      <SourceFileSet language="C99">
        <SourceFile name="lag.c"/><PreprocessorDefinition name="FMI" value="3"/><IncludeDirectory name="parts"/>
      </SourceFileSet></BuildConfiguration></fmiBuildDescription>"""
    members = {
        "modelDescription.xml": lag_fmus.description(token="sources"),
        "sources/lag.c": b'#include "lag_fmu.h"\n',
        "sources/parts/lag_fmu.h": lag_fmus.SOURCE.read_bytes(),
        "sources/buildDescription.xml": build_description.encode(),
    }
    write_archive(tmp_path / "sources.fmu", members)
    with pytest.raises(FmuError, match="has no binary for this platform"):
        FmuComponent(tmp_path / "sources.fmu", "lag")
    part = lag_fmus.begun(FmuComponent(tmp_path / "sources.fmu", "lag", compile_missing=True))
    part.set(("u",), (2.0,))
    part.step(0.0, 0.1)
    assert part.get(("x",)) == pytest.approx([lag_fmus.exact(0.0, 0.1, 2.0, 0.0)], rel=1e-14)
    part.finish()
