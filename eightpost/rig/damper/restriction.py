"""Flow through an orifice in parallel with a shim stack, as pure functions of floats in [Pa] and [m3/s]."""

from __future__ import annotations

import math
from typing import NamedTuple


class Passage(NamedTuple):
    """One flow direction of a valve: an orifice in parallel with a shim stack over its port.

    The flow through the orifice is laminar at small and turbulent at large pressure drops. The edge of the stack opens
    gradually, with opening pressures spread evenly from 0 to 2 s. The gap under it and the port are orifices in series:

        Q = G dp / (dp^2 + dp_t^2)^(1/4) + a L / (1 + (a L / P)^2)^(1/2) dp^(1/2)
        L = dp^2 / (4 s) up to dp = 2 s, then dp - s

    The whole pressure drop lifts the stack, even if part of the drop is in the port.

    Attributes:
        orifice: Conductance G of the orifice [m3/s/Pa^0.5].
        transition: Pressure drop dp_t of the transition from laminar to turbulent flow [Pa].
        opening: Ratio a of the gap's conductance to L [m3/s/Pa^1.5]; 0 without a stack.
        port: Conductance P of the port [m3/s/Pa^0.5].
        preload: Mean pressure s at which the edge opens [Pa].
    """

    orifice: float
    transition: float
    opening: float = 0.0
    port: float = 1.0
    preload: float = 0.0


def passage_flow(drop: float, passage: Passage) -> float:
    """Return the flow [m3/s] at a pressure drop >= 0 [Pa]."""
    orifice, transition, opening, port, preload = passage
    lift = drop - preload if drop >= 2.0 * preload else 0.25 * drop * drop / preload
    gap = opening * lift
    ratio = gap / port
    small = orifice * drop / math.sqrt(math.sqrt(drop * drop + transition * transition))
    return small + gap * math.sqrt(drop / (1.0 + ratio * ratio))


def passage_slope(drop: float, passage: Passage) -> float:
    """Return the slope dQ / d(dp) [m3/s/Pa] at a pressure drop >= 0 [Pa]."""
    orifice, transition, opening, port, preload = passage
    size = drop * drop + transition * transition
    slope = orifice * (1.0 - 0.5 * drop * drop / size) / math.sqrt(math.sqrt(size))
    if opening == 0.0 or drop == 0.0:
        return slope
    whole = drop >= 2.0 * preload
    lift, growth = (drop - preload, 1.0) if whole else (0.25 * drop * drop / preload, 0.5 * drop / preload)
    series = 1.0 + (opening * lift / port) ** 2
    return slope + opening / math.sqrt(series) * (growth * math.sqrt(drop) / series + 0.5 * lift / math.sqrt(drop))
