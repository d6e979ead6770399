"""FMI 3.0 FMUs of any maker are coupled as FMI 2.0 ones are: same bits compiled and interpreted, ramps, states, faults.

The FMU is x' = u + f - x with inputs that change linearly over each step, which it computes exactly.
"""

import ctypes

import numpy as np
import pytest
from fmpy.fmi1 import FMICallException

from cosim import Adaptive, Connection, FmuComponent, ForceLaw, GaussSeidel, Implicit, Jacobi, Scenario, System, run
from cosim.components.fmu_component import loaded
from cosim.components.fmu_file import FmuFile
from cosim.components.watch import FmuLog
from eightpost.errors import StepError, WiringError
from eightpost.signals import Drivefile

from . import lag_fmus

STEP, STOP = 0.01, 0.6


@pytest.fixture
def lag(three):
    """Return the FMI 3.0 FMU as a component in this process."""
    part = FmuComponent(three, "lag")
    yield part
    part.finish()


# ---- Values -------------------------------------------------------------------------------------------------------


def test_an_output_depends_on_what_its_description_states_and_on_everything_without_a_statement(lag):
    direct = {name: variable.direct for name, variable in lag.variables.items() if variable.causality == "output"}
    assert direct["y"] == direct["y again"] == {"u"}
    assert direct["v[2]"] == {"w[1]", "w[2]"}
    assert direct["x"] == frozenset()
    assert direct["seen"] == {"u", "w[1]", "w[2]", "f", "gear", "flag", "raw"}


@pytest.mark.repeated
def test_values_of_every_type_are_set_and_read(three, kind):
    part = lag_fmus.begun(kind(three, "lag"), **{"m[2,1]": 7.0, "m[1,2]": 9.0})
    part.set(("u", "w[2]", "gear", "flag", "f"), (1.5, 8.0, 3.0, 1.0, 0.1))
    names = ("seen", "y again", "w[1]", "w[2]", "f", "sum", "u")
    assert part.get(names) == [31.0, 1.5, 1.0, 8.0, float(np.float32(0.1)), 1.0 + 90.0 + 700.0 + 4000.0, 1.5]
    part.finish()


def test_one_element_of_an_array_is_set_without_changing_the_others(lag):
    lag_fmus.begun(lag).set(("w[1]",), (-3.0,))
    assert lag.get(("w[2]", "w[1]")) == [2.0, -3.0]
    before = lag.save()
    lag.set(("w[1]", "w[2]"), (5.0, 6.0))
    lag.restore(before)
    lag.set(("w[2]",), (8.0,))
    assert lag.get(("w[1]", "w[2]")) == [-3.0, 8.0]


def test_a_new_run_begins_with_the_start_values(lag):
    lag_fmus.begun(lag).set(("w[1]", "u"), (-3.0, 4.0))
    lag.step(0.0, STEP)
    lag.finish()
    lag_fmus.begun(lag).set(("w[2]",), (8.0,))
    assert lag.get(("w[1]", "w[2]", "u", "x")) == [1.0, 8.0, 0.0, 0.0]


def test_a_binary_variable_is_listed_but_takes_no_value(three):
    parts = {"lag": FmuComponent(three, "lag")}
    assert parts["lag"].variables["raw"].type == "Binary"
    with pytest.raises(WiringError, match=r"lag\.raw = 'ab': it is a Binary variable and takes no str"):
        System(parts, parameters={"lag": {"raw": "ab"}}, constants={"lag.u": 0.0})


def test_a_structural_parameter_keeps_its_start_value(lag):
    lag_fmus.begun(lag, count=2).finish()
    with pytest.raises(StepError, match=r"fmi3SetUInt64 returned fmi3Error.*count = 3: it is a structural parameter"):
        lag.begin(0.0, 1.0, {"count": 3})


def test_an_integer_beyond_32_bits_is_refused_and_not_wrapped(lag):
    lag_fmus.begun(lag).set(("gear",), (30.0,))
    assert lag.get(("big",)) == [2.0**30]
    with pytest.raises(StepError, match="the integer 4294967295 does not fit into 32 bits"):
        lag.set(("gear",), (2.0**32 - 1.0,))
    lag.set(("gear",), (40.0,))
    with pytest.raises(StepError, match=r"fmi3GetInt64 returned fmi3Error.*big = 1099511627776 does not fit"):
        lag.get(("big",))


def test_directional_derivatives_are_those_of_scalars_and_refused_for_arrays(lag):
    lag_fmus.begun(lag)
    assert lag.derive(("y",), ("u",), (11.0,)) == [33.0]
    for unknowns in (("v[2]",), ("y",) * 100):
        with pytest.raises(StepError, match="fmi3GetDirectionalDerivative returned fmi3Error"):
            lag.derive(unknowns, ("u",), (11.0,))
    assert not lag.capabilities.derivatives


# ---- Steps --------------------------------------------------------------------------------------------------------


@pytest.mark.repeated(2)
@pytest.mark.parametrize("manner", ["", "halves"])
def test_ramps_by_intermediate_update_give_the_closed_form(three, kind, manner):
    part, x = lag_fmus.begun(kind(three, "lag"), manner=manner), 0.0
    for k in range(5):
        start, slope, h = 3.0 * k, 20.0 - k, 0.05 + 0.01 * k
        part.set(("u", "w[1]", "w[2]"), (start, 2.0, 3.0))
        part.set_derivatives(("u", "w[2]"), (slope, 10.0))
        before = part.get(("v[2]", "v[1]"))
        part.step(0.1 * k, h)
        x = lag_fmus.exact(x, h, start, slope)
        # The second element of w rises from 3 by 10 h, the first one is held.
        moved = np.subtract(part.get(("v[2]", "v[1]")), before)
        np.testing.assert_allclose(moved, [3.0 * h + 5.0 * h * h, 2.0 * h], rtol=1e-12)
        assert part.get(("x",)) == pytest.approx([x], rel=1e-12)
        assert part.get(("u", "w[2]")) == pytest.approx([start + slope * h, 3.0 + 10.0 * h], rel=1e-14)
    assert part.get(("required",)) == [3.0]
    part.finish()


def test_a_slope_applies_to_one_step_and_held_inputs_stay_constant(lag):
    lag_fmus.begun(lag).set(("u",), (2.0,))
    lag.step(0.0, 0.1)
    assert lag.get(("x", "u")) == pytest.approx([lag_fmus.exact(0.0, 0.1, 2.0, 0.0), 2.0], rel=1e-14)
    lag.set_derivatives(("u",), (5.0,))
    lag.step(0.1, 0.1)
    x, u = lag.get(("x", "u"))
    lag.step(0.2, 0.1)
    assert u == 2.5
    assert lag.get(("x", "u")) == pytest.approx([lag_fmus.exact(x, 0.1, 2.5, 0.0), 2.5], rel=1e-14)


def test_an_update_without_a_request_changes_no_input(lag):
    lag_fmus.begun(lag, manner="look").set(("u",), (2.0,))
    lag.set_derivatives(("u",), (5.0,))
    lag.step(0.0, 0.1)
    # The inputs are held over the step and have their end values after it.
    assert lag.get(("x", "u")) == pytest.approx([lag_fmus.exact(0.0, 0.1, 2.0, 0.0), 2.5], rel=1e-14)


def test_inputs_that_the_fmu_does_not_let_change_within_a_step_are_held(build, tmp_path):
    held = FmuComponent(lag_fmus.write_three(tmp_path / "held.fmu", build("-DNO_UPDATE"), ramps=False), "held")
    assert not held.capabilities.interpolates_inputs
    lag_fmus.begun(held).set(("u",), (2.0,))
    held.step(0.0, 0.1)
    assert held.get(("x",)) == pytest.approx([lag_fmus.exact(0.0, 0.1, 2.0, 0.0)], rel=1e-14)
    held.finish()


@pytest.mark.repeated
def test_a_restored_state_gives_the_same_bits_and_drops_slopes_of_the_undone_step(three, kind):
    part = lag_fmus.begun(kind(three, "lag"))
    part.set(("u", "w[1]"), (1.0, 4.0))
    part.step(0.0, 0.1)
    before, readings = part.save(), []
    for _ in range(2):
        part.set_derivatives(("u", "w[2]"), (3.0, 9.0))
        part.step(0.1, 0.1)
        part.set_derivatives(("u",), (-70.0,))
        readings.append(part.get(("x", "y", "v[1]", "v[2]", "s")))
        part.restore(before)
    part.step(0.1, 0.1)
    assert readings[0] == readings[1] != part.get(("x", "y", "v[1]", "v[2]", "s"))
    assert part.get(("x",)) == pytest.approx([lag_fmus.exact(0.0, 0.2, 1.0, 0.0)], rel=1e-14)
    part.finish()


# ---- Coupled ------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def two(build, tmp_path_factory):
    """Return the FMI 2.0 FMU with the same equations."""
    return lag_fmus.write_two(tmp_path_factory.mktemp("two") / "lag2.fmu", build("-DFMI=2"))


@pytest.fixture(scope="module")
def road(tmp_path_factory):
    path = tmp_path_factory.mktemp("road") / "drive.csv"
    times = np.arange(0.0, STOP + 0.1, STEP)
    rows = "".join(f"{t:.6g},{0.2 * np.sin(9.0 * t):.9g}\n" for t in times)
    path.write_text("time [s],speed [m/s]\n" + rows)
    return Drivefile.read(path)


def chained(first, second, road, **options):
    """Run two lags one behind the other: the drive feeds the first one."""
    free = {
        f"{name}.{v.name}": float(v.start)
        for name, part in (("a", first), ("b", second))
        for v in part.variables.values()
        if v.causality == "input" and v.type == "Real" and v.name not in ("u",)
    }
    system = System({"a": first, "b": second}, connections=(Connection("a.y", "b.u", 0.5),), constants=free)
    scenario = Scenario(stop=STOP, drive=road, targets={"speed": "a.u"}, record=("a.x", "b.x", "b.y"))
    return run(system, scenario, step=STEP, compared=False, **options)


@pytest.mark.repeated
@pytest.mark.parametrize("algorithm", [
    GaussSeidel(), Jacobi(values="extrapolated"), Implicit(), Adaptive(largest=4.0 * STEP, least=1e-4),
], ids=lambda a: a.name)  # fmt: skip
def test_builds_for_both_versions_of_fmi_couple_to_the_same_result(three, two, road, algorithm):
    def result(first, second, engine):
        parts = FmuComponent(first, "a"), FmuComponent(second, "b")
        return chained(*parts, road, algorithm=algorithm, engine=engine).series

    expected = result(two, two, "compiled")
    assert np.ptp(expected["b.x"]) > 1e-2
    for first, second, engine in ((three, three, "compiled"), (three, two, "compiled"), (two, three, "python")):
        series = result(first, second, engine)
        for name in expected.names:
            np.testing.assert_allclose(series[name], expected[name], rtol=0, atol=1e-13, err_msg=name)


@pytest.mark.parametrize("engine", ["compiled", "python"])
def test_a_force_law_is_exact_at_repeated_trial_points_and_goes_on_from_the_accepted_one(three, engine):
    law = ForceLaw(three, ports={"velocity": "u", "displacement": None, "force": "x"}, engine=engine)
    law.start(0.0, 0.0)
    x = 0.0
    for k in range(5):
        trials = [law.force((k + 1) * STEP, 1e-3 * v) for v in (2.0, -5.0, 2.0)]
        # The velocity rises linearly from the accepted value in mm/s.
        start = 2.0 * (k > 0)
        assert trials == pytest.approx([lag_fmus.exact(x, STEP, start, (v - start) / STEP) for v in (2.0, -5.0, 2.0)])
        law.accept((k + 1) * STEP, 2e-3)
        x = lag_fmus.exact(x, STEP, start, (2.0 - start) / STEP)


# ---- Interpreted calls without the loop ---------------------------------------------------------------------------


def begun(fmu, **options):
    """Return an instance in step mode, and its log."""
    slave, log = loaded(fmu, "lag", **options), FmuLog("lag", {}, fmu.folder)
    slave.begin(log)
    slave.setupExperiment(startTime=0.0)
    slave.enterInitializationMode()
    slave.exitInitializationMode()
    return slave, log


def marched(fmu, **options):
    """Return the readings of a run through the functions of FMI 2.0."""
    slave, log = begun(fmu, **options)
    at = (ctypes.c_uint32 * 3)(*[fmu.rows.references[name] for name in ("u", "w[2]", "f")])
    read = (ctypes.c_uint32 * 5)(*[fmu.rows.references[name] for name in ("x", "y", "v[2]", "s", "w[1]")])
    orders, out, rows = (ctypes.c_int32 * 3)(1, 1, 1), (ctypes.c_double * 5)(), []
    state = ctypes.c_void_p()
    for k in range(6):
        values, slopes = (ctypes.c_double * 3)(0.1 * k, 1.0 / (k + 1), 0.3), (ctypes.c_double * 3)(2.0, -k, 0.7)
        slave.call("GetFMUstate", ctypes.byref(state))
        for _ in range(2):
            slave.call("SetFMUstate", state)
            slave.call("SetReal", at, 3, values)
            slave.call("SetRealInputDerivatives", at, 3, orders, slopes)
            slave.call("DoStep", 0.1 * k, 0.1, 1)
        slave.call("GetReal", read, 5, out)
        rows.append(list(out))
    unknown = (ctypes.c_uint32 * 1)(9999)
    for name in ("GetReal", "SetReal"):
        with pytest.raises(FMICallException, match=f"fmi3{name[:3]}Float64 failed with status 3"):
            slave.call(name, unknown, 1, values)
    assert slave.free_state(ctypes.byref(state)) == 0
    slave.freeInstance()
    log.close()
    return rows


def test_interpreted_and_compiled_calls_give_the_same_bits(three, tmp_path):
    fmu = FmuFile.unpack(three, tmp_path)
    compiled, interpreted = (marched(fmu, compile_calls=compile_calls) for compile_calls in (True, False))
    assert compiled == interpreted
    assert compiled[-1][0] > 0.1


def test_a_reset_returns_arrays_to_their_start_values(three, tmp_path):
    fmu = FmuFile.unpack(three, tmp_path)
    slave, log = begun(fmu, compile_calls=False)
    first, second = ((ctypes.c_uint32 * 1)(fmu.rows.references[name]) for name in ("w[1]", "w[2]"))
    value = (ctypes.c_double * 1)(8.0)
    slave.set_values("Real", second, value)
    slave.reset()
    slave.set_values("Real", first, value)
    slave.get_values("Real", second, value)
    assert value[0] == 2.0
    slave.freeInstance()
    log.close()
