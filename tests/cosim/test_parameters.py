"""Parameters of one run: equal to a fresh system with these values, and gone after the run."""

import time
from functools import partial

import numpy as np
import pytest

from cosim import Bond, Connection, FmuComponent, Scenario, System, Variable, run
from cosim.session.parameter_sweep import sweep_parameters
from tests.unchanged import refusals

#: A step at which a short run takes milliseconds.
STEP = 1e-3


def fresh(fmus, **values) -> System:
    """Return a quarter car with newly loaded FMUs, and values of the shock's parameters."""
    components = {"car": FmuComponent(fmus["quarter_car"], "car"), "shock": FmuComponent(fmus["lpnl2"], "shock")}
    return System(components, [Bond.between("car", "shock")], constants={"car.aero_force": 0.0},
                  parameters={"shock": values})  # fmt: skip


def same(first, second) -> bool:
    return first.series.values.tobytes() == second.series.values.tobytes()


@pytest.fixture(scope="session")
def loaded(fmus):
    return fresh(fmus)


@pytest.fixture(scope="session")
def scenario(bumps) -> Scenario:
    return Scenario(0.3, bumps, {"a": "car.road"})


def test_after_the_run_the_system_is_as_before(loaded, scenario):
    before = run(loaded, scenario, step=STEP)
    stiff = run(loaded, scenario, step=STEP, parameters={"shock.compression_scale": 2.0})
    after = run(loaded, scenario, step=STEP)
    assert not same(before, stiff)
    assert same(before, after)
    assert loaded.parameters == {"shock": {}}


def test_parameters_of_the_run_replace_those_of_the_system_one_by_one(fmus, scenario):
    system = fresh(fmus, compression_scale=0.5, rebound_scale=0.5)
    one = run(system, scenario, step=STEP, compared=False, parameters={"shock.rebound_scale": 1.5})
    assert one.parameters["shock"] == {"compression_scale": 0.5, "rebound_scale": 1.5}
    assert same(one, run(fresh(fmus, compression_scale=0.5, rebound_scale=1.5), scenario, step=STEP, compared=False))


def test_python_components_get_them_too(make):
    def gain(**options):
        ports = make.table(
            make.variable("u", "input", "N"),
            make.variable("y", "output", "N", ["u"]),
            Variable("k", "parameter", start=1.0, variability="tunable"),
        )
        part = make.component(ports, lambda _, u: {"y": part.parameters.get("k", 1.0) * u["u"]}, **options)
        return part

    system = System({"a": gain()}, constants={"a.u": 3.0})
    assert run(system, Scenario(0.1), step=0.1, parameters={"a.k": 4.0})["a.y"].tolist() == [12.0, 12.0]
    assert run(system, Scenario(0.1), step=0.1)["a.y"].tolist() == [3.0, 3.0]


def test_a_value_may_have_another_unit_and_be_a_number_of_numpy(loaded):
    changed = loaded.with_parameters({"shock.gas_preload": "30 lbf", "shock.rebound_scale": np.float64(1.5)})
    assert changed.parameters["shock"]["gas_preload"] == pytest.approx(133.447, rel=1e-5)
    assert changed.components is loaded.components


def test_a_sweep_is_a_run_for_each_combination(loaded, scenario):
    scales = {"shock.compression_scale": [0.5, 1.0], "shock.rebound_scale": [1.0, 2.0]}
    swept = sweep_parameters(loaded, scenario, scales, step=STEP, compared=False)
    table = swept.to_pandas("maximum")
    assert table["shock.compression_scale"].tolist() == [0.5, 0.5, 1.0, 1.0]
    assert table["shock.rebound_scale"].tolist() == [1.0, 2.0, 1.0, 2.0]
    for row, point in enumerate(swept.points):
        alone = run(loaded, scenario, parameters=point, step=STEP, compared=False)
        assert same(swept.results[row], alone)
        assert table["shock.force"][row] == alone["shock.force"].max()
    named = swept.to_xarray()["shock.force"].sel(run=3)
    assert (named.to_numpy() == swept.results[3]["shock.force"]).all()
    change = (table.max() - table.min()).drop(list(scales))
    units = table.attrs["units"]
    largest = {name: max(table[other].abs().max() for other in change.index if units[other] == units[name])
               for name in change.index}  # fmt: skip
    shown = swept.plot(statistic="maximum").figure.axes[0].get_ylabel().split(",")[0]
    assert shown == max(change.index, key=lambda name: change[name] / largest[name])  # the one that changes most


def test_a_slow_run_reports_often_and_the_amount_done_never_decreases(make):
    part = make.integrator()
    step = part.step
    part.step = lambda *arguments: (time.sleep(1e-3), step(*arguments))
    calls = []
    began = time.perf_counter()
    run(
        System({"a": part}, constants={"a.u": 1.0}),
        Scenario(0.5),
        step=1e-3,
        progress=lambda *amounts: calls.append(amounts),
    )
    seconds = time.perf_counter() - began
    assert len(calls) >= 10.0 * seconds
    assert [done for done, _ in calls] == sorted(done for done, _ in calls)
    assert [total for _, total in calls] == sorted(total for _, total in calls)
    assert calls[-1][0] == pytest.approx(calls[-1][1])


def test_a_system_is_loaded_with_short_forms(fmus):
    plain = System.load({"car": fmus["quarter_car"], "shock": fmus["lpnl2"]}, [Bond.between("car", "shock")],
                        parameters={"shock": {"rebound_scale": 1.5}})  # fmt: skip
    short = System.load({"car": str(fmus["quarter_car"]), "shock": fmus["lpnl2"]}, bonds=[("car", "shock")],
                        parameters={"shock.rebound_scale": 1.5})  # fmt: skip
    assert short.bonds == plain.bonds
    assert short.parameters == plain.parameters


def test_a_result_states_itself_in_ten_lines(loaded, scenario):
    result = run(loaded, scenario, step=STEP)
    assert len(repr(result).splitlines()) <= 10
    assert len(repr(result)) < 1000
    assert result.verdict.headline in repr(result)
    assert "<table>" in result._repr_html_()
    for one in (loaded, scenario, result.series):
        assert len(repr(one).splitlines()) <= 10


def test_a_result_becomes_tables_and_a_picture(loaded, scenario):
    result = run(loaded, scenario, step=STEP)
    table = result.to_pandas()
    assert table.index.name == "time"
    assert (table["shock.force"].to_numpy() == result["shock.force"]).all()
    assert table.attrs["units"]["shock.force"] == "N"
    table.loc[0.0, "shock.force"] = 1e9  # a copy: the result does not change
    assert result["shock.force"][0] != 1e9
    labelled = result.to_xarray()
    assert labelled["shock.force"].attrs["units"] == "N"
    assert labelled.attrs["verdict"] == result.verdict.grade.value
    assert result.plot("shock.force", stop=0.2)._repr_png_().startswith(b"\x89PNG")


def test_a_wrong_parameter_sweep_or_system_is_an_error_of_the_call(loaded, scenario, unchanged):
    values = [
        {"shock.compresion_scale": 1.0}, {"shok.compression_scale": 1.0}, {"shock": {"compression_scale": 1.0}},
        {"shock.velocity": 1.0}, {"shock.compression_scale": -1.0}, {"shock.gas_preload": "30 mm"},
        {"shock.gas_preload": None},
    ]  # fmt: skip
    points = [{"shock.rebound_scale": []}, {"shock.rebound_scale": 2.0}, [{}]]
    systems = [
        {"fmus": "car.fmu"}, {"fmus": {"car": 5}}, {"fmus": {}, "bonds": Bond.between("car", "lf")},
        {"fmus": {}, "bonds": [("car.lf", "lf", 1.0)]}, {"fmus": {}, "bonds": [Connection("a.y", "b.u")]},
    ]  # fmt: skip
    calls = {str(one): partial(run, loaded, scenario, parameters=one) for one in values}
    calls |= {str(one): partial(sweep_parameters, loaded, scenario, one) for one in points}
    unchanged(refusals(calls | {f"system {k}": partial(System.load, **one) for k, one in enumerate(systems)}))
