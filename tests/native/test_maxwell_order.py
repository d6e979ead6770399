"""A Maxwell FMU under ramped velocities keeps second order across kinks of its curve, alone and in a quarter car.

The reference is one set of differential equations with a curve of its own, without a line of eightpost, by an implicit
multistep method.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm
from scipy.optimize import brentq

COARSEST, DURATION = 2e-3, 0.06
FINER = (1, 2, 4, 8, 16)


@dataclass(frozen=True)
class Curve:
    """f(v) of docs/reference/ports.md: a cubic in the middle, a straight line on each side, blended; two scales.

    Attributes:
        nose: Slope at 0 [N.s/m].
        bend: Share of the force at v_t that the cubic term takes.
        v_t: Transition speed [m/s].
        width: Width of the blend [m/s].
        slope: Beyond the blend, in compression and in rebound [N.s/m].
        speed: End of the fitted range, on each side [m/s].
        beyond: Slope outside it, on each side [N.s/m].
        scale: Factors on compression and rebound.
    """

    nose: float
    bend: float
    v_t: float
    width: float
    slope: tuple[float, float]
    speed: tuple[float, float]
    beyond: tuple[float, float]
    scale: tuple[float, float]

    def force(self, v: float) -> float:
        """Return f [N] at a velocity [m/s]."""
        side, k, x = (1.0, 0, v) if v > 0.0 else (-1.0, 1, -v)
        fitted = min(x, self.speed[k])
        return side * self.scale[k] * (self._blended(fitted, k) + self.beyond[k] * (x - fitted))

    def _blended(self, x: float, k: int) -> float:
        s = x / self.v_t
        inner = self.nose * self.v_t * (s - self.bend * s**3)
        outer = self.nose * self.v_t * (1.0 - self.bend) + self.slope[k] * (x - self.v_t)
        share = min(max((x - self.v_t) / self.width + 0.5, 0.0), 1.0)
        return (1.0 - share) * inner + share * outer

    def parameters(self) -> dict[str, float]:
        """Return the values of the FMU's parameters."""
        top = self.nose * self.v_t
        values = {f"curve.inner[{k}]": 0.0 for k in range(1, 16)}
        values |= {"curve.inner[1]": top, "curve.inner[3]": -self.bend * top}
        for name, sign, k in (("compression", 1.0, 0), ("rebound", -1.0, 1)):
            line = (sign * top * (1.0 - self.bend), sign * self.slope[k] * self.v_t, 0.0, 0.0)
            values |= {f"curve.{name}[{i}]": c for i, c in enumerate(line, 1)}
            values |= {f"curve.{name}_speed": self.speed[k], f"curve.{name}_slope": self.beyond[k]}
            values |= {f"{name}_scale": self.scale[k]}
        values |= {"curve.transition_speed": self.v_t, "curve.transition_width": self.width}
        return values | {"gas_stiffness": 0.0, "gas_preload": 0.0, "seal_friction": 0.0}


def rising_curve(rng):
    """Return a curve: 1e3 to 3e4 N.s/m near zero, changing up to thirtyfold in 5 to 40 mm/s; scales from 0.5 to 2."""
    while True:
        nose, bend, v_t = 10.0 ** rng.uniform(3.0, 4.5), rng.uniform(0.0, 0.3), rng.uniform(0.1, 0.4)
        curve = Curve(
            nose,
            bend,
            v_t,
            rng.uniform(0.005, 0.04),
            tuple(nose * 10.0 ** rng.uniform(-1.5, 0.0, 2)),
            tuple(rng.uniform(0.5, 1.2, 2)),
            tuple(10.0 ** rng.uniform(2.0, 3.7, 2)),
            tuple(rng.uniform(0.5, 2.0, 2)),
        )
        fine = 2e-4  # a blend from steep to flat falls at its end
        forces = np.array([curve.force(v) for v in np.arange(-1.2, 1.2, fine)])
        if np.diff(forces).min() > 0.01 * nose * fine:
            return curve


def drive(rng):
    """Return a velocity of three sines: v(t) [m/s]."""
    size = rng.uniform(0.2, 0.5) * np.array([1.0, 0.4, 0.2])
    omega, phase = 2.0 * np.pi * rng.uniform((2.0, 5.0, 8.0), (5.0, 8.0, 12.0)), rng.uniform(0.0, 6.28, 3)
    return lambda t: float(size @ np.sin(omega * t + phase))


def integrated(curve, stiffness, velocity, times):
    """Return F [N] at `times` of F' = k (v - w), F = f(w), starting in equilibrium."""

    def rate(t, force):
        return [stiffness * (velocity(t) - velocity_under(curve, force[0]))]

    start = curve.force(velocity(0.0))
    return solution(rate, [start], times)[0]


def velocity_under(curve, force):
    """Return w [m/s] with f(w) = `force` [N]."""
    return brentq(lambda w: curve.force(w) - force, -5.0, 5.0, xtol=1e-15, rtol=1e-14)


def solution(rate, start, times):
    """Return y (n, N) at `times`, in steps of at most 0.5 ms so that no kink of the drive is missed."""
    solved = solve_ivp(rate, (0.0, times[-1]), start, "LSODA", times, rtol=1e-10, atol=1e-8, max_step=5e-4)
    assert solved.success
    return solved.y


def begun(fmu, curve, stiffness, velocity):
    fmu.finish()
    fmu.begin(0.0, 1e6, curve.parameters() | {"series_stiffness": stiffness})
    fmu.set(("velocity",), (velocity,))
    fmu.end_initialization()


def stepped(fmu, time, start, end, step):
    fmu.set(("velocity",), (start,))
    fmu.set_derivatives(("velocity",), ((end - start) / step,))
    fmu.step(time, step)
    return fmu.get(("force",))[0]


def ramped(fmu, curve, stiffness, velocity, finer):
    """Return F (N,) [N] at multiples of `COARSEST`, with the velocity ramped over steps `finer` times finer."""
    step = COARSEST / finer
    ends = [velocity(k * step) for k in range(round(DURATION / step) + 1)]
    begun(fmu, curve, stiffness, ends[0])
    forces = [stepped(fmu, k * step, a, b, step) for k, (a, b) in enumerate(pairwise(ends))]
    return np.array([curve.force(ends[0]), *forces])[::finer]


def order(errors):
    return -np.polyfit(np.log(FINER[-len(errors) :]), np.log(errors), 1)[0]


@cache
def random_cases():
    rng = np.random.default_rng(20)
    return [(rising_curve(rng), 10.0 ** rng.uniform(6.0, 7.3), drive(rng)) for _ in range(30)]


def relative(found, exact):
    """Return the RMS error over the standard deviation."""
    return np.sqrt(np.mean((found - exact) ** 2)) / np.std(exact)


@pytest.mark.nightly
def test_ramped_velocities_of_a_smooth_drive_give_second_order_in_the_step(component):
    """Over all cases. A single one may cross its nose within a few ramps: there even an exact integration of the ramps
    has an order of 1.3 only.
    """
    fmu, times, rows = component("maxwell"), np.arange(31) * COARSEST, []
    for curve, stiffness, velocity in random_cases():
        exact = integrated(curve, stiffness, velocity, times)
        rows.append([relative(ramped(fmu, curve, stiffness, velocity, finer), exact) for finer in FINER])
    together = np.sqrt(np.mean(np.square(rows), axis=0))
    assert order(together) > 1.9
    assert np.log2(together[:-1] / together[1:]).min() > 1.8
    orders = [order(np.array(row)) for row in rows]
    assert np.median(orders) > 1.9
    assert min(orders) > 1.0


@pytest.mark.nightly
def test_the_error_of_a_step_over_a_ramp_is_small_for_any_number_of_kinks(component):
    """The drive is linear between multiples of the coarsest step, so the error is that of the FMU itself."""
    fmu, times, errors = component("maxwell"), np.arange(31) * COARSEST, []
    for curve, stiffness, velocity in random_cases()[:12]:
        knots = [velocity(t) for t in times]

        def ramp(t, knots=knots):
            k = min(int(t / COARSEST), 29)
            return knots[k] + (knots[k + 1] - knots[k]) * (t / COARSEST - k)

        exact = integrated(curve, stiffness, ramp, times)
        errors.append(relative(ramped(fmu, curve, stiffness, velocity, 1), exact))
    assert max(errors) < 5e-5


MASSES, SPRING, TIRE = (306.17484975, 34.01942775), 224162.34911548987, 227664.88582041938
ACROSS = np.array([-1.0, 1.0])


def quarter_car():
    """Return A and B for x = (z_1, z_2, z_1', z_2'), u = (road, force)."""
    a, b = np.zeros((4, 4)), np.zeros((4, 2))
    a[:2, 2:] = np.eye(2)
    a[2:, :2] = -np.array([[SPRING, -SPRING], [-SPRING, SPRING + TIRE]]) / np.array(MASSES)[:, None]
    b[2:] = np.array([[0.0, 1.0], [TIRE, -1.0]]) / np.array(MASSES)[:, None]
    return a, b


def road(t):
    """Return a smooth road of 20 mm [m]."""
    return 0.02 * np.sin(2.0 * np.pi * 3.0 * t) ** 3 + 0.004 * np.sin(2.0 * np.pi * 16.0 * t) ** 3


def coupled(fmu, curve, stiffness, finer):
    """Return F (N,) [N]: first the car, with the force extrapolated, then the shock, with the velocity interpolated."""
    h, (a, b) = COARSEST / finer, quarter_car()
    ramp = np.zeros((8, 8))  # exact for inputs that change linearly: x, u, h u'
    ramp[:4, :4], ramp[:4, 4:6], ramp[4:6, 6:] = a * h, b * h, np.eye(2)
    over = expm(ramp)[:4]
    begun(fmu, curve, stiffness, 0.0)
    x, force, slope, forces = np.zeros(4), 0.0, 0.0, [0.0]
    for k in range(round(0.2 / h)):
        before, now = ACROSS @ x[2:], road(k * h)
        x = over @ np.array([*x, now, force, road((k + 1) * h) - now, slope * h])
        after = stepped(fmu, k * h, before, ACROSS @ x[2:], h)
        force, slope = after, (after - force) / h
        forces.append(force)
    return np.array(forces)[::finer]


@pytest.mark.nightly
@pytest.mark.parametrize("scales", [(1.0, 1.0), (1.8, 0.7)])
def test_coupling_to_a_quarter_car_keeps_second_order_across_kinks(component, scales):
    curve = Curve(8000.0, 0.2, 0.12, 0.0127, (900.0, 1500.0), (0.8, 0.9), (600.0, 800.0), scales)
    stiffness, times, (a, b) = 4e6, np.arange(101) * COARSEST, quarter_car()

    def rate(t, y):
        car = a @ y[:4] + b @ np.array([road(t), y[4]])
        return [*car, stiffness * (ACROSS @ y[2:4] - velocity_under(curve, y[4]))]

    exact = solution(rate, np.zeros(5), times)[4]
    found = [coupled(component("maxwell"), curve, stiffness, finer) for finer in FINER[1:]]
    errors = np.array([relative(forces, exact) for forces in found])
    assert order(errors) > 1.8
    assert np.log2(errors[:-1] / errors[1:]).min() > 1.4
