"""Shock FMUs as data of a batch: the law and its parameters."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from cosim.components.fmu_component import FmuComponent
from cosim.study.machine.reasons import NotInBatchError
from cosim.study.machine.sources import Sources
from cosim.study.study import Parameters
from eightpost.array_types import Array

#: Laws of fmus/machine/port.h by interface.
_LAWS = {"shock_polylinear": 0, "shock_lpf1": 1, "shock_lpnl2": 1, "shock_hysteresis": 2}

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
    """A shock of a batch."""

    law: int  #: Number of its law in fmus/machine/port.h.
    parameters: Array  #: Parameters in the order of fmus/machine/component.h (P,).

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


def read_shock(component: FmuComponent, path: Path, given: Parameters) -> ShockData:
    """Return the data of a shock FMU.

    Args:
        component: FMU.
        path: FMU file.
        given: Values of parameters that differ from the FMU's.

    Raises:
        NotInBatchError: It is not a shock of this project, contains no sources, or has settings.
    """
    sources = Sources.of(component, path)
    if sources.kind not in _LAWS:
        raise NotInBatchError(f"{path.name} is {sources.kind}, a law that has no batch")
    if "settings_data.h" in sources.files:
        raise NotInBatchError(f"{path.name} has settings")
    own = component.variables.values()
    starts = {v.name: v.start for v in own if v.causality == "parameter" and v.start is not None}
    try:
        return ShockData(_LAWS[sources.kind], _parameters(sources.kind, starts | dict(given)))
    except (KeyError, ValueError) as error:
        raise NotInBatchError(f"{path.name} has other parameters than this version knows: {error}") from error


def _parameters(kind: str, values: Parameters) -> Array:
    def numbers(name: str, count: int) -> list[float]:
        names = [name] if count == 1 else [f"{name}[{k + 1}]" for k in range(count)]
        return [float(values[n]) for n in names]

    found = [number for name, count in _COMMON.items() for number in numbers(name, count)]
    has_lag = kind in ("shock_lpf1", "shock_lpnl2")
    found += numbers("time_constant", 1) if has_lag else [1.0]
    if kind == "shock_lpnl2":
        found += [float(values["lag_full_force"]), float(values["lag_zero_force"])]
    else:
        found += _NO_LAG if kind == "shock_polylinear" else _ONLY_LAG
    for name, count in _HYSTERESIS.items():
        found += numbers(name, count) if kind == "shock_hysteresis" else [1.0] * count
    return np.array(found)
