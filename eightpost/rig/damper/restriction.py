"""Flow through an orifice beside a shim stack: pure functions of floats, [Pa] and [m3/s]."""

from __future__ import annotations

import math
from typing import NamedTuple


class Passage(NamedTuple):
    """One direction of a valve: an orifice, and beside it a shim stack over its port.

    The orifice is laminar at small and turbulent at large drops. The stack's edge leaves its seat little by little,
    its parts at pressures spread evenly from 0 to 2 s; the gap under it and the port are orifices in series:

        Q = G dp / (dp^2 + dp_t^2)^(1/4) + a L / (1 + (a L / P)^2)^(1/2) dp^(1/2)
        L = dp^2 / (4 s) up to dp = 2 s, then dp - s

    The whole drop lifts the stack, whatever share of it the port takes.

    Attributes:
        orifice: G [m3/s/Pa^0.5].
        transition: dp_t [Pa].
        opening: a, the gap's conductance over L [m3/s/Pa^1.5]; 0 without a stack.
        port: P [m3/s/Pa^0.5].
        preload: s, the mean pressure at which the edge leaves its seat [Pa].
    """

    orifice: float
    transition: float
    opening: float = 0.0
    port: float = 1.0
    preload: float = 0.0


def passage_flow(drop: float, passage: Passage) -> float:
    """Return the flow [m3/s] at a drop >= 0 [Pa]."""
    orifice, transition, opening, port, preload = passage
    lift = drop - preload if drop >= 2.0 * preload else 0.25 * drop * drop / preload
    gap = opening * lift
    ratio = gap / port
    small = orifice * drop / math.sqrt(math.sqrt(drop * drop + transition * transition))
    return small + gap * math.sqrt(drop / (1.0 + ratio * ratio))


def passage_slope(drop: float, passage: Passage) -> float:
    """Return dQ / d(dp) [m3/s/Pa] at a drop >= 0 [Pa]."""
    orifice, transition, opening, port, preload = passage
    size = drop * drop + transition * transition
    slope = orifice * (1.0 - 0.5 * drop * drop / size) / math.sqrt(math.sqrt(size))
    if opening == 0.0 or drop == 0.0:
        return slope
    whole = drop >= 2.0 * preload
    lift, growth = (drop - preload, 1.0) if whole else (0.25 * drop * drop / preload, 0.5 * drop / preload)
    series = 1.0 + (opening * lift / port) ** 2
    return slope + opening / math.sqrt(series) * (growth * math.sqrt(drop) / series + 0.5 * lift / math.sqrt(drop))
