"""The master: step times, coupling values, equilibrium start, recording and reporting."""

import os
import signal
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from cosim import Bond, Capabilities, Connection, FmuComponent, GaussSeidel, Implicit, Jacobi, Scenario, System, run
from eightpost.errors import DivergedError, StepError, WiringError
from eightpost.signals import Drivefile, TimeSeries, read_series

from .mass_and_damper import restorable_parts


def ramp(slope=10.0, stop=10.0):
    time = np.array([0.0, stop])
    return Drivefile(TimeSeries.from_channels(time, {"u": ("N", slope * time)}))


def steps_of(component):
    return [entry for entry in component.log if len(entry) == 4]


def test_a_held_input_has_the_mean_of_the_drive_over_the_step(make):
    part = make.integrator()
    run(System({"a": part}), Scenario(1.0, ramp()), step=0.25, compared=False)
    assert [entry[2]["u"] for entry in steps_of(part)] == pytest.approx([1.25, 3.75, 6.25, 8.75])
    assert part.state == pytest.approx(5.0)


def test_gauss_seidel_orders_components_by_dependency_not_by_declaration(make):
    parts = {"late": make.gain(unit_in="m/s"), "early": make.integrator()}
    system = System(parts, connections=[Connection("early.y", "late.u"), Connection("late.y", "early.u")])
    assert run(system, Scenario(0.1), step=0.1).order == ("early", "late")


def test_a_given_sequence_is_used_and_must_contain_every_component(make):
    def pair():
        return System({"a": make.gain(), "b": make.gain()}, constants={"a.u": 0.0, "b.u": 0.0})

    assert run(pair(), Scenario(0.1), algorithm=GaussSeidel(("b", "a")), step=0.1).order == ("b", "a")
    with pytest.raises(WiringError, match="every component once"):
        run(pair(), Scenario(0.1), algorithm=GaussSeidel(("a",)))


def test_a_feedthrough_loop_is_reported(make):
    parts = {"a": make.gain(0.5), "b": make.gain(0.5)}
    system = System(parts, connections=[Connection("a.y", "b.u"), Connection("b.y", "a.u")])
    assert any("form a loop" in note for note in run(system, Scenario(0.1), step=0.1).notes)


def bonded(make, gain=1.0):
    """A mass of 2 kg at 3 m/s against a damper of 4 N.s/m; the mass holds the force over a step."""
    ports = make.table(make.variable("velocity", "output", "m/s"), make.variable("force", "input", "N"))
    damper = make.table(make.variable("velocity", "input", "m/s"), make.variable("force", "output", "N", ["velocity"]))
    mass = make.component(ports, lambda v, _: {"velocity": v}, lambda v, u, _, h: v - u["force"] / 2.0 * h, state=3.0)
    shock = make.component(damper, lambda _, u: {"force": 4.0 * u["velocity"]})
    return System({"mass": mass, "shock": shock}, [Bond.between("mass", "shock", gain=gain, displacement=False)])


@pytest.mark.parametrize("gain", [1.0, -1.0])
def test_bond_energy_matches_the_lost_kinetic_energy_and_its_residual_falls_with_the_step(make, gain):
    residuals = []
    for step in (0.02, 0.01, 0.005):
        result = run(bonded(make, gain), Scenario(1.0), step=step)
        energy = result.energy["mass"]
        lost = 0.5 * 2.0 * (3.0**2 - result.series["mass.velocity"][-1] ** 2)
        assert energy.transferred == pytest.approx(lost, rel=3.0 * step)
        residuals.append(abs(energy.residual))
    assert residuals[0] > residuals[1] > residuals[2] > 0.0
    assert residuals[2] / residuals[0] == pytest.approx(0.25, rel=0.1)


def test_component_warnings_are_in_the_notes(make):
    part = make.integrator()
    part.messages = ("the ratio looks inverted",)
    result = run(System({"a": part}, constants={"a.u": 1.0}), Scenario(1.0), step=0.5)
    assert "a: the ratio looks inverted" in result.notes


def test_a_run_that_needs_a_shorter_step_of_a_fixed_step_component_is_refused(make):
    fixed = Capabilities(variable_step=False)
    system = System({"a": make.integrator(capabilities=fixed)}, constants={"a.u": 1.0})
    with pytest.raises(WiringError, match="a accepts steps of one size only"):
        run(system, Scenario(1.0), step=0.3)
    assert run(system, Scenario(0.9), step=0.3).steps == 3


def test_ctrl_c_ends_a_run_between_two_steps_and_finishes_every_component(make):
    part = make.integrator()

    def press(_state, _start, _end, _step):
        os.kill(os.getpid(), signal.SIGINT)
        part.log.append(("after the signal",))
        return 0.0

    part.advance = press
    with pytest.raises(KeyboardInterrupt):
        run(System({"a": part}, constants={"a.u": 1.0}), Scenario(1.0), step=0.1)
    assert ("after the signal",) in part.log
    assert len(steps_of(part)) == 1
    assert part.log[-1] == ("finished",)


def test_all_components_are_finished_if_one_fails(make):
    parts = {"a": make.integrator(), "b": make.integrator(fails_at=0.5)}
    with pytest.raises(StepError, match=r"failed at 0\.5"):
        run(System(parts, constants={"a.u": 0.0, "b.u": 0.0}), Scenario(1.0), step=0.25)
    assert all(part.log[-1] == ("finished",) for part in parts.values())


def test_the_written_series_of_a_result_are_read_back(make, tmp_path):
    result = run(System({"a": make.integrator()}, constants={"a.u": 1.0}), Scenario(1.0), step=0.1)
    for path in result.write(tmp_path)[:2]:
        assert read_series(path)["a.y"].tolist() == pytest.approx(result.series["a.y"].tolist())


# ==== The error of a component that refuses a step states the inputs that it had =====================================


@pytest.mark.parametrize("engine", ["python", "compiled"])
@pytest.mark.parametrize("algorithm", [
    Jacobi(values="held"), GaussSeidel(values="parabolic"), Implicit(),
], ids=["jacobi, held", "gauss-seidel, parabolic", "implicit"])  # fmt: skip
@pytest.mark.parametrize("ramps", [False, True], ids=["held inputs", "ramped inputs"])
def test_the_inputs_in_an_error_are_those_that_the_component_was_given(
    make: Any, ramps: bool, algorithm: Any, engine: str
) -> None:
    reported = {}

    def refused(what: str, status: int, time: float, inputs: dict[str, float]) -> StepError:
        reported.update(inputs)
        return StepError(f"refused to {what}")

    parts = restorable_parts(make)()
    shock = parts["shock"]
    shock.capabilities = replace(shock.capabilities, interpolates_inputs=ramps)
    shock.longest, shock.refused = 0.015, refused
    system = System(parts, [Bond.between("car", "shock", displacement=False)])
    with pytest.raises(StepError, match="refused to step"):
        run(system, Scenario(0.1), algorithm=algorithm, step=0.02, engine=engine)
    assert reported == shock.inputs
    assert reported["velocity"] != 0.0


# ==== Only a diverging coupling is retried, never a component that failed ============================================

SCALES = ("compression_scale", "rebound_scale")


@pytest.mark.parametrize("options", [{}, {"step": 0.01}], ids=["default", "given step"])
def test_a_component_error_that_mentions_divergence_is_not_treated_as_a_diverged_coupling(make, options):
    def advance(v, start, end, step):
        raise StepError("the solver inside this component diverged")

    ports = make.table(make.variable("velocity", "output", "m/s"), make.variable("force", "input", "N"))
    damper = make.table(make.variable("velocity", "input", "m/s"), make.variable("force", "output", "N", ["velocity"]))
    ramps = Capabilities(interpolates_inputs=True, state=True)
    mass = make.component(ports, lambda v, _: {"velocity": v}, advance, capabilities=ramps)
    shock = make.component(damper, lambda _, u: {"force": 4.0 * u["velocity"]}, capabilities=ramps)
    system = System({"mass": mass, "shock": shock}, [Bond.between("mass", "shock", displacement=False)])
    with pytest.raises(StepError, match="the solver inside") as raised:
        run(system, Scenario(0.1), **options)
    assert not isinstance(raised.value, DivergedError)
    assert sum(entry == ("started",) for entry in mass.log) == 1


@pytest.mark.nightly
def test_a_vehicle_that_refuses_a_step_of_a_diverging_coupling_is_retried(fmus):
    """Its port spring grows with the square of the displacement, so that it refuses before signals are at the limit."""
    components = {
        name: FmuComponent(fmus[fmu], name) for name, fmu in {"car": "quarter_car", "shock": "polylinear"}.items()
    }
    time = np.arange(0.0, 0.6, 0.01)
    road = 0.01 * np.sin(12.0 * time) + 0.003 * np.sin(70.0 * time)
    scenario = Scenario(0.5, Drivefile(TimeSeries.from_channels(time, {"road": ("m", road)})), {"road": "car.road"})
    for scale in np.linspace(6.0, 16.0, 11):
        shock = dict.fromkeys(SCALES, float(scale))
        parameters = {"car": {"port_spring": 4e5, "bristle_force": 100.0}, "shock": shock}
        bonds = [Bond.between("car", "shock")]
        system = System(components, bonds, constants={"car.aero_force": 0.0}, parameters=parameters)
        with pytest.raises(DivergedError, match="the coupling diverged"):
            run(system, scenario, step=2e-3, algorithm=GaussSeidel(values="parabolic"))
        assert np.abs(run(system, scenario).series["car.displacement"]).max() < 0.02
