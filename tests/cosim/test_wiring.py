"""Invalid wiring is refused when a system is built, with the names and advice."""

import numpy as np
import pytest

from cosim import Bond, Connection, Scenario, System, UnitDefinition, Variable, run
from eightpost.signals import Drivefile, TimeSeries
from tests.unchanged import refusals


def drive(**channels):
    time = np.array([0.0, 1.0])
    return Drivefile(TimeSeries.from_channels(time, {n: (u, np.full(2, v)) for n, (u, v) in channels.items()}))


def test_two_sources_of_one_input_are_added_if_they_are_declared_as_a_sum(make):
    parts, both = {name: make.gain() for name in ("a", "b", "sum")}, [("a.y", "sum.u"), ("b.y", "sum.u", 10.0)]
    both = [Connection(*ends) for ends in both]
    system = System(parts, connections=both, sums={"sum.u"}, constants={"a.u": 3.0, "b.u": 4.0})
    result = run(system, Scenario(0.1, record=("sum.y",)), step=0.05)
    assert result.series["sum.y"].tolist() == [43.0] * 3


def test_units_of_one_dimension_are_converted(make):
    parts = {"a": make.gain(unit_out="mm/s"), "b": make.gain(unit_in="m/s")}
    system = System(parts, connections=[Connection("a.y", "b.u", -1.0)], constants={"a.u": 250.0})
    result = run(system, Scenario(0.1), step=0.1)
    assert result.series["b.y"].tolist() == pytest.approx([-0.25, -0.25])
    assert result.series["a.y"].tolist() == pytest.approx([0.25, 0.25])
    assert result.series.unit("a.y") == "m/s"


def test_units_are_converted_by_their_definition_not_by_their_name(make):
    parts = {"a": make.gain(), "b": make.gain()}
    odd = UnitDefinition("kilopond", {"kg": 1, "m": 1, "s": -2}, 9.80665)
    parts["a"].variables = make.table(make.variable("u", "input", "N"), Variable("y", "output", unit=odd))
    system = System(parts, connections=[Connection("a.y", "b.u")], constants={"a.u": 2.0})
    assert run(system, Scenario(0.1), step=0.1).series["b.y"][0] == pytest.approx(19.6133)


def test_an_undefined_unit_is_read_by_its_name(make):
    parts = {"a": make.gain(), "b": make.gain(unit_in="m/s")}
    parts["a"].variables = make.table(
        make.variable("u", "input", "N"), Variable("y", "output", unit=UnitDefinition("km/h", {"?": 1}))
    )
    system = System(parts, connections=[Connection("a.y", "b.u")], constants={"a.u": 36.0})
    assert run(system, Scenario(0.1), step=0.1).series["b.y"][0] == pytest.approx(10.0)


def test_a_variable_without_a_unit_is_used_unconverted_and_reported(make):
    parts = {"a": make.gain(), "b": make.gain()}
    parts["a"].variables = make.table(make.variable("u", "input", "N"), make.variable("y", "output", None))
    system = System(parts, connections=[Connection("a.y", "b.u")], constants={"a.u": 2.0})
    result = run(system, Scenario(0.1), step=0.1)
    assert result.series["b.y"][0] == 2.0
    assert any("no unit stated" in note and "a.y" in note for note in result.notes)


def test_drive_channels_go_to_the_only_input_of_their_name_or_to_their_target(make):
    result = run(System({"a": make.gain()}), Scenario(0.1, drive(u=("N", 5.0))), step=0.1)
    assert result.series["a.y"].tolist() == [5.0, 5.0]
    two = {"a": make.gain(), "b": make.gain()}
    sent = Scenario(0.1, drive(push=("N", 5.0)), {"push": "a.u"})
    assert run(System(two, constants={"b.u": 0.0}), sent, step=0.1).series["a.y"][-1] == 5.0


def test_two_bonds_at_one_port_must_be_declared_as_a_sum(make, unchanged):
    ports = make.table(
        make.variable("velocity", "output", "m/s"),
        make.variable("displacement", "output", "m"),
        make.variable("force", "input", "N"),
    )
    damper = make.table(make.variable("velocity", "input", "m/s"), make.variable("force", "output", "N", ["velocity"]))

    def parts():
        return {
            "car": make.component(ports, lambda *_: {"velocity": 2.0, "displacement": 0.0}),
            "shock": make.component(damper, lambda _, u: {"force": 100.0 * u["velocity"]}),
            "stop": make.component(damper, lambda _, u: {"force": 7.0 * u["velocity"]}),
        }

    bonds = [Bond.between("car", name, displacement=False, name=name) for name in ("shock", "stop")]
    twins = [Bond.between("car", name, displacement=False) for name in ("shock", "stop")]
    unchanged(refusals({"no sum": lambda: System(parts(), bonds),
                        "one name": lambda: System(parts(), twins, sums={"car.force"})}))  # fmt: skip
    system = System(parts(), bonds, sums={"car.force"})
    result = run(system, Scenario(0.2), step=0.1)
    assert system.components["car"].inputs["force"] == 214.0
    # Each bond reports its own energy: 100 and 7 N.s/m at 2 m/s for 0.2 s.
    assert result.energy["shock"].transferred == pytest.approx(80.0)
    assert result.energy["stop"].transferred == pytest.approx(5.6)
    assert [energy.residual for energy in result.energy.values()] == pytest.approx([0.0, 0.0], abs=1e-12)


def test_what_cannot_be_wired_or_run_is_refused_with_advice(make, fmus, unchanged):
    def pair(*ends, unit_in="N", **given):
        parts = {"a": make.gain(), "b": make.gain(unit_in=unit_in)}
        return System(parts, connections=[Connection(*ends)] if ends else [], **given)

    def corner(shock="polylinear", **given):
        bond = Bond.between("car", "shock", displacement="constants" not in given)
        return System.load({"car": fmus["quarter_car"], "shock": fmus[shock]}, [bond], **given)

    def ran(system, stop=0.1, step=None, **scenario):
        return run(system, Scenario(stop, **scenario), step=step)

    one, fed = System({"a": make.gain()}), System({"a": make.gain()}, constants={"a.u": 1.0})
    odd = make.component(make.table(Variable("y", "output", unit=UnitDefinition("furlong/fortnit", {"?": 1}))), None)
    text = make.component(make.table(Variable("label", "output", type="String")), lambda *_: {"label": "a"})
    push = drive(u=("N", 5.0))
    late = Drivefile(TimeSeries.from_channels(np.array([5.0, 9.0]), {"u": ("N", [5.0, 9.0])}))
    assert Scenario(4.0, late, drive_start=5.0).drive_start == 5.0
    calls = {
        "an unknown component": lambda: pair("c.y", "b.u"), "an unknown variable": lambda: pair("a.yy", "b.u"),
        "an output as the target": lambda: pair("a.y", "b.y"),
        "a connection and a constant": lambda: pair("a.y", "b.u", constants={"b.u": 1.0}),
        "two connections": lambda: System({"a": make.gain(), "b": make.gain()}, connections=[
            Connection("a.y", "b.u"), Connection("b.y", "b.u")]),
        "another dimension": lambda: pair("a.y", "b.u", unit_in="m/s"),
        "an unknown unit": lambda: System({"a": odd, "b": make.gain()}, connections=[Connection("a.y", "b.u")]),
        "a gain of zero": lambda: pair("a.y", "b.u", 0.0), "no gain": lambda: pair("a.y", "b.u", np.nan),
        "no source": lambda: ran(one), "a text to record": lambda: ran(System({"a": text}), record=("a.label",)),
        "two inputs of a channel's name": lambda: ran(pair(), drive=push),
        "no such channel": lambda: ran(one, drive=push, targets={"pull": "a.u"}),
        "a channel and a constant": lambda: ran(fed, drive=push),
        "a channel of another dimension": lambda: ran(one, drive=drive(u=("m", 5.0))),
        "a text for a Boolean": lambda: corner(parameters={"car": {"start_at_equilibrium": "false"}}),
        "a Boolean for a number": lambda: corner(parameters={"shock": {"motion_ratio": True}}),
        "out of its range": lambda: corner(parameters={"shock": {"motion_ratio": -1.0}}),
        "no number": lambda: corner(parameters={"shock": {"gas_stiffness": np.nan}}),
        "a gas spring that does not move": lambda: corner("lpnl2", constants={"shock.displacement": 0.0}),
        "a drive that begins later": lambda: Scenario(4.0, late),
        "a drive that ends earlier": lambda: Scenario(5.0, late, drive_start=5.0),
        "no time": lambda: Scenario(0.0), "no number as the stop": lambda: Scenario(np.nan),
        "a negative record step": lambda: Scenario(1.0, record_step=-1.0),
        "settling beyond the end": lambda: Scenario(1.0, settling=2.0),
        "no step": lambda: ran(fed, 1.0, 0.0), "a step beyond the end": lambda: ran(fed, 1.0, 2.0),
        "no number as the step": lambda: ran(fed, 1.0, np.nan),
        "records between the steps": lambda: ran(fed, 1.0, 0.1, record_step=0.25),
    }  # fmt: skip
    unchanged(refusals(calls))
