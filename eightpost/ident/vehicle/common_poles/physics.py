"""Physical constraints on a vehicle model that follow from the names of its channels.

Shock velocities and displacements have no direct term, and a velocity has no response at 0 Hz. A displacement is the
integral of the velocity at its port. The fit satisfies both by construction.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from eightpost.ident.response import FrequencyResponse
from eightpost.vehicle.statespace import Channel, StateSpace

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    Array = NDArray[np.float64]

#: Standard deviation of a velocity's zero response at 0 Hz, relative to its largest response [1].
_STILL = 1e-4


def direct_terms(outputs: Sequence[str], inputs: Sequence[str]) -> NDArray[np.bool_]:
    """Return which inputs may have a direct term in which outputs (p, m).

    Accelerations may have direct terms in all inputs (a solid axle and a rigid chassis connect the corners, damped
    tires the roads), tire forces and ride heights in the roads, other outputs in none.
    """
    return np.array([[_direct(output, source) for source in inputs] for output in outputs])


def _direct(output: str, source: str) -> bool:
    if output.endswith("acceleration"):
        return True
    return output.endswith(("tire_force", "ride_height")) and source.rpartition(".")[2] == "road"


def roads(inputs: Sequence[str]) -> NDArray[np.bool_]:
    """Return which inputs are roads (m,)."""
    return np.array([_ends(name, "road") for name in inputs])


def integrals(outputs: Sequence[str]) -> dict[str, str]:
    """Return the velocity of each displacement whose velocity is an output too."""
    pairs = {name: name.removesuffix("displacement") + "velocity" for name in outputs if _ends(name, "displacement")}
    return {name: velocity for name, velocity in pairs.items() if velocity in outputs}


def _ends(name: str, quantity: str) -> bool:
    return name.rpartition(".")[2] == quantity


def without_integrals(response: FrequencyResponse) -> FrequencyResponse:
    """Return the response with displacements merged into their velocities and zero velocities at 0 Hz.

    `s H_x` is a second estimate of `H_v`; the two are averaged, weighted by their variances. If the velocity was
    derived from the displacement, both come from one potentiometer, so the smaller variance is not reduced by
    averaging.
    """
    pairs = integrals(response.output_names)
    joined = response
    for displacement, velocity in pairs.items():
        joined = _joined(joined, displacement, velocity)
    joined = joined.select(outputs=[name for name in response.output_names if name not in pairs])
    return _with_rest(joined)


def _joined(response: FrequencyResponse, displacement: str, velocity: str) -> FrequencyResponse:
    if response.variance is None:
        return response
    names = response.output_names
    x, v = names.index(displacement), names.index(velocity)
    s = 2j * np.pi * response.frequency
    other, own = response.variance[x] * np.abs(s) ** 2, response.variance[v]
    known = np.isfinite(other) & np.isfinite(own)
    share = np.divide(own, own + other, out=np.zeros_like(own), where=known & (own + other > 0.0))
    H, variance = response.H.copy(), response.variance.copy()
    H[v] = (1.0 - share) * H[v] + share * s * H[x]
    variance[v] = np.where(known, np.minimum(own, other), own)
    return replace(response, H=H, variance=variance)


def _with_rest(response: FrequencyResponse) -> FrequencyResponse:
    """Add 0 Hz, where velocities are zero and other outputs unknown."""
    if response.frequency[0] == 0.0:
        return response
    H = np.concatenate((np.zeros((*response.H.shape[:2], 1)), response.H), axis=2)
    variance = response.variance
    if variance is None:
        variance = np.where(np.abs(response.H) > 0.0, 0.0, np.inf)
    largest = np.abs(response.H).max(axis=2)
    moving = np.array([_ends(name, "velocity") for name in response.output_names])[:, None]
    still = np.where(moving & (largest > 0.0), (_STILL * largest) ** 2, np.inf)
    frequency = np.concatenate(([0.0], response.frequency))
    return FrequencyResponse(
        frequency, H, response.inputs, response.outputs, None, None, np.concatenate((still[:, :, None], variance), 2)
    )


def with_integrals(model: StateSpace, outputs: Sequence[Channel]) -> StateSpace:
    """Return the model with all `outputs`; displacements are the integrals `C_v A^-1` of their velocities."""
    pairs, names = integrals([channel.name for channel in outputs]), model.output_names
    C, D = np.zeros((len(outputs), len(model.A))), np.zeros((len(outputs), len(model.inputs)))
    inverse = np.linalg.inv(model.A)
    for i, channel in enumerate(outputs):
        row = names.index(pairs.get(channel.name, channel.name))
        if channel.name in pairs:
            C[i] = model.C[row] @ inverse
        else:
            C[i], D[i] = model.C[row], model.D[row]
    return StateSpace(model.A, model.B, C, D, model.inputs, tuple(outputs), None, model.name)
