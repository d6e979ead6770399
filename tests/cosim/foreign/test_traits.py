"""FMUs with unusual but valid properties run, in this process and isolated, and are coupled in SI units."""

import logging
import math
import shutil
from dataclasses import replace

import numpy as np
import pytest

from cosim import Bond, Connection, FmuComponent, IsolatedComponent, Scenario, System, run
from eightpost.errors import FmuError, StepError, WiringError

FIXED_STEPS = 'canHandleVariableCommunicationStepSize="false"'
ONCE = 'canBeInstantiatedOnlyOncePerProcess="true"'


@pytest.mark.repeated
def test_units_of_mm_per_s_kn_and_deg_are_converted_to_si(odd, pair):
    system, scenario = pair(odd, stop=0.2)
    series = run(system, scenario, step=1e-3, engine="python").series
    np.testing.assert_allclose(series["odd.piston.y"][1:], -3.0 * 0.25 * 1000.0, rtol=1e-12)  # N
    np.testing.assert_array_equal(series["odd.piston.y"], series["odd.alias"])
    assert series["odd.angle"][-1] == pytest.approx(math.radians(250.0 * 0.2), rel=1e-9)


def test_a_shock_with_different_names_units_and_sign_is_coupled_as_the_equivalent_damper(foreign, fmus, make, road):
    """F [kN] = -3 u [mm/s] / 1000 is a damper of 3000 N s/m with the opposite sign: a bond with gain -1."""

    def result(shock, velocity, force, gain):
        bond = Bond(
            "b", Connection("car.velocity", f"shock.{velocity}"), Connection(f"shock.{force}", "car.force", gain)
        )
        car = FmuComponent(fmus["quarter_car"], "car")
        free = [v.name for v in car.variables.values() if v.causality == "input" and v.name not in ("force", "road")]
        constants = {f"car.{name}": 0.0 for name in free}
        recorded = tuple(f"car.{v.name}" for v in car.variables.values() if v.causality == "output")
        system = System({"car": car, "shock": shock}, (bond,), constants=constants)
        scenario = Scenario(stop=0.3, drive=road, targets={"road": "car.road"}, record=recorded)
        return run(system, scenario, step=1e-3, engine="python")

    odd = result(FmuComponent(foreign(), "shock"), "piston.u", "piston.y", -1.0)
    damper = result(make.gain(3000.0, "m/s", "N"), "u", "y", 1.0)
    assert np.ptp(damper.series["car.velocity"]) > 0.01
    for name in damper.series.names:
        spread = np.ptp(damper.series[name]) + 1e-12
        np.testing.assert_allclose(odd.series[name], damper.series[name], atol=1e-9 * spread, rtol=0, err_msg=name)
    assert odd.energy["b"].transferred == pytest.approx(damper.energy["b"].transferred, rel=1e-9)


@pytest.mark.repeated
def test_parameters_of_every_type_are_set_and_start_values_kept(odd, begun):
    part = begun(odd)
    assert part.get(("seen",)) == [4.0]
    part.finish()
    begun(part, gear=2, flag=True)
    assert part.get(("seen",)) == [102.0]
    part.finish()


@pytest.mark.repeated
def test_an_output_that_is_nan_at_the_start_is_read_as_nan(odd, begun, march):
    part = begun(odd)
    assert math.isnan(part.get(("late",))[0])
    march(part, 4)
    assert part.get(("late",))[0] == pytest.approx(1.0)
    part.finish()


def test_an_fmu_with_fixed_steps_is_only_stepped_by_whole_coupling_steps(foreign, pair):
    system, scenario = pair(FmuComponent(foreign(flags=FIXED_STEPS), "odd"), stop=0.1)
    assert run(system, scenario, step=1e-3, engine="python").steps == 100
    with pytest.raises(WiringError, match=r"odd accepts steps of one size only.*whole number of coupling steps"):
        run(system, replace(scenario, stop=0.0995), step=1e-3, engine="python")


def test_missing_capabilities_are_reported(foreign, pair):
    odd = FmuComponent(foreign(flags=FIXED_STEPS), "odd")
    assert not (odd.capabilities.variable_step or odd.capabilities.interpolates_inputs or odd.capabilities.state)
    system, scenario = pair(odd, stop=0.05)
    notes = run(system, scenario, step=1e-3, engine="python").notes
    assert any("odd cannot interpolate inputs" in note for note in notes)
    odd.begin(0.0, 1.0, {})
    with pytest.raises(StepError, match=r"cannot save its state \(canGetAndSetFMUstate is false"):
        odd.save()


def test_an_fmu_that_manages_its_own_memory_or_lacks_optional_functions_runs(foreign, sparse_library, begun, runs):
    own = {"guid": "{own memory}", "flags": 'canNotUseMemoryManagementFunctions="true"'}
    for declared in (own, {"library": sparse_library}):
        runs(begun(FmuComponent(foreign(**declared), "odd")))


def test_a_library_without_a_function_that_its_description_declares_is_refused(foreign, sparse_library, begun):
    path = foreign(library=sparse_library, flags='canInterpolateInputs="true"')
    with pytest.raises(StepError, match=r"failed to instantiate.*its library has no fmi2SetRealInputDerivatives"):
        begun(FmuComponent(path, "odd"))


def test_an_fmu_that_needs_its_tool_is_noted_in_results_and_in_the_error_if_the_tool_is_missing(
    foreign, pair, monkeypatch
):
    system, scenario = pair(FmuComponent(foreign(guid="{tool}", flags='needsExecutionTool="true"'), "odd"), stop=0.01)
    with pytest.raises(StepError, match=r"'odd'.*failed to instantiate.*What to do: install the tool that made it"):
        run(system, scenario, step=1e-3, engine="python")
    monkeypatch.setenv("FOREIGN_TOOL", "1")
    notes = run(system, scenario, step=1e-3, engine="python").notes
    assert any(note.startswith("odd: it needs the tool that made it (needsExecutionTool)") for note in notes)


@pytest.mark.nightly
def test_a_second_instance_of_a_once_per_process_fmu_is_refused_unless_isolated(foreign, begun, runs):
    path = foreign(flags=ONCE, guid="{once}")
    first, second = begun(FmuComponent(path, "first")), FmuComponent(path, "second")
    with pytest.raises(StepError, match=r"'second'.*one instance per process, and component 'first' has it.*--isolate"):
        second.begin(0.0, 1.0, {})
    first.finish()
    begun(second).finish()
    apart = [begun(IsolatedComponent(path, name)) for name in ("first", "second")]
    for part in apart:
        runs(part)


@pytest.mark.repeated
def test_log_messages_are_formatted_with_variable_names(odd, begun, march, caplog):
    caplog.set_level(logging.DEBUG, logger="cosim.fmu")
    part = begun(odd, "talk")
    march(part, 1)
    part.finish()
    assert [(r.name, r.levelno, r.message) for r in caplog.records if r.name.startswith("cosim.fmu")] == [
        ("cosim.fmu.odd", logging.DEBUG, "step 5 of gear is 12.3 % done; #1")
    ]
    assert part.messages == ()


@pytest.mark.repeated
def test_printed_output_of_an_isolated_fmu_is_logged(odd, begun, march, caplog):
    caplog.set_level(logging.DEBUG, logger="cosim.fmu")
    part = begun(odd, "print")
    march(part, 2)
    part.finish()
    logged = [r.message for r in caplog.records if r.name == "cosim.fmu.odd"]
    assert logged == ([] if type(odd) is FmuComponent else ["printed: solved at 0", "printed: solved at 0.001"])


def test_files_written_by_an_fmu_are_in_the_working_folder(foreign, begun, march, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    part = begun(FmuComponent(foreign(), "odd"), "write")
    march(part, 3)
    assert (tmp_path / "solver.log").read_text() == "0\n0.001\n0.002\n"
    part.finish()


@pytest.mark.repeated
def test_resources_are_found_in_paths_with_spaces_and_special_characters(kind, foreign, begun, tmp_path, monkeypatch):
    folder = tmp_path / "a folder, 100 % ü"
    folder.mkdir()
    monkeypatch.setattr("tempfile.tempdir", str(folder))
    part = begun(kind(foreign(), "odd"))
    assert part.get(("length",)) == [7.0]
    part.finish()


@pytest.mark.repeated
@pytest.mark.parametrize(
    ("listed", "sources"),
    [
        ("model.c", {"model": '#include "foreign_fmu.h"\n', "unused": "#error not listed\n"}),
        ("", {"all": '#include "foreign_fmu.h"\n', "part": "#error a part of all.c\n"}),
        ("", {"model": '#include "foreign_fmu.h"\n', "more": "double more(void) { return 1.0; }\n"}),
        ("model.c", {"model": '#define WITH_PREFIX\n#include "foreign_fmu.h"\n'}),
    ],
    ids=["listed", "all.c", "not listed", "names with a prefix"],
)
def test_sources_are_compiled_on_request_if_there_is_no_binary(
    listed, sources, source_fmu, begun, runs, tmp_path, monkeypatch, foreign_library
):
    monkeypatch.setenv("EIGHTPOST_CACHE", str(tmp_path / "cache"))
    path = source_fmu(listed=listed, **sources)
    with pytest.raises(
        FmuError, match=r"only for: none; it contains its sources.*--set compile=yes or compile_missing=True"
    ):
        FmuComponent(path, "odd")
    runs(begun(FmuComponent(path, "odd", compile_missing=True)))
    assert len(list((tmp_path / "cache" / "rebuilt").iterdir())) == 1


@pytest.mark.nightly
def test_a_damaged_library_in_the_cache_is_recompiled(
    source_fmu, begun, runs, tmp_path, monkeypatch, caplog, foreign_library
):
    monkeypatch.setenv("EIGHTPOST_CACHE", str(tmp_path / "cache"))
    path = source_fmu(listed="model.c", model='#include "foreign_fmu.h"\n')
    begun(FmuComponent(path, "odd", compile_missing=True)).finish()
    (kept,) = (tmp_path / "cache" / "rebuilt").iterdir()
    kept.write_bytes(kept.read_bytes()[:-100])
    again = shutil.copy(path, tmp_path / "again.fmu")
    runs(begun(FmuComponent(again, "odd", compile_missing=True)))
    assert "cached library is damaged and is compiled again" in caplog.text


def test_the_message_on_sources_that_do_not_compile_has_the_first_compiler_error(source_fmu, tmp_path, monkeypatch):
    monkeypatch.setenv("EIGHTPOST_CACHE", str(tmp_path / "cache"))
    path = source_fmu(listed="model.c", model="#error only for dSPACE\n")
    with pytest.raises(FmuError, match=r"sources do not compile with .*only for dSPACE.*ask for a binary"):
        FmuComponent(path, "odd", compile_missing=True)
    with pytest.raises(FmuError, match=r"lists the source 'gone.c', which is not in its sources/"):
        FmuComponent(source_fmu(listed="gone.c"), "odd", compile_missing=True)
