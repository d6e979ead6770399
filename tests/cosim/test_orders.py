"""Order of every scheme with all damping in the shocks, by refinement, against monolithic solutions of the car."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
import pytest
from scipy.linalg import expm

from cosim import Adaptive, Algorithm, GaussSeidel, Implicit, Jacobi, Scenario, System, run
from eightpost.corners import CORNERS
from eightpost.shock import Lpnl2, Shock
from eightpost.signals import Drivefile, TimeSeries
from eightpost.vehicle import read_vehicle, shipped

Join = Callable[..., System]
Signals = Mapping[str, np.ndarray[Any, Any]]

QUANTITIES = ("velocity", "tire_force", "hub_acceleration")
LOADS = ("heave_force", "roll_moment", "pitch_moment")
#: Within the asymptotic range of every scheme: at most an eighth of the time constant of a wheel's fastest mode [s].
STEPS = (0.0005, 0.00025, 0.000125)
STOP, SETTLING, RECORD_STEP = 0.5, 0.1, 0.004
#: 30 lbf/(in/s), as in Table 5.1 [N.s/m]; the lag of the linear shocks [s].
RATE, LAG = 30.0 * 175.12683524647636, 0.0013

#: Schemes and their orders with linear lagged shocks and with LPNL2 shocks; 0: knees of the curve leave no clean order.
#: With linear lagged shocks, held Gauss-Seidel is a staggered (leapfrog) scheme: neither side has feedthrough.
ORDERS: dict[str, tuple[Algorithm, int, int]] = {
    "jacobi held": (Jacobi(), 1, 1),
    "jacobi interpolated": (Jacobi("interpolated"), 1, 1),
    "jacobi extrapolated": (Jacobi("extrapolated"), 2, 2),
    "gauss-seidel held": (GaussSeidel(values="held"), 2, 1),
    "gauss-seidel interpolated": (GaussSeidel(values="interpolated"), 1, 1),
    "gauss-seidel extrapolated": (GaussSeidel(), 2, 2),
    "gauss-seidel, shocks first": (GaussSeidel(("lf", "rf", "lr", "rr", "car")), 2, 2),
    "jacobi parabolic": (Jacobi("parabolic"), 3, 0),
    "gauss-seidel parabolic": (GaussSeidel(values="parabolic"), 3, 0),
    "implicit": (Implicit(tolerance=1e-9), 3, 2),
}


@pytest.fixture(scope="module")
def smooth() -> Drivefile:
    """Roads and loads of 2 to 15 Hz, 250 points a second, linear in between."""
    time = 0.004 * np.arange(int(STOP / 0.004) + 1)
    rows = {
        f"{corner}.road": ("m", (0.012 - 0.001 * k) * np.sin(2 * np.pi * (2.0 + 3.7 * k) * time + k))
        for k, corner in enumerate(CORNERS)
    }
    rows["heave_force"] = ("N", 800.0 * np.cos(2 * np.pi * 4.0 * time))
    rows["roll_moment"] = ("N.m", 300.0 * np.sin(2 * np.pi * 6.0 * time))
    rows["pitch_moment"] = ("N.m", 500.0 * np.sin(2 * np.pi * 3.0 * time))
    return Drivefile(TimeSeries.from_channels(time, rows))


def inputs(drive: Drivefile) -> np.ndarray[Any, Any]:
    return np.stack([drive.series[name] for name in (*(f"{c}.road" for c in CORNERS), *LOADS)])


def by_name(velocity: Any, tire_force: Any, hub_acceleration: Any) -> Signals:
    pairs = zip(QUANTITIES, (velocity, tire_force, hub_acceleration), strict=True)
    return {f"car.{c}.{what}": row for what, rows in pairs for c, row in zip(CORNERS, rows, strict=True)}


@pytest.fixture(scope="module")
def closed_form(monolithic: Any, smooth: Drivefile) -> Signals:
    """Exact solution of the car with linear lagged dampers, x' = A x + B u, from point to point of the drive.

    tau F' = R v - F; from an interval's start, z = (x, u, u') obeys z' = (A x + B u, u', 0): a matrix exponential.
    """
    car, u = monolithic.Car(), inputs(smooth)
    system = monolithic._Coupled(car, monolithic.Shock(lambda v: RATE * v, monolithic.full_lag, LAG))
    a = system.A.copy()
    a[:, 14:] += system.G
    a[14:, 7:14] += RATE / LAG * system.S
    big = np.zeros((32, 32))
    big[:18, :18], big[:18, 18:25], big[18:25, 25:] = a, system.B, np.eye(7)
    advance = expm(big * 0.004)
    states = [system.equilibrium(u[:, 0])]
    for k in range(u.shape[1] - 1):
        z = np.concatenate([states[-1], u[:, k], (u[:, k + 1] - u[:, k]) / 0.004])
        states.append((advance @ z)[:18])
    x = np.stack(states, axis=1)
    hubs = (a @ x + system.B @ u)[10:14]
    return by_name(system.S @ x[7:14], np.array(car.tire_stiffness)[:, None] * (u[:4] - x[3:7]), hubs)


@pytest.fixture(scope="module")
def nonlinear(monolithic: Any, smooth: Drivefile, shocks: dict[str, Shock]) -> Signals:
    """Solution of the car with LPNL2 shocks as one set of equations, by scipy."""
    law = shocks["lpnl2"].law
    assert isinstance(law, Lpnl2)
    shock = monolithic.Shock(
        lambda v: np.array([law.curve.force(float(w)) for w in v]),
        lambda f: np.clip((1600.0 - np.abs(f)) / 800.0, 0.0, 1.0),
        law.time_constant,
        law.port.gas_stiffness,
        law.port.gas_preload,
    )
    u = inputs(smooth)
    solution = monolithic.coupled_run(monolithic.Car(), shock, smooth.series.time, u[:4], u[4:])
    return by_name(solution.shock_velocity, solution.tire_force, solution.hub_acceleration)


@pytest.fixture
def linear_car(seven_dof: Join) -> System:
    """F_s = R v in every piece of the curve, behind a lag."""
    at = 0.4
    curve = {f"curve.inner[{k}]": 0.0 for k in range(2, 16)} | {"curve.inner[1]": RATE * at}
    curve |= {"curve.transition_speed": at, "curve.transition_width": 0.01}
    for side, sign in (("compression", 1.0), ("rebound", -1.0)):
        curve |= {f"curve.{side}[1]": sign * RATE * at, f"curve.{side}[2]": sign * RATE * at}
        curve |= {f"curve.{side}[3]": 0.0, f"curve.{side}[4]": 0.0}
        curve |= {f"curve.{side}_slope": RATE, f"curve.{side}_speed": 9.0}
    return seven_dof("lpf1", time_constant=LAG, **curve)


def errors(system: System, drive: Drivefile, truth: Signals, algorithm: Algorithm, step: float) -> Any:
    """Worst corner's error of each quantity [%]."""
    scenario = Scenario(STOP, drive, record=tuple(truth), record_step=RECORD_STEP)
    series = run(system, scenario, algorithm=algorithm, step=step, compared=False).series
    after = series.time >= SETTLING - 1e-9
    percent = {
        n: 100 * np.sqrt(np.mean((series[n] - true)[after] ** 2)) / np.std(true[after]) for n, true in truth.items()
    }
    return [max(value for n, value in percent.items() if n.endswith(what)) for what in QUANTITIES]


def order(rows: Sequence[Any]) -> Any:
    """Slope of the errors over the steps, for each quantity."""
    return np.polyfit(np.log2(STEPS), np.log2(np.array(rows)), 1)[0]


@pytest.mark.repeated(2)
@pytest.mark.parametrize("name", ORDERS)
def test_each_scheme_has_its_expected_order_with_linear_shocks(
    linear_car: System, smooth: Drivefile, closed_form: Signals, name: str
) -> None:
    algorithm, expected, _ = ORDERS[name]
    rows = [errors(linear_car, smooth, closed_form, algorithm, step) for step in STEPS]
    assert order(rows)[:2] == pytest.approx([expected] * 2, abs=0.15)


@pytest.mark.repeated(2)
@pytest.mark.parametrize("name", [name for name, (_, _, order) in ORDERS.items() if order])
def test_each_scheme_has_its_expected_order_with_nonlinear_shocks(
    seven_dof: Join, smooth: Drivefile, nonlinear: Signals, name: str
) -> None:
    algorithm, _, expected = ORDERS[name]
    system = seven_dof(seal_friction=0.0)
    rows = [errors(system, smooth, nonlinear, algorithm, step) for step in STEPS]
    assert order(rows)[:2] == pytest.approx([expected] * 2, abs=0.15)
    assert expected == 1 or max(rows[0][:2]) < 0.5


@pytest.mark.parametrize(
    "algorithm", [*(scheme for scheme, _, _ in ORDERS.values()), Adaptive()], ids=[*ORDERS, "adaptive"]
)
def test_a_hub_acceleration_which_follows_the_force_directly_is_about_as_accurate_as_the_velocity(
    seven_dof: Join, smooth: Drivefile, nonlinear: Signals, algorithm: Algorithm
) -> None:
    """With the force that the step assumed, its error was up to fifty times the velocity's.

    A force from held values is half a step early itself.
    """
    velocity, _, hub = errors(seven_dof(seal_friction=0.0), smooth, nonlinear, algorithm, STEPS[0])
    assert hub < (3.0 if algorithm == GaussSeidel(values="held") else 2.0) * velocity


def test_the_error_of_an_adaptive_run_falls_with_its_tolerance(
    linear_car: System, smooth: Drivefile, closed_form: Signals
) -> None:
    """The local error has order p + 1 = 3, so the global error is proportional to the tolerance to the power 2/3."""
    coupled = [
        f"{p}{c}.{v}" for c in CORNERS for p, v in (("car.", "velocity"), ("car.", "displacement"), ("", "force"))
    ]
    algorithms = [Adaptive(relative=r, absolute=dict.fromkeys(coupled, 1e-12)) for r in (1e-4, 1e-5, 1e-6, 1e-7)]
    rows = [errors(linear_car, smooth, closed_form, algorithm, 0.001) for algorithm in algorithms]
    slopes = np.polyfit(np.arange(4), np.log10(np.array(rows)), 1)[0]
    assert slopes[:2] == pytest.approx([-2.0 / 3.0] * 2, abs=0.15)
    assert max(rows[0]) < 0.2


def test_a_coupled_run_starts_in_the_cars_equilibrium_including_the_gas_force(seven_dof: Join) -> None:
    """Gas force pushes each corner of the chassis up against its spring: x = -F / (k_s + k_gas) at zero load."""
    system = seven_dof(gas_preload=500.0, gas_stiffness=700.0)
    loads = {f"car.{name}": 0.0 for name in (*LOADS, *(f"{c}.road" for c in CORNERS))}
    system = System(system.components, system.bonds, constants=loads, parameters=system.parameters)
    series = run(system, Scenario(0.1), step=1e-3, compared=False).series
    rates = read_vehicle(shipped("seven_dof")).parameters.spring_rate
    for corner, rate in zip(CORNERS, rates, strict=True):
        displacement = series[f"car.{corner}.displacement"]
        assert displacement[0] == pytest.approx(-500.0 / (rate + 700.0), rel=1e-9)
        assert np.ptp(displacement) < 1e-12
