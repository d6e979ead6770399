"""The whole nonlinear car as one system: an independent reference for the coupling of substructures.

Seven-DOF car and four shocks (LPNL2) as one set of differential equations, assembled here element by element
from the parameters, without a line of eightpost, and integrated by scipy at a tolerance far below what it is
compared with:

    M q'' + K q = sum_roads k_t (z_R - z_2) + F_ext - S^T F,    v = S q'
    F = alpha F_lag + (1 - alpha) F_s + k_g S q + F_g,    tau F_lag' = F_s(v) - F_lag,    alpha = alpha(F_s)

Tests get this module as the fixture `monolithic`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.integrate import DOP853, Radau

INCH, POUND_MASS, GRAVITY = 0.0254, 0.45359237, 9.80665
POUND_FORCE = POUND_MASS * GRAVITY

#: Each corner: +1 left, -1 right; +1 front, -1 rear.
SIDES = ((1, 1), (-1, 1), (1, -1), (-1, -1))


@dataclass(frozen=True)
class Car:
    """SI parameters under the names of `eightpost.vehicle.SevenDof`, which can be passed in its place."""

    track_width: float = 70 * INCH
    cg_to_front_axle: float = 60 * INCH
    cg_to_rear_axle: float = 50 * INCH
    sprung_mass: float = 2550 * POUND_MASS
    roll_inertia: float = 1.5e6 * POUND_MASS * INCH**2
    pitch_inertia: float = 5.5e6 * POUND_MASS * INCH**2
    unsprung_mass: tuple[float, ...] = tuple(w * POUND_MASS for w in (101, 101, 124, 124))
    spring_rate: tuple[float, ...] = tuple(k * POUND_FORCE / INCH for k in (1280, 1280, 588, 588))
    tire_stiffness: tuple[float, ...] = (2000 * POUND_FORCE / INCH,) * 4
    damping: tuple[float, ...] = (30 * POUND_FORCE / INCH,) * 4
    front_anti_roll_rate: float = 0.0
    rear_anti_roll_rate: float = 0.0
    front_overhang: float = 45 * INCH
    rear_overhang: float = 45 * INCH


def no_lag(force: Any) -> Any:
    """Return the weight of a shock without lag: alpha = 0, so F = F_s."""
    return np.zeros_like(force)


def full_lag(force: Any) -> Any:
    """Return the weight of LPF1: alpha = 1, so F = F_lag."""
    return np.ones_like(force)


@dataclass(frozen=True)
class Shock:
    """`static_force(v) -> F_s` and `weight(F_s) -> alpha` take arrays; tau [s]; gas spring k_g, F_g."""

    static_force: Callable[[Any], Any]
    weight: Callable[[Any], Any] = no_lag
    tau: float = 1.0
    gas_stiffness: float = 0.0
    gas_preload: float = 0.0


@dataclass(frozen=True)
class Reference:
    """Motion of the coupled car at `time` (K,); arrays are (signal, time)."""

    time: np.ndarray
    shock_velocity: np.ndarray  # (4, K)
    shock_displacement: np.ndarray  # (4, K)
    shock_force: np.ndarray  # (4, K)
    tire_force: np.ndarray  # (4, K)
    ride_height: np.ndarray  # (2, K): front, rear
    hub_acceleration: np.ndarray  # (4, K)
    state: np.ndarray  # (18, K): q, q', F_lag


def mass(car: Any) -> np.ndarray:
    """Return the diagonal of M for q = (heave, roll, pitch, wheels)."""
    return np.array([car.sprung_mass, car.roll_inertia, car.pitch_inertia, *car.unsprung_mass])


def struts(car: Any) -> np.ndarray:
    """Return the rows S (4, 7): compression of each suspension, wheel height minus chassis height above it."""
    rows = np.zeros((4, 7))
    for i, (side, end) in enumerate(SIDES):
        to_axle = car.cg_to_front_axle if end > 0 else -car.cg_to_rear_axle
        rows[i, :3] = -1.0, -side * car.track_width / 2, end * abs(to_axle)
        rows[i, 3 + i] = 1.0
    return rows


def stiffness(car: Any) -> np.ndarray:
    """Return K from the energy: each spring adds `k b b^T`, where b is its elongation per coordinate."""
    K = np.zeros((7, 7))
    for row, rate in zip(struts(car), car.spring_rate, strict=True):
        K += rate * np.outer(row, row)
    for i, rate in enumerate(car.tire_stiffness):
        K[3 + i, 3 + i] += rate
    for left, rate in ((3, car.front_anti_roll_rate), (5, car.rear_anti_roll_rate)):
        twist = np.zeros(7)
        twist[1], twist[left], twist[left + 1] = 1.0, -1.0 / car.track_width, 1.0 / car.track_width
        K += rate * np.outer(twist, twist)
    return K


def nose_and_spoiler(car: Any) -> tuple[np.ndarray, np.ndarray]:
    """Return the ride heights from q (2, 7) and from the road (2, 4), with a plane fitted to the four wheelloaders."""
    a, b = car.cg_to_front_axle, car.cg_to_rear_axle
    forward = np.array([a + car.front_overhang, -b - car.rear_overhang])
    corners = np.array([[1.0, side, a if end > 0 else -b] for side, end in SIDES])
    plane = np.linalg.pinv(corners)  # height, slope across, slope along
    road = plane[[0]] + forward[:, None] * plane[[2]]
    chassis = np.zeros((2, 7))
    chassis[:, 0], chassis[:, 2] = 1.0, -forward
    return chassis, -road


def coupled_run(
    car: Any,
    shocks: Shock | Sequence[Shock],
    drive_time: np.ndarray,
    road: np.ndarray,
    external: np.ndarray | None = None,
    *,
    at: np.ndarray | None = None,
    method: type[DOP853] | type[Radau] = DOP853,
    rtol: float = 1e-9,
) -> Reference:
    """Run the coupled car from the equilibrium of the first inputs.

    Args:
        car: A `Car` or a `SevenDof`.
        shocks: One for all corners, or one per corner (lf, rf, lr, rr).
        drive_time: Knots (N,) [s] between which the inputs are linear.
        road: Wheelloaders (4, N) [m].
        external: heave_force, roll_moment, pitch_moment (3, N), or none.
        at: Times of the results (K,) [s]; default the knots.
        method: DOP853, or Radau where a lag is very short.
        rtol: Relative tolerance.
    """
    drive_time = np.asarray(drive_time, dtype=float)
    inputs = np.vstack([road, np.zeros((3, len(drive_time))) if external is None else external])
    at = drive_time if at is None else np.asarray(at, dtype=float)
    knots = np.union1d(drive_time, at)
    knots = knots[knots <= at[-1]]
    drive = np.array([np.interp(knots, drive_time, row) for row in inputs])
    system = _Coupled(car, shocks)
    states = _integrate(system, knots, drive, method, rtol)
    wanted = np.searchsorted(knots, at)
    return system.results(at, states[:, wanted], drive[:, wanted])


class _Coupled:
    """x = (q, q', F_lag); x' = A x + G F + B u + (0, 0, F_s / tau)."""

    def __init__(self, car: Any, shocks: Shock | Sequence[Shock]) -> None:
        self.one = shocks if isinstance(shocks, Shock) else None
        self.shocks = (shocks,) * 4 if isinstance(shocks, Shock) else tuple(shocks)
        self.car, self.S, self.tau = car, struts(car), np.array([shock.tau for shock in self.shocks])
        self.gas_rate = np.array([shock.gas_stiffness for shock in self.shocks])
        self.preload = np.array([shock.gas_preload for shock in self.shocks])
        inverse = 1.0 / mass(car)[:, None]
        self.K, self.load = stiffness(car), np.zeros((7, 7))
        self.load[3:, :4], self.load[:3, 4:] = np.diag(car.tire_stiffness), np.eye(3)
        self.A, self.B, self.G = np.zeros((18, 18)), np.zeros((18, 7)), np.zeros((18, 4))
        self.A[:7, 7:14], self.A[7:14, :7] = np.eye(7), -inverse * self.K
        self.A[14:, 14:] = -np.diag(1.0 / self.tau)
        self.B[7:14], self.G[7:14] = inverse * self.load, -inverse * self.S.T

    def static(self, v: np.ndarray) -> np.ndarray:
        if self.one is not None:
            return np.asarray(self.one.static_force(v))
        return np.array([float(shock.static_force(w)) for shock, w in zip(self.shocks, v, strict=True)])

    def force(self, x: np.ndarray, fs: np.ndarray) -> np.ndarray:
        if self.one is not None:
            alpha = np.asarray(self.one.weight(fs))
        else:
            alpha = np.array([float(shock.weight(f)) for shock, f in zip(self.shocks, fs, strict=True)])
        return fs + alpha * (x[14:] - fs) + self.gas_rate * (self.S @ x[:7]) + self.preload

    def slope(self, x: np.ndarray, driven: np.ndarray) -> np.ndarray:
        fs = self.static(self.S @ x[7:14])
        dx = self.A @ x + self.G @ self.force(x, fs) + driven
        dx[14:] += fs / self.tau
        return dx

    def equilibrium(self, u: np.ndarray) -> np.ndarray:
        at_rest = self.static(np.zeros(4))
        K = self.K + self.S.T @ (self.gas_rate[:, None] * self.S)
        q = np.linalg.solve(K, self.load @ u - self.S.T @ (at_rest + self.preload))
        return np.concatenate([q, np.zeros(7), at_rest])

    def results(self, time: np.ndarray, x: np.ndarray, u: np.ndarray) -> Reference:
        v = self.S @ x[7:14]
        force = np.array([self.force(x[:, k], self.static(v[:, k])) for k in range(len(time))]).T.reshape(4, -1)
        chassis, road = nose_and_spoiler(self.car)
        return Reference(
            time,
            v,
            self.S @ x[:7],
            force,
            np.array(self.car.tire_stiffness)[:, None] * (u[:4] - x[3:7]),
            chassis @ x[:7] + road @ u[:4],
            (self.A @ x + self.G @ force + self.B @ u)[10:14],
            x,
        )


def _integrate(system: _Coupled, knots: np.ndarray, drive: np.ndarray, method: Any, rtol: float) -> np.ndarray:
    """Integrate from knot to knot, so that no step crosses a kink of the inputs."""
    atol = rtol * np.repeat([1e-3, 1e-1, 1e2], [7, 7, 4])  # a thousandth of the usual size of each
    driven = system.B @ drive
    states = np.empty((18, len(knots)))
    states[:, 0] = x = system.equilibrium(drive[:, 0])
    step = None
    for k in range(len(knots) - 1):
        start, end = knots[k], knots[k + 1]
        base, rise = driven[:, k], (driven[:, k + 1] - driven[:, k]) / (end - start)

        def slope(t: float, x: np.ndarray, base: Any = base, rise: Any = rise, start: float = start) -> np.ndarray:
            return system.slope(x, base + (t - start) * rise)

        first = None if step is None else min(step, end - start)
        solver = method(slope, start, x, end, rtol=rtol, atol=atol, first_step=first)
        while solver.status == "running":
            message = solver.step()
            assert solver.status != "failed", message
            step = max(solver.step_size, 0.0 if solver.status == "running" else step or 0.0)
        states[:, k + 1] = x = solver.y
    return states
