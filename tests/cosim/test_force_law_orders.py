"""Orders of accuracy of force laws and held forces, against the whole system as one differential equation."""

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from cosim import ExtrapolatedForce, ForceLaw, HeldForce

MASS, SPRING, STOP = 60.0, 4e4, 0.2


def push(t):
    return 150.0 * math.sin(20.0 * t) + 80.0 * math.sin(45.0 * t)


def exact(law):
    """Position and velocity at STOP: m x'' = push - k x - F, with the shock's F_lag as a state."""

    def slope(t, y):
        static = law.static_force(y[1])
        weight = law.lag_weight(static)
        port = law.port
        force = weight * y[2] + (1.0 - weight) * static + port.gas_preload + port.gas_stiffness * y[0]
        force += port.seal_friction * math.tanh(y[1] / port.friction_velocity)
        return [y[1], (push(t) - SPRING * y[0] - force) / MASS, (static - y[2]) / getattr(law, "time_constant", 1.0)]

    found = solve_ivp(slope, (0.0, STOP), [0.0, 0.0, 0.0], method="DOP853", rtol=1e-12, atol=1e-12)
    return found.y[:2, -1]


def acceleration(t, y, force):
    return np.array([y[1], (push(t) - SPRING * y[0] - force) / MASS])


def by_runge_kutta(law, h):
    y = np.zeros(2)
    law.start(0.0, 0.0)
    for n in range(round(STOP / h)):
        t = n * h
        a = acceleration(t, y, law.force(t, y[1], y[0]))
        b = acceleration(t + h / 2, y + h / 2 * a, law.force(t + h / 2, *(y + h / 2 * a)[::-1]))
        c = acceleration(t + h / 2, y + h / 2 * b, law.force(t + h / 2, *(y + h / 2 * b)[::-1]))
        d = acceleration(t + h, y + h * c, law.force(t + h, *(y + h * c)[::-1]))
        y = y + h / 6 * (a + 2 * b + 2 * c + d)
        law.accept(t + h, y[1], y[0])
    return y


def by_trapezoidal_rule(law, h):
    """Newton's method with the law's Jacobian; returns y and the largest number of iterations."""
    y, most = np.zeros(2), 0
    force = law.start(0.0, 0.0)
    for n in range(round(STOP / h)):
        t, old, new = n * h, acceleration(n * h, y, force), y.copy()
        for iteration in range(12):  # noqa: B007
            miss = new - y - h / 2 * (old + acceleration(t + h, new, law.force(t + h, new[1], new[0])))
            if np.abs(miss).max() < 1e-13:
                break
            by_velocity, by_displacement = law.jacobian(t + h, new[1], new[0])
            slopes = np.array([[0.0, 1.0], [-(SPRING + by_displacement) / MASS, -by_velocity / MASS]])
            new = new - np.linalg.solve(np.eye(2) - h / 2 * slopes, miss)
        y, most = new, max(most, iteration)
        force = law.accept(t + h, y[1], y[0])
    return y, most


def by_held_force(loop, h):
    """The host integrates exactly enough: fourth order with a constant force."""
    y = np.zeros(2)
    loop.start(0.0, 0.0)
    for n in range(round(STOP / h)):
        t, force = n * h, loop.step(n * h, h, y[1], y[0])
        a = acceleration(t, y, force)
        b = acceleration(t + h / 2, y + h / 2 * a, force)
        c = acceleration(t + h / 2, y + h / 2 * b, force)
        d = acceleration(t + h, y + h * c, force)
        y = y + h / 6 * (a + 2 * b + 2 * c + d)
    return y


#: Steps with which orders are measured [s]: with lag they must be well below its time constant of 1.3 ms.
MEASURED = {"polylinear": (2e-3, 1e-3), "lpf1": (4e-4, 2e-4)}


def order_of(solve, true, name):
    coarse, fine = (np.abs(solve(h) - true).max() for h in MEASURED[name])
    return math.log2(coarse / fine)


#: Tests of orders have no seal drag, whose change of sign within 5 mm/s no step resolves.
SMOOTH = {"seal_friction": 0.0, "gas_preload": 0.0}


@pytest.fixture(scope="module")
def truth(shocks):
    """Return the exact end of the motion with a law, without seal drag."""

    @cache
    def solved(name):
        law = shocks[name].law
        return exact(replace(law, port=replace(law.port, **SMOOTH)))

    return solved


@pytest.mark.repeated
@pytest.mark.parametrize(("name", "low", "high"), [("polylinear", 3.7, 4.3), ("lpf1", 1.8, 2.3)])
def test_runge_kutta_keeps_fourth_order_without_lag_and_has_the_second_order_of_ramps_with_lag(
    fmus, truth, name, low, high
):
    with ForceLaw(fmus[name], parameters=SMOOTH) as law:
        assert low < order_of(lambda h: by_runge_kutta(law, h), truth(name), name) < high


@pytest.mark.parametrize("name", ["polylinear", "lpf1"])
def test_an_implicit_method_keeps_its_order_and_newton_converges_in_few_iterations(fmus, truth, name):
    with ForceLaw(fmus[name], parameters=SMOOTH) as law:
        assert 1.8 < order_of(lambda h: by_trapezoidal_rule(law, h)[0], truth(name), name) < 2.2
        assert by_trapezoidal_rule(law, 4e-3)[1] <= 4


@pytest.mark.parametrize(("kind", "name", "order"), [(HeldForce, "polylinear", 1), (ExtrapolatedForce, "lpf1", 2)])
def test_the_held_force_is_of_first_order_and_the_extrapolated_one_of_second(fmus, truth, kind, name, order):
    with kind(fmus[name], parameters=SMOOTH) as loop:
        assert order_of(lambda h: by_held_force(loop, h), truth(name), name) == pytest.approx(order, abs=0.2)
