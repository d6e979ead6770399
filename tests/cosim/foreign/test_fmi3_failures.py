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


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"interface": "ModelExchange"}, "is for model exchange only .* export it again as FMI 3.0 for co-simulation"),
        ({"interface": "ScheduledExecution"}, "is for scheduled execution only.*export it again for co-simulation"),
        ({"variables": '<Float64 name="a" valueReference="x"/>'}, "a: valueReference='x' is not a value reference"),
        ({"variables": '<Float64 valueReference="1"/>'}, "a Float64 variable has no name"),
        (
            {"variables": '<Float64 name="a" valueReference="1"><Dimension valueReference="7"/></Float64>'},
            "a: a dimension has neither a start value nor a structural parameter",
        ),
        (
            {"variables": '<Float64 name="a" valueReference="1" start="1 2 3"><Dimension start="2"/></Float64>'},
            "a: has 3 start values for 2 elements",
        ),
        (
            {"variables": '<Float64 name="a" valueReference="1"/><Int8 name="a" valueReference="2"/>'},
            "two variables have the name 'a'",
        ),
        ({"variables": '<Float64 name="a" valueReference="1" min="low"/>'}, "a: min='low' is not a number"),
        ({"variables": '<Float64 name="a" valueReference="1" start="low"/>'}, "a: start='low' is not a number"),
        ({"variables": "<Float64"}, "modelDescription.xml cannot be read"),
        (
            {"variables": '<String name="a" valueReference="1" start="1"/>'},
            "a: start='1' is an attribute, but a String of FMI 3.0 states its start value in a Start element",
        ),
        ({"flags": 'fixedInternalStepSize="some"'}, "modelDescription.xml cannot be read"),
    ],
)
def test_an_fmu_that_cannot_be_used_is_refused_with_a_reason(build, tmp_path, changed, message):
    with pytest.raises(FmuError, match=message):
        _ = FmuComponent(lag_fmus.write_three(tmp_path / "faulty.fmu", build(), **changed), "faulty").variables


def test_a_clock_is_not_a_variable(build, tmp_path):
    variables = (
        '<Float64 name="a" valueReference="1"/><Clock name="c" valueReference="2" intervalVariability="triggered"/>'
    )
    part = FmuComponent(lag_fmus.write_three(tmp_path / "clock.fmu", build(), variables=variables), "clock")
    assert part.variables.keys() == {"a"}


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
