"""Force that a dynamometer would measure, predicted by a fitted shock, and its score."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from eightpost.array_types import Array
from eightpost.errors import InputError
from eightpost.ident.shock.simulation import simulate
from eightpost.shock import Shock, ShockLaw
from eightpost.signals import TimeSeries

if TYPE_CHECKING:
    from eightpost.rig import DynoTest

    #: A record, or samples (N,) of the velocity [m/s], or (N, 2) of velocity and displacement [m].
    Motion = TimeSeries | DynoTest | Array


def reference_of(shock: Shock, otherwise: float) -> float:
    """Return the reference displacement of a shock's gas force [m], or `otherwise` if the file does not state it."""
    return float(shock.conditions.get("displacement_reference [m]", otherwise))


def as_measured(shock: Shock) -> ShockLaw:
    """Return the law as measured on a dynamometer: the damper itself, with its gas force."""
    gas = {}
    if shock.conditions.get("gas_treatment") == "included":
        gas = {name: shock.conditions[f"{name}_estimate [{unit}]"]
               for name, unit in (("gas_preload", "N"), ("gas_stiffness", "N/m"))}  # fmt: skip
    return replace(shock.law, port=replace(shock.law.port, motion_ratio=1.0, **gas))


def predicted_force(shock: Shock, motion: Motion, step: float | None) -> Array:
    """Return the predicted force (N,) [N]; see `ShockFit.predict`."""
    series = _series(motion, step)
    if "displacement" in series:
        moved = series["displacement"] - reference_of(shock, float(series["displacement"].mean()))
        series = series.with_channel("displacement", "m", moved)
    return simulate(as_measured(shock), series)


def r_squared(shock: Shock, motion: Motion, force: Array | None, step: float | None) -> float:
    """Return the coefficient of determination of the predicted force; see `ShockFit.score`."""
    measured = _series(motion, step)["force"] if force is None else np.asarray(force, dtype=np.float64)
    predicted = predicted_force(shock, motion, step)
    if measured.shape != predicted.shape:
        raise InputError(f"the force has the shape {measured.shape}, and the motion {predicted.shape}; give as many")
    return float(1.0 - np.sum((measured - predicted) ** 2) / np.sum((measured - measured.mean()) ** 2))


def _series(motion: Motion, step: float | None) -> TimeSeries:
    """Return the record of a motion."""
    series = motion if isinstance(motion, TimeSeries) else getattr(motion, "series", None)
    if isinstance(series, TimeSeries):
        return series
    columns = np.asarray(motion, dtype=np.float64)
    columns = columns[:, None] if columns.ndim == 1 else columns
    if columns.ndim != 2 or columns.shape[1] > 2:
        raise InputError(f"an array of the shape {columns.shape}; give velocities (N,), or (N, 2) with displacements")
    if step is None:
        raise InputError("an array has no times; give the step between its samples in seconds: step=0.001")
    named = zip((("velocity", "m/s"), ("displacement", "m")), columns.T, strict=False)
    channels = {name: (unit, values) for (name, unit), values in named}
    return TimeSeries.from_channels(step * np.arange(len(columns)), channels)
