"""Reference results follow the cross-check rules and equal an independent implementation of the models' equations."""

import dataclasses
import zipfile

import fmpy
import numpy as np
import pytest
from fmpy.util import read_csv, read_ref_opt_file
from numpy.polynomial import polynomial
from scipy.signal import cont2discrete

from builder.product import vehicle_product
from builder.reference import _vehicle_reference
from eightpost.shock import StaticCurve
from eightpost.vehicle import Channel, Friction, IdentifiedVehicle, StateSpace, StructuralVehicle, read_vehicle, shipped

from .members import ALL, CARS, EXTRA, LAWS, assert_close, members_of, page_of, reference_of, table_of


@pytest.mark.parametrize("name", ALL)
def test_the_reference_files_follow_the_cross_check_rules(archives, products, name):
    (input_names, u), (output_names, y) = (
        table_of(archives[name][f"{EXTRA}/{name}_{kind}.csv"]) for kind in ("in", "ref")
    )
    interface = products[name].interface
    assert input_names[0] == output_names[0] == "time"
    assert set(input_names) - {"time"} == set(interface.names("input"))
    assert set(output_names) - {"time"} <= set(interface.names("output")) | set(interface.names("local"))
    assert set(interface.names("output")) <= set(output_names)
    for values in (u, y):
        np.testing.assert_array_equal(values[:, 0], [k / 1000 for k in range(1001)])
        assert np.isfinite(values).all()
    assert all(len(archives[name][f"{EXTRA}/{name}_{kind}.csv"]) < 1_000_000 for kind in ("in", "ref"))
    assert not u[0, 1:].any()
    assert (np.ptp(u[:, 1:], axis=0) > 0.0).all()


@pytest.mark.parametrize("name", LAWS)
def test_a_shocks_reference_exceeds_the_fitted_range_on_both_sides_and_its_motion_is_consistent(archives, shocks, name):
    inputs, outputs = reference_of(archives[name], name)
    damper = shocks[name].law.port.motion_ratio * inputs["velocity"]
    assert damper.max() > shocks[name].law.curve.compression_speed
    assert damper.min() < -shocks[name].law.curve.rebound_speed
    assert set(outputs["beyond_fit"]) == {0.0, 1.0}
    travelled = np.concatenate([[0.0], np.cumsum((inputs["velocity"][1:] + inputs["velocity"][:-1]) / 2.0 * 1e-3)])
    np.testing.assert_allclose(inputs["displacement"], travelled, atol=1e-4)


def curve_by_numpy(curve: StaticCurve, velocity: np.ndarray) -> np.ndarray:
    """Compute Eq 3.23 with arrays: all pieces everywhere, then the selection of pieces."""

    def fitted(v: np.ndarray) -> np.ndarray:
        s = v / curve.transition_speed
        outer = np.where(
            v > 0.0,
            polynomial.polyval(np.abs(s) - 1.0, curve.compression),
            polynomial.polyval(np.abs(s) - 1.0, curve.rebound),
        )
        share = np.clip((np.abs(v) - curve.transition_speed) / curve.transition_width + 0.5, 0.0, 1.0)
        return (1.0 - share) * polynomial.polyval(s, (0.0, *curve.inner)) + share * outer

    inside = np.clip(velocity, -curve.rebound_speed, curve.compression_speed)
    slope = np.where(velocity > 0.0, curve.compression_slope, curve.rebound_slope)
    return fitted(inside) + slope * (velocity - inside)


@pytest.mark.parametrize("name", LAWS)
def test_a_shocks_reference_equals_an_independent_implementation(archives, shocks, name):
    law, (inputs, outputs) = shocks[name].law, reference_of(archives[name], name)
    port, velocity = law.port, np.concatenate([[0.0], inputs["velocity"][:-1]])  # held over the step before this point
    displacement = np.concatenate([[0.0], inputs["displacement"][:-1]])
    damper = port.motion_ratio * velocity
    static = curve_by_numpy(law.curve, damper) * np.where(damper > 0.0, port.compression_scale, port.rebound_scale)
    lagged = static.copy()
    if name != "polylinear":
        for k in range(1, lagged.size):
            lagged[k] = static[k] + (lagged[k - 1] - static[k]) * np.exp(-1e-3 / law.time_constant)
    weight = {"polylinear": lambda: 0.0 * static, "lpf1": lambda: 0.0 * static + 1.0}.get(
        name, lambda: np.interp(np.abs(static), [law.lag_full_force, law.lag_zero_force], [1.0, 0.0])
    )()
    valves = weight * lagged + (1.0 - weight) * static
    drag = port.seal_friction * np.tanh(damper / port.friction_velocity)
    gas = port.gas_preload + port.gas_stiffness * port.motion_ratio * displacement
    assert_close(outputs["force"], port.motion_ratio * (valves + drag + gas))
    assert_close(outputs["static_force"], static)
    assert_close(outputs["lagged_force"], lagged)
    assert_close(outputs["lag_weight"], weight)
    assert_close(outputs["dissipated_power"], (valves + drag) * damper)


@pytest.mark.parametrize("name", CARS)
def test_a_vehicles_reference_equals_scipys_zero_order_hold_simulation(archives, name):
    model, (inputs, outputs) = read_vehicle(shipped(name)).coupled(), reference_of(archives[name], name)
    Ad, Bd, *_ = cont2discrete((model.A, model.B, model.C, model.D), 1e-3)
    u = np.array([inputs[channel.name] for channel in model.inputs])
    x = np.zeros((len(model.A), u.shape[1]))
    for k in range(1, u.shape[1]):
        x[:, k] = Ad @ x[:, k - 1] + Bd @ u[:, k - 1]
    y = model.C @ x + model.D @ np.column_stack([u[:, :1], u[:, :-1]])
    for row, channel in zip(y, model.outputs, strict=True):
        assert_close(outputs[channel.name], row)


@pytest.mark.nightly
def test_an_identified_vehicles_reference_includes_friction_at_the_ports():
    """Check that a car with friction moves less than the same car without friction."""
    model = read_vehicle(shipped("quarter_car")).coupled()
    smooth = IdentifiedVehicle("car", model)
    rubbing = IdentifiedVehicle("car", model, friction={"": Friction(200.0, 0.01)})
    found = [_vehicle_reference(v, vehicle_product(v, "car").interface) for v in (smooth, rubbing)]
    place = found[0].outputs.index("velocity")
    sizes = [float(np.std(one.y[:, place])) for one in found]
    assert sizes[1] < 0.9 * sizes[0]


@pytest.mark.nightly
def test_a_vehicles_reference_includes_static_values():
    vehicle = read_vehicle(shipped("quarter_car"))
    assert isinstance(vehicle, StructuralVehicle)
    moved = dataclasses.replace(vehicle, static={"tire_force": 3000.0})
    (_, plain), (_, shifted) = (reference_of(members_of(vehicle_product(v, "q")), "q") for v in (vehicle, moved))
    np.testing.assert_allclose(shifted["tire_force"] - plain["tire_force"], 3000.0, atol=1e-6)
    np.testing.assert_array_equal(shifted["velocity"], plain["velocity"])


def test_a_vehicle_without_an_equilibrium_has_no_reference_results_and_does_not_mention_them():
    model = StateSpace([[0.0]], [[1.0]], [[1.0]], [[0.0]], (Channel("force", "N"),), (Channel("velocity", "m/s"),))
    members = members_of(vehicle_product(IdentifiedVehicle("free mass", model), "free"))
    assert not [name for name in members if name.startswith(EXTRA)]
    assert "Reference results" not in page_of(members)


@pytest.mark.repeated(2)
@pytest.mark.parametrize("name", ALL)
@pytest.mark.parametrize("target", ["python_fmus", "fmus"])
def test_fmpy_reads_the_reference_files_and_reproduces_the_results_with_the_fmu(request, tmp_path, target, name):
    fmu = request.getfixturevalue(target)[name]
    with zipfile.ZipFile(fmu) as archive:
        archive.extractall(tmp_path, [m for m in archive.namelist() if m.startswith(EXTRA)])
    folder = tmp_path / EXTRA
    options = read_ref_opt_file(str(folder / f"{name}_ref.opt"))
    expected = read_csv(str(folder / f"{name}_ref.csv"))
    result = fmpy.simulate_fmu(
        str(fmu),
        start_time=options["StartTime"],
        stop_time=options["StopTime"],
        output_interval=options["StepSize"],
        input=read_csv(str(folder / f"{name}_in.csv")),
        output=expected.dtype.names[1:],
    )
    for output in expected.dtype.names[1:]:
        assert_close(result[output], expected[output])
    assert options["RelTol"] == 1e-9
