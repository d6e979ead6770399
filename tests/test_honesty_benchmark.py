"""The campaign of benchmarks/honesty: its reference, its systems, its counts, and the bounds that are to hold."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from benchmarks.honesty import __main__ as summary
from benchmarks.honesty import reference
from benchmarks.honesty import runs as scale
from benchmarks.honesty.__main__ import read_rows, run_campaign
from benchmarks.honesty.cases import (
    BRISTLES_FROM,
    CORNERS,
    QUARTER_CARS,
    SEVEN_DOFS,
    Case,
    DrawnBristle,
    DrawnCar,
    DrawnShock,
    draw_case,
    draw_shock,
    multisine,
    vehicle,
)  # fmt: skip
from cosim import Scenario
from eightpost.shock import Port
from eightpost.signals import Drivefile, TimeSeries

pytestmark = pytest.mark.nightly

#: The systems that every change is tried on.
FIXED = range(1000, 1040)


def test_systems_have_all_that_they_are_to_have() -> None:
    cases = [draw_case(seed) for seed in range(120)]
    shocks = [shock for case in cases for car in case.cars for shock in car.shocks.values()]
    assert {shock.law for shock in shocks} == {"polylinear", "lpf1", "lpnl2"}
    slopes = [shock.nose_slope for shock in shocks]
    assert min(slopes) < 1.5e3
    assert max(slopes) > 7e4
    assert {"none", "zeros", "white", "spikes", "steps", "bumps", "chirp", "multisine"} == {c.road for c in cases}
    assert max(len(case.cars) for case in cases) > 5
    for has in ("held", "python"):
        assert any(getattr(case, has) for case in cases)
    assert any(shock.falls for shock in shocks)
    assert any(case.scenario.drive_start for case in cases)
    assert any(len(car.shocks) == 4 for case in cases for car in case.cars)
    names = [f"{kind}_{k:02d}" for kind, n in (("quarter", QUARTER_CARS), ("seven", SEVEN_DOFS)) for k in range(n)]
    masses = [m for name in names for m in np.atleast_1d(vehicle(name).parameters.unsprung_mass)]
    assert 8.0 <= min(masses) < 9.0
    assert 55.0 < max(masses) <= 60.0


def test_every_port_of_the_systems_with_bristles_has_one_and_other_systems_have_none() -> None:
    for seed in (3, BRISTLES_FROM + 3):
        case = draw_case(seed)
        for car in case.cars:
            assert set(car.bristles) == (set(car.shocks) if seed >= BRISTLES_FROM else set())
    springs = [b.spring for k in range(20) for c in draw_case(BRISTLES_FROM + k).cars for b in c.bristles.values()]
    assert 0.0 in springs and min(springs) < 0.0 < max(springs)


def _case(model: str, shocks: dict[str, DrawnShock], stop: float, **friction: tuple[float, float]) -> Case:
    """One car on sines at 400 points a second, and loads where it takes any."""
    random, time = np.random.default_rng(5), 0.0025 * np.arange(round(stop / 0.0025) + 41)
    car = DrawnCar("car0", model, shocks, friction)
    rows = {
        f"car0.{channel.name}": (channel.unit, (1.0 if channel.unit == "m" else 1e4) * multisine(random, time))
        for channel in vehicle(model).coupled().inputs
        if not channel.name.endswith("force") or channel.name == "heave_force"
    }
    drive = Drivefile(TimeSeries.from_channels(time, rows))
    return Case(0, (car,), Scenario(stop, drive, {name: name for name in drive.names}, drive_start=0.1), "multisine")


def _plain(shock: DrawnShock, **port: float) -> DrawnShock:
    """The shock at a motion ratio of 1 without seal drag, but for what is given."""
    return replace(shock, port=Port(**{"gas_stiffness": 700.0, "gas_preload": 300.0} | port))


def _shock_of(module: Any, shock: DrawnShock) -> Any:
    """The shock as tests/monolithic.py takes it, from the curve's own definition."""
    curve, port, own = shock.curve, shock.port, shock.own

    def force(v: Any) -> Any:
        values = [port.scale(float(w)) * curve.force(float(w)) + port.seal_force(float(w)) for w in np.atleast_1d(v)]
        return np.array(values) if np.ndim(v) else values[0]

    weight = {"polylinear": module.no_lag, "lpf1": module.full_lag}.get(shock.law)
    if weight is None:
        low, high = own["lag_full_force"], own["lag_zero_force"]
        weight = lambda f: np.clip((high - np.abs(f)) / (high - low), 0.0, 1.0)  # noqa: E731
    tau = own.get("time_constant", 1.0)
    return module.Shock(force, weight, tau, port.gas_stiffness, port.gas_preload)


def test_the_reference_is_that_of_scipy_on_a_seven_dof_car(monolithic: Any) -> None:
    random, laws = np.random.default_rng(11), ["polylinear", "lpf1", "lpnl2", "polylinear"]
    shocks = {corner: _plain(draw_shock(random, law)) for corner, law in zip(CORNERS, laws, strict=True)}
    # A polylinear law follows its velocity at once, so seal drag is a part of the curve.
    shocks["lf"] = _plain(shocks["lf"], seal_friction=30.0, friction_velocity=0.01, rebound_scale=1.6)
    case, stop = _case("seven_03", shocks, 0.1), 0.1
    times = np.linspace(0.0, stop, 101)
    found = reference.solve(case, times, 1e-10)
    drive = case.scenario.drive
    assert drive is not None
    begin = round(0.1 / 0.0025)  # where the run starts in the drive
    roads, loads = [f"{c}.road" for c in CORNERS], ["heave_force", "roll_moment", "pitch_moment"]
    inputs = [[drive.series[f"car0.{name}"][begin:] for name in names] for names in (roads, loads)]
    true = monolithic.coupled_run(
        vehicle("seven_03").parameters,
        [_shock_of(monolithic, shock) for shock in shocks.values()],
        0.0025 * np.arange(len(inputs[0][0])),
        *map(np.array, inputs),
        at=times,
    )
    rows = dict(zip(found.names, found.values, strict=True))
    for quantity, row in (
        ("velocity", true.shock_velocity),
        ("displacement", true.shock_displacement),
        ("tire_force", true.tire_force),
        ("hub_acceleration", true.hub_acceleration),
    ):
        for corner, expected in zip(CORNERS, row, strict=True):
            assert rows[f"car0.{corner}.{quantity}"] == pytest.approx(expected, abs=2e-6 * np.std(expected))
    for corner, expected in zip(CORNERS, true.shock_force, strict=True):
        assert rows[f"car0_{corner}.force"] == pytest.approx(expected, abs=2e-6 * np.std(expected))
    for name, expected in zip(("front", "rear"), true.ride_height, strict=True):
        assert rows[f"car0.{name}.ride_height"] == pytest.approx(expected, abs=2e-6 * np.std(expected))


def test_the_reference_is_that_of_scipy_on_a_quarter_car_with_a_lag_and_all_of_the_port() -> None:
    """tau F_v' = f(v_d) - F_v: the curve by its definition, friction at seal and suspension."""
    port = Port(1.2, 1.5, 0.7, 900.0, 400.0, 20.0, 0.01)
    shock = replace(draw_shock(np.random.default_rng(2), "lpf1"), port=port, own={"time_constant": 2e-3})
    case, stop, drag = _case("quarter_09", {"": shock}, 0.15), 0.15, (60.0, 0.02)
    rub = DrawnBristle(80.0, 2e-4, 1.2, 0.02, 4e4)
    case = replace(case, cars=(replace(case.cars[0], friction={"": drag}, bristles={"": rub}),))
    car, drive = vehicle("quarter_09").parameters, case.scenario.drive
    assert drive is not None
    road = drive.series["car0.road"]
    k, tire, masses = car.suspension_stiffness, car.tire_stiffness, (car.sprung_mass, car.unsprung_mass)

    def force(x: float, v: float, valves: float) -> float:
        return 1.2 * (valves + 20.0 * np.tanh(1.2 * v / 0.01) + 400.0 + 900.0 * 1.2 * x)

    def slope(t: float, y: Any) -> list[float]:
        x, v = y[1] - y[0], y[3] - y[2]
        sliding = rub.reach * (1.0 + (rub.static_ratio - 1.0) * np.exp(-((v / rub.stribeck_velocity) ** 2)))
        friction = drag[0] * np.tanh(v / drag[1]) + rub.force / rub.reach * y[5]
        total = force(x, v, y[4]) + friction + rub.spring * x**2 + k * x
        up = tire * (np.interp(t + 0.1, drive.series.time, road) - y[1])
        return [
            y[2],
            y[3],
            total / masses[0],
            (up - total) / masses[1],
            (port.scale(1.2 * v) * shock.curve.force(1.2 * v) - y[4]) / 2e-3,
            v - abs(v) * y[5] / sliding,
        ]

    preload, rate = 1.2 * 400.0, k + 1.2 * 900.0 * 1.2
    first = float(np.interp(0.1, drive.series.time, road))
    at_rest = brentq(lambda x: rate * x + preload + rub.spring * x**2, -0.05, 0.0, xtol=1e-15)
    y, times, states = [first - at_rest, first, 0.0, 0.0, 0.0, 0.0], 0.0025 * np.arange(61), []
    for start, end in zip(times, [*times[1:], None], strict=True):
        states.append(y)
        if end is not None:
            solved = solve_ivp(
                slope, (start, end), y, method="LSODA", rtol=1e-9, atol=[1e-11] * 2 + [1e-9] * 2 + [1e-6, 1e-13]
            )
            y = solved.y[:, -1].tolist()
    found = reference.solve(case, times, 1e-10)
    rows, true = dict(zip(found.names, found.values, strict=True)), np.array(states).T
    x, v = true[1] - true[0], true[3] - true[2]
    expected = {
        "car0.velocity": v,
        "car0.displacement": x,
        "car0_shock.force": force(x, v, true[4]),
        "car0.tire_force": tire * (np.interp(times + 0.1, drive.series.time, road) - true[1]),
    }
    assert times[-1] == pytest.approx(stop)
    for name, row in expected.items():
        assert rows[name] == pytest.approx(row, abs=2e-5 * np.std(row)), name


def test_small_signals_and_signals_at_rest_have_a_reference_of_their_own() -> None:
    rest, wave = np.zeros(100), np.sin(np.arange(100))
    found = scale.reference_scales(np.array([wave, 1e-4 * wave, rest, rest]), ["N", "N", "N", "m/s"])
    assert found == pytest.approx([np.std(wave), 0.01 * np.std(wave), 0.01 * np.std(wave), 1e-6])


def _row(stated: float | None, true: float, *, acceptable: bool = True, seed: int = 0) -> dict[str, Any]:
    channel = {"stated": stated, "true": true, "reference": 1e-5, "decisive": True, "unit": "N", "scale": 1.0}
    return {
        "seed": seed, "scheme": "default", "case": "made up", "error": "", "acceptable": acceptable, "tolerance": 0.2,
        "step": 1e-3, "taken": "gauss-seidel", "coupled": 0.0, "steps": 80, "work": 100, "seconds": 1.0,
        "repeats": True,
        "channels": {"a.force": channel, "b.acceleration": channel | {"decisive": False, "unit": "m/s2", "true": 9.0}},
    }  # fmt: skip


def test_counts_are_of_the_worst_decisive_channel() -> None:
    rows = [_row(0.1, 0.15), _row(0.1, 0.5), _row(0.01, 6.0), _row(1.0, 0.1), _row(0.001, 0.01), _row(None, 7.0)]
    assert summary.understated(rows, 0.5) == rows[1:3]
    assert summary.understated(rows, 0.1) == [rows[2]]
    assert summary.overstated(rows) == [rows[3]]
    assert summary.wrongly_accepted(rows) == [rows[2], rows[5]]
    assert summary.wrongly_accepted([_row(0.1, 6.0, acceptable=False)]) == []
    assert summary.wrongly_met(rows) == [rows[1], rows[2]]
    printed = "\n".join(summary.lines(rows))
    assert "stated below half the true                                 2 of 4 (50.0 %)" in printed
    assert "seed 0, default (gauss-seidel at 1 ms): stated 0.01 %, true 6 % (a.force), accepted" in printed


def test_a_campaign_goes_on_where_it_was_and_measures_between_recorded_points(tmp_path: Any) -> None:
    kept = tmp_path / "rows.jsonl"
    first = run_campaign([3], "all", workers=1, keep=kept, quiet=True)
    assert [row["scheme"] for row in first if row["scheme"] == "default"] == ["default"]
    assert len(first) == 9
    assert not [row for row in first if "failed" in row]
    assert all(row["repeats"] for row in first if row.get("channels"))
    assert run_campaign([3], "all", workers=1, keep=kept, quiet=True) == first
    assert len(read_rows(kept)) == 9
    assert not summary.unsettled(first)


def test_what_the_default_states_of_systems_holds() -> None:
    """The bounds of docs/explanation/coupling.md."""
    rows = run_campaign(FIXED, "default", quiet=True)
    assert len(summary.compared(rows)) == len(FIXED), [row for row in rows if not row.get("channels")]
    assert not summary.unsettled(rows)
    for found in (summary.wrongly_accepted(rows), summary.understated(rows, 0.1), summary.wrongly_met(rows)):
        assert not found, "\n".join(summary.lines(found))
    low = summary.understated(rows, 0.5)
    assert len(low) <= 0.03 * len(rows), "\n".join(summary.lines(low))
