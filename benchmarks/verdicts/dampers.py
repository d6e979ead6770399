"""Virtual dampers, and their kinds by set: tune, check, and final, with which no rule was chosen."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from numba import njit

from benchmarks.table import log_uniform as between
from eightpost.array_types import Array

#: Rate of the simulation [Hz].
RATE = 4000.0


@dataclass(frozen=True, slots=True)
class Damper:
    """Parameters, SI; pairs are for compression and rebound, forces are pressures times the piston's area."""

    #: Slope of the force over the velocity of the flow below the blow-off [N.s/m].
    laminar: tuple[float, float] = (4000.0, 6000.0)
    bleed: tuple[float, float] = (0.01, 0.01)  #: Flow velocity of an orifice at 1 kN [m/s].
    blow_off: tuple[float, float] = (400.0, 600.0)  #: Force at which the valve opens [N].
    opened: tuple[float, float] = (1000.0, 1500.0)  #: Slope of the force over the velocity beyond [N.s/m].
    orifice: float = 200.0  #: Force of a port in series, per square of the velocity [N.s2/m2].
    closing: float = 1.0  #: Force at which an open valve closes, over `blow_off`; 1 for a valve without hysteresis.
    opening_time: float = 0.0  #: Time constant of the valve [s]; 0 for one that follows at once.
    stiffness: float = 1.5e6  #: Stiffness of oil and mounts in series [N/m].
    friction: float = 30.0  #: Dry friction [N].
    presliding: float = 5e-5  #: Displacement within which friction builds up [m].
    stribeck: float = 0.0  #: Additional friction at standstill, which fades within 10 mm/s [N].
    gas: float = 200.0  #: Force of the gas in the middle position [N].
    gas_stiffness: float = 1000.0  #: Stiffness of the gas there [N/m]; it rises as the gas is compressed.
    cavitation: float = 1e5  #: Largest force in rebound before the oil separates [N].
    bypass: float = 0.0  #: Additional share of the flow in the middle position, within 5 mm of it.
    cushion: float = 0.0  #: Damping that begins at 70 % of the stroke `reach`, at its end [N.s/m].
    reach: float = 0.03  #: Largest travel from the middle [m].
    selective: float = 0.0  #: Stiffness of a valve whose leak closes within 10 ms (frequency-selective) [N/m].
    play: float = 0.0  #: Free play of a mount [m].
    gas_in_oil: float = 0.0  #: Force below which the oil is softened by gas bubbles [N].
    warming: float = 0.0  #: Temperature rise per work [K/J].
    fading: float = 0.0  #: Relative loss of damping per kelvin.
    yield_force: float = 0.0  #: Force of a magneto-rheological valve beside the others [N].

    def respond(self, displacement: Array, warm: float = 0.0) -> tuple[Array, Array]:
        """Return force [N] and temperature above the reference [K], (N,) each, along a displacement (N,) at `RATE`.

        Args:
            displacement: Travel from the middle [m], positive in compression.
            warm: Temperature at the start above the reference [K].
        """
        values = np.array([v for value in asdict(self).values() for v in np.atleast_1d(value)])
        force, temperature = _simulate(displacement, values, warm)
        gas = self.gas * (1.0 - self.gas_stiffness * displacement / max(self.gas, 1.0) / 1.3) ** -1.3
        linear = self.gas + self.gas_stiffness * displacement
        return force + np.where(self.gas_stiffness * self.reach < 0.8 * self.gas, gas, linear), temperature


@njit  # type: ignore[untyped-decorator]
def _flow(p: float, v: Array, side: int, share: float, soft: float) -> float:
    """Return the flow velocity [m/s] at a force `p` >= 0 across the valves; `share` of the valve is open."""
    flow = p / v[side] + v[2 + side] * (np.sqrt(p / 1000.0 + 1e-6) - 1e-3)
    return float(soft * (flow + share * max(0.0, p - v[4 + side]) / v[6 + side]))


@njit  # type: ignore[untyped-decorator]
def _simulate(x: Array, v: Array, warm: float) -> tuple[Array, Array]:
    step, n = 1.0 / RATE, x.size
    force, heat = np.zeros(n), np.full(n, warm)
    (orifice, closing, opening, k, friction, presliding, stribeck) = v[8:15]
    (cavity, bypass, cushion, reach, selective, play, bubbles, warming, fading, strength) = v[17:27]
    p = z = void = slow = mount = gel = 0.0
    share = np.ones(2)
    is_open = np.zeros(2)
    y = x[0]
    for i in range(1, n):
        move = x[i] - x[i - 1]
        if play > 0.0:  # the mount moves freely within its play
            mount = min(max(mount + move, -0.5 * play), 0.5 * play)
            target = x[i] - mount
            move, y = target - y, target
        speed = move / step
        soft = (1.0 + bypass * np.exp(-((x[i] / 0.005) ** 2))) * np.exp(fading * heat[i - 1])
        if void > 0.0 and speed > 0.0:  # compression first closes the void
            used = min(void, move)
            void -= used
            speed -= used / step
        spring = k / (1.0 + 4.0 * np.exp(-abs(p) / bubbles)) if bubbles > 0.0 else k
        low, high = -2e5, 2e5
        for _ in range(60):  # implicit step of dp/dt = k (speed - flow)
            middle = 0.5 * (low + high)
            side = 0 if middle > 0.0 else 1
            flow = _flow(abs(middle), v, side, share[side], soft) * (1.0 if middle > 0.0 else -1.0)
            if middle - p - step * spring * (speed - flow) > 0.0:
                high = middle
            else:
                low = middle
        p = 0.5 * (low + high)
        if p < -cavity:
            side = 1
            void += max(0.0, -move - step * _flow(cavity, v, side, share[side], soft))
            p = -cavity
        for side in range(2):
            q = p if side == 0 else -p
            if closing < 1.0 or opening > 0.0:
                is_open[side] = 1.0 if q > v[4 + side] else (is_open[side] if q > closing * v[4 + side] else 0.0)
                wanted = 0.4 + 0.6 * is_open[side]
                share[side] += (wanted - share[side]) * (step / (opening + step))
        slow += (selective * speed - slow / 0.01) * step
        rub = friction + stribeck * np.exp(-((speed / 0.01) ** 2))
        z += move - (abs(move) * z / presliding)
        z = min(max(z, -presliding), presliding)
        gel += (speed - gel) * min(1.0, step / 0.004)
        end = max(0.0, abs(x[i]) / reach - 0.7) / 0.3
        total = p + orifice * speed * abs(speed) + slow + rub * z / presliding
        total += strength * np.tanh(gel / 0.02) + cushion * end * speed
        heat[i] = heat[i - 1] + warming * abs(total * move) - heat[i - 1] * step / 300.0
        force[i] = total
    force[0] = force[1]
    return force, heat


Random = np.random.Generator
Kind = Callable[[Random], Damper]


def pair(random: Random, low: float, high: float) -> tuple[float, float]:
    """Return one number for each stroke."""
    return between(random, low, high), between(random, low, high)


def common(random: Random) -> dict[str, Any]:
    """Return gas, friction and stiffness, which every damper has."""
    gas = random.uniform(50.0, 500.0)
    return {
        "gas": gas, "gas_stiffness": random.uniform(0.0, 3000.0), "friction": between(random, 5.0, 100.0),
        "presliding": between(random, 2e-5, 2e-4), "stiffness": between(random, 3e5, 6e6), "reach": 0.03,
    }  # fmt: skip


def digressive(random: Random) -> Damper:
    """A valve that blows off."""
    slope = pair(random, 2500.0, 12000.0)
    knee = pair(random, 0.03, 0.15)
    return Damper(laminar=slope, blow_off=(slope[0] * knee[0], slope[1] * knee[1]), opened=pair(random, 500.0, 2500.0),
                  bleed=pair(random, 0.002, 0.03), orifice=between(random, 20.0, 500.0), **common(random))  # fmt: skip


def linear(random: Random) -> Damper:
    """Laminar flow alone."""
    return Damper(laminar=pair(random, 800.0, 8000.0), blow_off=(1e5, 1e5), bleed=(1e-4, 1e-4), orifice=0.0,
                  **common(random))  # fmt: skip


def progressive(random: Random) -> Damper:
    """Orifices: little force at low speed."""
    return Damper(laminar=pair(random, 500.0, 3000.0), blow_off=(1e5, 1e5), bleed=pair(random, 0.02, 0.2),
                  orifice=between(random, 1000.0, 15000.0), **common(random))  # fmt: skip


def soft(random: Random) -> Damper:
    """Much lag: soft mounts or oil."""
    known = common(random) | {"stiffness": between(random, 6e4, 4e5)}
    slope = pair(random, 2500.0, 10000.0)
    return Damper(laminar=slope, blow_off=(0.07 * slope[0], 0.05 * slope[1]), opened=pair(random, 500.0, 2000.0),
                  **known)  # fmt: skip


def rough(random: Random) -> Damper:
    """Much dry friction, larger at standstill."""
    friction, more = between(random, 80.0, 300.0), between(random, 10.0, 200.0)
    return replace(digressive(random), friction=friction, stribeck=more)


def hysteretic(random: Random) -> Damper:
    """A valve that opens late and closes at a lower pressure."""
    opening_time = between(random, 5e-4, 1e-2)
    return replace(digressive(random), closing=random.uniform(0.4, 0.9), opening_time=opening_time)


def cavitating(random: Random) -> Damper:
    """Oil separates in fast rebound."""
    base = digressive(random)
    return replace(base, cavitation=base.blow_off[1] * random.uniform(1.1, 1.8))


def fading(random: Random) -> Damper:
    """Oil that warms and thins."""
    warming = between(random, 2e-4, 1e-2)
    return replace(digressive(random), warming=warming, fading=random.uniform(0.003, 0.015))


#: Kinds of the sets.
TUNE: Mapping[str, Kind] = {"digressive": digressive, "linear": linear, "soft": soft, "rough": rough, "fading": fading}
CHECK: Mapping[str, Kind] = {"progressive": progressive, "hysteretic": hysteretic, "cavitating": cavitating}


def bypassed(random: Random) -> Damper:
    """Softer in the middle of the stroke."""
    return replace(digressive(random), bypass=between(random, 0.05, 1.0))


def cushioned(random: Random) -> Damper:
    """A hydraulic stop near the ends of the stroke."""
    cushion = between(random, 500.0, 10000.0)
    return replace(digressive(random), cushion=cushion, reach=between(random, 0.015, 0.04))


def selective(random: Random) -> Damper:
    """Frequency-selective damping."""
    return replace(digressive(random), selective=between(random, 5e3, 2e5))


def loose(random: Random) -> Damper:
    """Play of a mount."""
    return replace(digressive(random), play=between(random, 2e-5, 5e-4))


def aerated(random: Random) -> Damper:
    """Oil with bubbles, soft at low pressure."""
    bubbles = between(random, 30.0, 500.0)
    return replace(digressive(random), gas_in_oil=bubbles, stiffness=between(random, 3e5, 2e6))


def magnetic(random: Random) -> Damper:
    """A magneto-rheological valve."""
    return Damper(laminar=pair(random, 600.0, 3000.0), blow_off=(1e5, 1e5), yield_force=between(random, 50.0, 1500.0),
                  **common(random))  # fmt: skip


FINAL: Mapping[str, Kind] = {kind.__name__: kind for kind in (bypassed, cushioned, selective, loose, aerated, magnetic)}
