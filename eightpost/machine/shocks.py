"""Shocks as the machine takes them: the law and its parameters."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from eightpost.array_types import Array
from eightpost.machine.reasons import NotInBatchError

#: Laws of fmus/machine/port.h by name.
LAWS = {"polylinear": 0, "lpf1": 1, "lpnl2": 1, "hysteresis": 2}

#: Limits of the lagged force with which the weight of the lag is always 0, or always 1 [N].
_NO_LAG, _ONLY_LAG = (-2.0, -1.0), (0.0, 1e300)

#: Parameters in the order of fmus/machine/component.h, with their number; the last ones are those of single laws.
_COMMON = {
    "motion_ratio": 1, "compression_scale": 1, "rebound_scale": 1, "gas_stiffness": 1, "gas_preload": 1,
    "seal_friction": 1, "friction_velocity": 1, "curve.transition_speed": 1, "curve.transition_width": 1,
    "curve.compression_speed": 1, "curve.rebound_speed": 1, "curve.compression_slope": 1, "curve.rebound_slope": 1,
    "curve.inner": 15, "curve.compression": 4, "curve.rebound": 4, "curve.knot_velocity": 25, "curve.knot_force": 25,
    "curve.knot_slope": 25,
}  # fmt: skip
_HYSTERESIS = {"time_constant": 3, "stop_stiffness": 1, "stop_yield": 1, "stop_time": 1, "curve.lagged_slope": 25}


@dataclass(frozen=True, slots=True, eq=False)
class ShockData:
    """A shock as the machine takes it."""

    law: int  #: Number of its law in fmus/machine/port.h.
    parameters: Array  #: Parameters in the order of fmus/machine/component.h (P,).

    @classmethod
    def of(cls, name: str, numbers: Callable[[str, int], Sequence[float]]) -> ShockData:
        """Return a shock.

        Args:
            name: Name of its law.
            numbers: Function that returns the values of a parameter, given its name and their number.

        Raises:
            NotInBatchError: The machine does not have the law.
        """
        if name not in LAWS:
            raise NotInBatchError(f"the machine does not have the law {name}")
        found = [number for parameter, count in _COMMON.items() for number in numbers(parameter, count)]
        found += numbers("time_constant", 1) if name in ("lpf1", "lpnl2") else [1.0]
        if name == "lpnl2":
            found += [*numbers("lag_full_force", 1), *numbers("lag_zero_force", 1)]
        else:
            found += _NO_LAG if name == "polylinear" else _ONLY_LAG
        for parameter, count in _HYSTERESIS.items():
            found += numbers(parameter, count) if name == "hysteresis" else [1.0] * count
        return cls(LAWS[name], np.array(found))

    @classmethod
    def of_law(cls, name: str, law: Any) -> ShockData:
        """Return the shock of a law of eightpost.shock and its name; see `of`."""

        def numbers(parameter: str, _: int) -> list[float]:
            plain = parameter.removeprefix("curve.")
            owner = next(one for one in (law, law.curve, law.port) if hasattr(one, plain))
            values: list[float] = np.ravel(getattr(owner, plain)).tolist()
            return values

        return cls.of(name, numbers)

    def mean_slope(self, velocity: float) -> float:
        """Return about the mean slope of the static curve at the port, up to a velocity [N.s/m]."""
        own = dict(zip(_COMMON, np.split(self.parameters, np.cumsum([*_COMMON.values()])), strict=False))
        ratio, speed = own["motion_ratio"].item(), own["curve.transition_speed"].item()
        v = ratio * velocity
        if own["curve.knot_velocity"][-1] > 0.0:
            force = np.interp([-v, v], own["curve.knot_velocity"], own["curve.knot_force"])
        else:
            force = np.polyval([*own["curve.inner"][::-1], 0.0], np.clip([-v / speed, v / speed], -1.0, 1.0))
        scaled = own["compression_scale"] * force[1] - own["rebound_scale"] * force[0]
        return float(ratio * scaled.item() / (2.0 * velocity))
