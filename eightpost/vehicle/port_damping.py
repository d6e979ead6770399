"""Addition and removal of linear dampers at the shock ports of a vehicle."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from eightpost.errors import ParameterError
from eightpost.vehicle.statespace import StateSpace


def add_port_damping(model: StateSpace, damping: Mapping[str, float]) -> StateSpace:
    """Return the model with linear dampers at its shock ports: the force is `c v` plus the input.

    With `u_F = c v + u_F'` and `v = C_v x` (a shock velocity has no direct term):

        A' = A + B_F c C_v,    C' = C + D_F c C_v

    A negative rate removes a damper: a model that was identified around a baseline damping (the dissertation's C-bar)
    becomes a model whose input is the whole shock force. Both conversions are exact.

    Args:
        model: Continuous model with `force` and `velocity` channels per port.
        damping: Damping rate by port [N.s/m]: "lf", "rf", ...; "" is the port of a quarter car.

    Raises:
        ParameterError: The model is discrete, a port does not exist, or a velocity has a direct term.
    """
    if model.dt is not None:
        raise ParameterError(f"{model.name}: port damping can be added to a continuous model only")
    ports = [f"{corner}." if corner else "" for corner in damping]
    chosen = model.select(inputs=[f"{port}force" for port in ports], outputs=[f"{port}velocity" for port in ports])
    direct = model.select(outputs=chosen.output_names).direct_terms()
    if direct.any():
        row, column = (int(i) for i in np.argwhere(direct)[0])
        raise ParameterError(
            f"{model.name}: {chosen.output_names[row]} has a direct term in {model.input_names[column]}; "
            "a shock velocity must depend on the state alone (use the continuous model)"
        )
    feedback = np.array(list(damping.values()), dtype=np.float64)[:, None] * chosen.C
    forces = [model.input_names.index(name) for name in chosen.input_names]
    return StateSpace(
        model.A + model.B[:, forces] @ feedback,
        model.B,
        model.C + model.D[:, forces] @ feedback,
        model.D,
        model.inputs,
        model.outputs,
        None,
        model.name,
    )
