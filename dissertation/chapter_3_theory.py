"""Chapter 3.1: equations of the shock, the weight of LPNL2, and a stiffening fluid."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dissertation.checks import difference, falls, holds, shown
from dissertation.effort import Effort
from dissertation.findings import Findings
from dissertation.plots import Line, Plot, figure_of
from eightpost.array_types import Array, Complex
from eightpost.report.charts import Axis
from eightpost.shock import Lpf1, Lpnl2, StaticCurve
from eightpost.shock.curve import INNER_ORDER
from eightpost.units import si_factor
from eightpost.virtual import demo_damper, random_multisine
from eightpost.virtual.dynamometer import multisine_spectrum

_POUND = si_factor("lbf")

#: 3.3.3: time constant and transition forces of build 1.
_TAU, _LOW, _HIGH = 1.3e-3, 560.0 * _POUND, 1000.0 * _POUND


class _Fluid(NamedTuple):
    """Constants of Eq 3.1 to 3.9: areas [m2], stiffnesses [Pa/m3], flow resistance [Pa.s/m3]."""

    area_c: float
    area_r: float
    k_g: float
    k_r: float
    resistance: float

    @property
    def rod(self) -> float:
        return self.area_c - self.area_r

    def force(self, s: NDArray[Any]) -> Complex:
        """Return F/V of the state equations (Eq 3.16) at points s (K,)."""
        kg, kr, C = self.k_g, self.k_r, self.resistance
        A = np.array([[-kg / C, kg / C], [kr / C, -kr / C]])
        B, out = np.array([kg * self.area_c, -kr * self.area_r]), np.array([self.area_c, -self.area_r])
        return np.array([out @ np.linalg.solve(point * np.eye(2) - A, B) for point in s], dtype=np.complex128)

    def printed(self, s: NDArray[Any], sign: float) -> Complex:
        """Return Eq 3.17 with a sign of the last term in the brackets; print has +1."""
        both = self.k_g * self.k_r / (self.k_g + self.k_r)
        lag = self.resistance / (self.k_g + self.k_r)
        brackets = self.area_c**2 * self.k_g + self.area_r**2 * self.k_r + sign * self.rod**2 * both
        return np.asarray(self.rod**2 * both / s + lag * brackets / (lag * s + 1.0), dtype=np.complex128)


#: Plausible numbers of a race shock: piston 36 mm, rod 14 mm, 20 lbf/(in/s), lag 1.3 ms.
_SHOCK = _Fluid(1.02e-3, 0.87e-3, 1.0e10, 3.6e12, 4.6e9)
_S = 2j * np.pi * np.geomspace(0.1, 100.0, 200)


def equation_3_14(_: Effort) -> Findings:
    """Stiff chambers."""
    stiff = _SHOCK._replace(k_r=1e6 * _SHOCK.k_r)
    simple = stiff.resistance * stiff.area_r**2 + stiff.k_g * stiff.rod**2 / _S
    slow = np.abs(_S) < 2.0 * np.pi * 100.0
    # The pressure of the gas also acts on the flow: with k_g in series, the remaining difference is k_g over k_r.
    return Findings(claims={"holds": holds(difference(stiff.force(_S)[slow], simple[slow]), 1e-5)})


def equation_3_17(_: Effort) -> Findings:
    """Compare both signs with the state equations, with gas as stiff as the fluid, where the term matters."""
    fluid = _SHOCK._replace(k_g=0.5 * _SHOCK.k_r, area_r=0.5 * _SHOCK.area_c)
    exact = fluid.force(_S)
    plus, minus = (difference(fluid.printed(_S, sign) * _S, exact * _S) for sign in (1.0, -1.0))
    real = difference(_SHOCK.printed(_S, 1.0) * _S, _SHOCK.force(_S) * _S)
    return Findings(
        claims={"printed": holds(plus), "minus": holds(minus)},
        note="The sum of the squared terms is complete, (k_g' A_c + k_r A_r)^2 / (k_g' + k_r), only with a minus sign. "
        f"With the stiffnesses of a race shock the difference is {100.0 * real:.1g} %; Eq 3.18 drops the term.",
    )


def equation_3_18(_: Effort) -> Findings:
    """Gas spring a million times softer than the fluid."""
    soft = _SHOCK._replace(k_g=1e-6 * _SHOCK.k_r)
    lag = 1.0 / (soft.resistance / soft.k_r * _S + 1.0)
    simple = lag * soft.resistance * soft.area_r**2 + soft.k_g * soft.rod**2 / _S
    return Findings(claims={"holds": holds(difference(soft.force(_S), simple), 1e-4)})


def equation_3_21(_: Effort) -> Findings:
    """Insert Eq 3.22 into Eq 3.21."""
    fluid = _SHOCK
    c, k_s = fluid.resistance * fluid.area_r**2, fluid.k_r * fluid.area_r**2
    mechanical = c / (c / k_s * _S + 1.0)
    hydraulic = fluid.resistance * fluid.area_r**2 / (fluid.resistance / fluid.k_r * _S + 1.0)
    return Findings(claims={"holds": holds(difference(mechanical, hydraulic))})


# ---- LPF1 and LPNL2 -------------------------------------------------------------------------------------------------


def _curve() -> StaticCurve:
    """Return a linear curve of 20 lbf/(in/s), so that the lag alone is checked."""
    rate = 20.0 * si_factor("lbf/(in/s)")
    inner, outer = (rate, *[0.0] * (INNER_ORDER - 1)), (rate, rate, 0.0, 0.0)
    rebound = (-rate, -rate, 0.0, 0.0)
    return StaticCurve(inner, outer, rebound, 1.0, 0.1, 2.0, 2.0, rate, rate)


def _forces(law: Lpf1 | Lpnl2, velocity: Array, step: float) -> Array:
    """Return the force (N,) of our law along a velocity (N,)."""
    state, found = law.start(float(velocity[0])), [law.static_force(float(velocity[0]))]
    for before, after in zip(velocity[:-1].tolist(), velocity[1:].tolist(), strict=True):
        state = law.follow(state, before, after, step)
        found.append(law.response(state, after, 0.0).force)
    return np.array(found)


def _small_steps(velocity: Array, step: float, weight: float) -> Array:
    """Return the force (N,) of Eq 3.24 and 3.25 by Heun's method with 100 steps per sample; weight 1: LPF1."""
    many = 100
    fine = np.interp(np.arange((velocity.size - 1) * many + 1) / many, np.arange(velocity.size), velocity)
    static = 20.0 * si_factor("lbf/(in/s)") * fine
    h, lag = step / many, np.empty_like(static)
    lag[0] = static[0]
    for k in range(1, lag.size):
        first = (static[k - 1] - lag[k - 1]) / _TAU
        second = (static[k] - lag[k - 1] - h * first) / _TAU
        lag[k] = lag[k - 1] + 0.5 * h * (first + second)
    alpha = np.clip((_HIGH - np.abs(static)) / (_HIGH - _LOW), 0.0, 1.0) if weight else np.ones_like(static)
    return np.asarray((alpha * lag + (1.0 - alpha) * static)[::many])


def _sweep() -> tuple[Array, float]:
    """Return a velocity (N,) up to 1.5 m/s with a step of 2 ms."""
    step = 2e-3
    time = np.arange(0.0, 0.5, step)
    return 1.5 * np.sin(2.0 * np.pi * (2.0 + 10.0 * time) * time), step


def equation_3_24(_: Effort) -> Findings:
    """LPF1 with steps longer than the time constant."""
    velocity, step = _sweep()
    ours = _forces(Lpf1(_curve(), time_constant=_TAU), velocity, step)
    return Findings(claims={"holds": holds(difference(ours, _small_steps(velocity, step, 0.0)), 1e-4)})


def equation_3_25(_: Effort) -> Findings:
    """LPNL2 with the printed transition forces."""
    velocity, step = _sweep()
    law = Lpnl2(_curve(), time_constant=_TAU, lag_full_force=_LOW, lag_zero_force=_HIGH)
    ours = _forces(law, velocity, step)
    return Findings(claims={"holds": holds(difference(ours, _small_steps(velocity, step, 1.0)), 1e-4)})


def figure_3_8(_: Effort) -> Findings:
    """Weight over the force."""
    law = Lpnl2(_curve(), time_constant=_TAU, lag_full_force=_LOW, lag_zero_force=_HIGH)
    force = np.linspace(0.0, 1.3 * _HIGH, 2601)
    weight = np.array([law.lag_weight(one) for one in force.tolist()])
    plot = Plot("", Axis("static force", "N"), Axis("weight of the lagged force"), [Line("weight", force, weight)])
    return Findings(
        {"low": float(force[weight >= 1.0 - 1e-9][-1]), "high": float(force[weight <= 1e-9][0])},
        blocks=[figure_of("Weight of the lagged force with the transition forces of 3.3.3.", [plot], columns=1)],
    )


def figure_3_7(_: Effort) -> Findings:
    """Stiffness k0 (1 + |F| / F1) and time constant (dF/dv) / k over velocity."""
    damper = demo_damper("A")
    velocity = np.linspace(0.01, 1.5, 120)
    force = np.array([damper.static_force(v) for v in velocity.tolist()])
    stiffness = damper.fluid_stiffness * (1.0 + force / damper.stiffening_force)
    tau = np.gradient(force, velocity) / stiffness
    x = Axis("velocity", "m/s")
    plots = [
        Plot("fluid stiffness", x, Axis("stiffness", "N/m"), [Line("damper", velocity, stiffness)]),
        Plot("time constant", x, Axis("time constant [ms]"), [Line("damper", velocity, 1e3 * tau)]),
    ]
    ends = [float(tau[velocity <= 0.3].max()), float(tau[-1])]
    return Findings(
        claims={
            "stiffness": (falls(stiffness[::-1]), f"{shown(stiffness[[0, -1]] / 1e3, 'N/mm')}"),
            "time_constant": (
                ends[0] > 2.0 * ends[1],
                f"up to 0.3 m/s at most {1e3 * ends[0]:.2g} ms, at 1.5 m/s {1e3 * ends[1]:.2g} ms",
            ),
        },
        blocks=[figure_of("A damper in series with a stiffening fluid spring.", plots, columns=2)],
    )


def equation_3_26(_: Effort) -> Findings:
    """Amplitudes of one period, relative to their sum of squares, against the interpolated table."""
    values = random_multisine(3).series["displacement"][: round(10.0 * 2000.0)]
    lines = np.abs(np.fft.rfft(values))
    _frequencies, wanted = multisine_spectrum()
    expected = np.zeros_like(lines)
    expected[1 : wanted.size + 1] = wanted
    return Findings(claims={"holds": holds(difference(lines / lines.max(), expected))})


COMPUTATIONS = {
    "figure-3.7": figure_3_7,
    "figure-3.8": figure_3_8,
    "equation-3.14": equation_3_14,
    "equation-3.17": equation_3_17,
    "equation-3.18": equation_3_18,
    "equation-3.21": equation_3_21,
    "equation-3.24": equation_3_24,
    "equation-3.25": equation_3_25,
    "equation-3.26": equation_3_26,
}
