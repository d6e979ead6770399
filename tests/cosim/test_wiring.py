"""Invalid wiring is refused when a system is built, with the names and advice."""

import numpy as np
import pytest

from cosim import Bond, Connection, Scenario, System, UnitDefinition, Variable, run
from eightpost.errors import InputError, WiringError
from eightpost.signals import Drivefile, TimeSeries


def drive(**channels):
    time = np.array([0.0, 1.0])
    return Drivefile(TimeSeries.from_channels(time, {n: (u, np.full(2, v)) for n, (u, v) in channels.items()}))


def test_an_unknown_component_or_variable_is_reported_with_a_suggestion(make):
    parts = {"a": make.gain(), "b": make.gain()}
    with pytest.raises(WiringError, match=r"there is no component 'c'"):
        System(parts, connections=[Connection("c.y", "b.u")])
    with pytest.raises(WiringError, match=r"no variable 'yy'; did you mean y\?"):
        System(parts, connections=[Connection("a.yy", "b.u")])
    with pytest.raises(WiringError, match="not an input for numbers"):
        System(parts, connections=[Connection("a.y", "b.y")])


def test_two_sources_of_one_input_are_an_error_unless_declared_as_a_sum(make):
    def parts():
        return {"a": make.gain(), "b": make.gain(), "sum": make.gain()}

    both = [Connection("a.y", "sum.u"), Connection("b.y", "sum.u", 10.0)]
    with pytest.raises(WiringError, match=r"sum\.u has 2 sources \(a\.y, b\.y\).*sums"):
        System(parts(), connections=both)
    system = System(parts(), connections=both, sums={"sum.u"}, constants={"a.u": 3.0, "b.u": 4.0})
    result = run(system, Scenario(0.1, record=("sum.y",)), step=0.05)
    assert result.series["sum.y"].tolist() == [43.0] * 3


def test_a_constant_for_a_connected_input_is_a_second_source(make):
    parts = {"a": make.gain(), "b": make.gain()}
    with pytest.raises(WiringError, match=r"b\.u has 2 sources"):
        System(parts, connections=[Connection("a.y", "b.u")], constants={"b.u": 1.0})


def test_units_of_different_dimensions_are_refused_and_other_units_are_converted(make):
    parts = {"a": make.gain(unit_out="mm/s"), "b": make.gain(unit_in="m/s")}
    system = System(parts, connections=[Connection("a.y", "b.u", -1.0)], constants={"a.u": 250.0})
    result = run(system, Scenario(0.1), step=0.1)
    assert result.series["b.y"].tolist() == pytest.approx([-0.25, -0.25])
    assert result.series["a.y"].tolist() == pytest.approx([0.25, 0.25])
    assert result.series.unit("a.y") == "m/s"
    with pytest.raises(WiringError, match=r"a\.y -> b\.u: cannot connect \[N\] to \[m/s\]"):
        System({"a": make.gain(), "b": make.gain(unit_in="m/s")}, connections=[Connection("a.y", "b.u")])


def test_units_are_converted_by_their_definition_not_by_their_name(make):
    parts = {"a": make.gain(), "b": make.gain()}
    odd = UnitDefinition("kilopond", {"kg": 1, "m": 1, "s": -2}, 9.80665)
    parts["a"].variables = make.table(make.variable("u", "input", "N"), Variable("y", "output", unit=odd))
    system = System(parts, connections=[Connection("a.y", "b.u")], constants={"a.u": 2.0})
    assert run(system, Scenario(0.1), step=0.1).series["b.y"][0] == pytest.approx(19.6133)


def test_an_undefined_unit_is_read_by_its_name_or_refused(make):
    parts = {"a": make.gain(), "b": make.gain(unit_in="m/s")}
    parts["a"].variables = make.table(
        make.variable("u", "input", "N"), Variable("y", "output", unit=UnitDefinition("km/h", {"?": 1}))
    )
    system = System(parts, connections=[Connection("a.y", "b.u")], constants={"a.u": 36.0})
    assert run(system, Scenario(0.1), step=0.1).series["b.y"][0] == pytest.approx(10.0)
    parts["a"].variables = make.table(Variable("y", "output", unit=UnitDefinition("furlong/fortnit", {"?": 1})))
    with pytest.raises(WiringError, match="furlong"):
        System(parts, connections=[Connection("a.y", "b.u")])


def test_a_variable_without_a_unit_is_used_unconverted_and_reported(make):
    parts = {"a": make.gain(), "b": make.gain()}
    parts["a"].variables = make.table(make.variable("u", "input", "N"), make.variable("y", "output", None))
    system = System(parts, connections=[Connection("a.y", "b.u")], constants={"a.u": 2.0})
    result = run(system, Scenario(0.1), step=0.1)
    assert result.series["b.y"][0] == 2.0
    assert any("no unit stated" in note and "a.y" in note for note in result.notes)


def test_an_input_without_a_source_is_an_error(make):
    with pytest.raises(WiringError, match=r"a\.u is an input without a source"):
        run(System({"a": make.gain()}), Scenario(0.1))


def test_drive_channels_go_to_the_only_input_of_their_name_or_to_their_target(make):
    result = run(System({"a": make.gain()}), Scenario(0.1, drive(u=("N", 5.0))), step=0.1)
    assert result.series["a.y"].tolist() == [5.0, 5.0]
    two = {"a": make.gain(), "b": make.gain()}
    with pytest.raises(WiringError, match=r"'u' matches a\.u and b\.u"):
        run(System(two, constants={"b.u": 0.0}), Scenario(0.1, drive(u=("N", 5.0))))
    sent = Scenario(0.1, drive(push=("N", 5.0)), {"push": "a.u"})
    assert run(System(two, constants={"b.u": 0.0}), sent, step=0.1).series["a.y"][-1] == 5.0
    with pytest.raises(WiringError, match=r"no channel 'pull'"):
        run(System({"a": make.gain()}), Scenario(0.1, drive(push=("N", 5.0)), {"pull": "a.u"}))


def test_a_driven_input_with_another_source_or_another_dimension_is_refused(make):
    with pytest.raises(WiringError, match=r"a\.u has two sources"):
        run(System({"a": make.gain()}, constants={"a.u": 1.0}), Scenario(0.1, drive(u=("N", 5.0))))
    with pytest.raises(WiringError, match="dimensions differ"):
        run(System({"a": make.gain()}), Scenario(0.1, drive(u=("m", 5.0))))


def test_two_bonds_at_one_port_must_be_declared_as_a_sum(make):
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
    with pytest.raises(WiringError, match=r"car\.force has 2 sources"):
        System(parts(), bonds)
    with pytest.raises(WiringError, match="two bonds are named 'car'"):
        twins = [Bond.between("car", name, displacement=False) for name in ("shock", "stop")]
        System(parts(), twins, sums={"car.force"})
    system = System(parts(), bonds, sums={"car.force"})
    result = run(system, Scenario(0.2), step=0.1)
    assert system.components["car"].inputs["force"] == 214.0
    # Each bond reports its own energy: 100 and 7 N.s/m at 2 m/s for 0.2 s.
    assert result.energy["shock"].transferred == pytest.approx(80.0)
    assert result.energy["stop"].transferred == pytest.approx(5.6)
    assert [energy.residual for energy in result.energy.values()] == pytest.approx([0.0, 0.0], abs=1e-12)


@pytest.mark.parametrize(("values", "message"), [
    ({"start_at_equilibrium": "false"}, "takes no str"), ({"motion_ratio": True}, "takes no bool"),
    ({"motion_ratio": -1.0}, "outside its range, 0.001 to 10"), ({"gas_stiffness": float("nan")}, "outside its range"),
])  # fmt: skip
def test_a_parameter_of_the_wrong_type_or_out_of_its_range_is_refused(fmus, values, message):
    name = "car" if "start_at_equilibrium" in values else "shock"
    with pytest.raises(WiringError, match=message):
        System.load(
            {"car": fmus["quarter_car"], "shock": fmus["polylinear"]},
            [Bond.between("car", "shock")],
            parameters={name: values},
        )


def test_a_variable_that_is_not_numeric_cannot_be_recorded(make):
    text = Variable("label", "output", type="String")
    part = make.component(make.table(text), lambda *_: {"label": "a"})
    with pytest.raises(WiringError, match=r"a\.label is a String and cannot be recorded"):
        run(System({"a": part}), Scenario(0.1, record=("a.label",)))


def test_a_drive_must_cover_the_run_from_the_given_drive_start():
    time = np.array([5.0, 9.0])
    late = Drivefile(TimeSeries.from_channels(time, {"u": ("N", [5.0, 9.0])}))
    with pytest.raises(InputError, match=r"0 to 4 s of the drive file, it holds 5 to 9 s"):
        Scenario(4.0, late)
    with pytest.raises(InputError, match="drive_start"):
        Scenario(5.0, late, drive_start=5.0)
    assert Scenario(4.0, late, drive_start=5.0).drive_start == 5.0


def test_a_gas_spring_with_a_constant_displacement_is_refused(fmus):
    with pytest.raises(WiringError, match=r"gas spring.*is a constant"):
        System.load(
            {"car": fmus["quarter_car"], "shock": fmus["lpnl2"]},
            [Bond.between("car", "shock", displacement=False)],
            constants={"shock.displacement": 0.0},
        )


@pytest.mark.parametrize("gain", [0.0, float("nan")])
def test_a_gain_of_zero_or_nan_is_refused(make, gain):
    with pytest.raises(WiringError, match="gain"):
        System({"a": make.gain(), "b": make.gain()}, connections=[Connection("a.y", "b.u", gain)])


@pytest.mark.parametrize(
    "options",
    [{"stop": 0.0}, {"stop": float("nan")}, {"stop": 1.0, "record_step": -1.0}, {"stop": 1.0, "settling": 2.0}],
)
def test_an_invalid_scenario_is_refused(options):
    with pytest.raises(InputError, match="scenario"):
        Scenario(**options)


@pytest.mark.parametrize(("step", "record"), [(0.0, None), (2.0, None), (float("nan"), None), (0.1, 0.25)])
def test_an_invalid_step_is_refused(make, step, record):
    system = System({"a": make.gain()}, constants={"a.u": 1.0})
    with pytest.raises(InputError, match="step"):
        run(system, Scenario(1.0, record_step=record), step=step)
