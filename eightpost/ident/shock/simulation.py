"""Simulation of a law over a whole record with array operations, with the results of the scalar law."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from types import FunctionType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eightpost.array_types import Array
from eightpost.ident.shock.curve import curve_forces
from eightpost.shock import ShockLaw, fit_form, law_module, own_values
from eightpost.shock.law import MOST_PIECES, STRAIGHT
from eightpost.signals import TimeSeries
from eightpost.signals.filters import recursion


def simulate(law: ShockLaw, series: TimeSeries) -> Array:
    """Return the port force (N,) [N], positive in compression, of a law driven by a record.

    The velocity changes linearly between the samples, the static force in the straight pieces of `ShockLaw.follow`, as
    in the FMU, and the lag starts in equilibrium, F_lag = F_s.

    Args:
        law: Law with its port.
        series: `velocity` [m/s] at the port; `displacement` [m] from the gas spring's reference, 0 if missing.

    Raises:
        MissingChannelError: The record has no velocity.
    """
    port = law.port
    velocity = port.motion_ratio * series["velocity"]
    displacement = series["displacement"] if "displacement" in series else np.zeros(len(series))
    valve = _valve_forces(law, velocity, series)
    seal = port.seal_friction * np.tanh(velocity / port.friction_velocity)
    gas = port.gas_preload + port.gas_stiffness * port.motion_ratio * displacement
    return np.asarray(port.motion_ratio * (valve + seal + gas), dtype=np.float64)


def _static_forces(law: ShockLaw, velocity: Array) -> Array:
    """Return F_s (N,) [N] at damper velocities (N,) [m/s]."""
    scales = np.where(velocity > 0.0, law.port.compression_scale, law.port.rebound_scale)
    return np.asarray(scales * curve_forces(law.curve, velocity))


def _valve_forces(law: ShockLaw, velocity: Array, series: TimeSeries) -> Array:
    """Return alpha F_lag + (1 - alpha) F_s (N,) [N] over damper velocity (N,) [m/s]."""
    form = fit_form(type(law))
    if form == "no lag" or len(series) < 2:
        return _static_forces(law, velocity)
    step = np.full(len(series) - 1, 1.0 / series.sample_rate) if series.is_uniform else np.diff(series.time)
    pieces = Pieces.of(series["velocity"], step, law.port.motion_ratio)
    if form not in ("lag", "fading lag"):
        return _stepped(law, pieces)
    static, own = _static_forces(law, velocity), own_values(law)
    weight: Array | float = array_form(law_module(type(law)).weight_core)(static, own)
    return weight * _lagged(law, own[0], static[0], pieces) + (1.0 - weight) * static


@dataclass(frozen=True, slots=True, eq=False)
class Pieces:
    """Intervals between samples, divided into pieces in which F_s is linear: `ShockLaw.follow` for a whole record."""

    velocity: Array  #: Damper velocity (M+1,) at the ends of the pieces [m/s], preceded by that of the first sample.
    step: Array  #: Duration (M,) of each piece [s].
    first: NDArray[np.int64]  #: Index (N-1,) of the first piece after each sample.
    left: Array  #: Time (M,) from the end of each piece to the next sample [s].
    between: Array  #: Time (N-1,) from sample to sample [s].

    @staticmethod
    def of(velocity: Array, step: Array, motion_ratio: float) -> Pieces:
        """Divide the intervals of steps (N-1,) [s] between port velocities (N,) [m/s]."""
        count = np.minimum(np.floor(np.abs(motion_ratio * np.diff(velocity)) / STRAIGHT) + 1.0, MOST_PIECES)
        whole = count.astype(np.int64)
        first = np.concatenate([[0], np.cumsum(whole)[:-1]])
        sample = np.repeat(np.arange(len(step)), whole)
        share = (np.arange(len(sample)) - first[sample] + 1) / count[sample]
        start, end = velocity[:-1][sample], velocity[1:][sample]
        ends = np.where(share == 1.0, end, start + (end - start) * share)
        joined = motion_ratio * np.concatenate([velocity[:1], ends])
        return Pieces(joined, (step / count)[sample], first, step[sample] * (1.0 - share), step)

    def at_samples(self, values: Array) -> Array:
        """Return the values at the samples (N,), given values (M+1,) at the ends of the pieces."""
        return np.concatenate([values[self.first], values[-1:]])


def _lagged(law: ShockLaw, time_constant: float, begin: float, pieces: Pieces) -> Array:
    """Return F_lag (N,) [N], as `eightpost.shock.lag.advance` computes it, for all pieces at once."""
    static = _static_forces(law, pieces.velocity)
    ratio = pieces.step / time_constant
    rise = -np.expm1(-ratio)
    gained = static[:-1] * rise + np.diff(static) * (1.0 - rise / ratio)
    gained = np.add.reduceat(gained * np.exp(-pieces.left / time_constant), pieces.first)
    kept = np.exp(-pieces.between / time_constant)
    if np.all(kept == kept[0]):
        return recursion(np.concatenate([[begin], gained]), [-kept[0]])
    lagged = [begin]
    for share, more in zip(kept.tolist(), gained.tolist(), strict=True):
        lagged.append(share * lagged[-1] + more)
    return np.array(lagged)


@cache
def array_form(core: FunctionType) -> Callable[..., Any]:
    """Return a function of a law's file for static forces (N,): its own code with the functions of numpy."""
    functions = {"min": np.minimum, "max": np.maximum, "copysign": np.copysign}
    return FunctionType(core.__code__, core.__globals__ | functions)


def _stepped(law: ShockLaw, pieces: Pieces) -> Array:
    """Return the valve force (N,) [N] of any law from its own compiled functions."""
    from eightpost.shock.compiled import stepped_force  # noqa: PLC0415 - the compiler takes a second to load

    valve = law.valve._replace(curve=law.curve.numbers())
    return pieces.at_samples(stepped_force(type(law), valve, own_values(law), pieces.velocity, pieces.step))
