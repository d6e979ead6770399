"""Exact conversions of a linear model: to discrete time, and with linear dampers or springs at its shock ports."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Literal

import numpy as np

from eightpost.errors import ParameterError
from eightpost.vehicle import kernel
from eightpost.vehicle.statespace import StateSpace

Hold = Literal["zero", "first"]


def discretise(model: StateSpace, step: float, hold: Hold = "zero") -> StateSpace:
    """Return the discrete model whose samples equal those of the continuous model.

    "zero": Inputs are held over the step. `x[k+1] = Ad x[k] + (B0 + B1) u[k]`; C and D do not change, so an output
    without a direct term does not get one.

    "first": Inputs are linear over the step. `x[k+1] = Ad x[k] + B0 u[k] + B1 u[k+1]` becomes a proper state
    space with the state `xi = x - B1 u`:

        xi[k+1] = Ad xi[k] + (B0 + Ad B1) u[k],    y[k] = C xi[k] + (D + C B1) u[k]

    The new direct term is not a property of the vehicle: it is the effect, at the sample, of an input that is linear
    up to the sample. With a shock it gives an algebraic loop; coupled runs use the continuous model.

    Args:
        model: Continuous model.
        step: Sample time [s].
        hold: Input values between samples: "zero" (held) or "first" (linear).

    Returns:
        Discrete model with the same channels.

    Raises:
        ParameterError: The model is already discrete, or the step or the hold is invalid.
    """
    if model.dt is not None:
        raise ParameterError(f"{model.name}: the model is already discrete (dt = {model.dt:g} s)")
    try:
        Ad, B0, B1 = kernel.discretise(model.A, model.B, step)
    except ValueError as error:
        raise ParameterError(f"{model.name}: {error}") from error
    if hold == "zero":
        return replace(model, A=Ad, B=B0 + B1, dt=float(step))
    if hold == "first":
        return replace(model, A=Ad, B=B0 + Ad @ B1, D=model.D + model.C @ B1, dt=float(step))
    raise ParameterError(f"{model.name}: unknown hold {hold!r}; choose 'zero' or 'first'")


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
    return _fed_back(model, damping, "velocity")


def add_port_stiffness(model: StateSpace, stiffness: Mapping[str, float]) -> StateSpace:
    """Return the model with linear springs at its shock ports, as `add_port_damping` adds dampers.

    Args:
        model: Continuous model with `force` and `displacement` channels per port.
        stiffness: Spring rate by port [N/m]: "lf", "rf", ...; "" is the port of a quarter car.

    Raises:
        ParameterError: The model is discrete, a port does not exist, or a displacement has a direct term.
    """
    return _fed_back(model, stiffness, "displacement")


def _fed_back(model: StateSpace, rates: Mapping[str, float], motion: str) -> StateSpace:
    """Return the model with forces at its ports that are proportional to their velocity or displacement."""
    if model.dt is not None:
        raise ParameterError(f"{model.name}: dampers and springs of ports can be added to a continuous model only")
    ports = [f"{corner}." if corner else "" for corner in rates]
    chosen = model.select(inputs=[f"{port}force" for port in ports], outputs=[f"{port}{motion}" for port in ports])
    direct = model.select(outputs=chosen.output_names).direct_terms()
    if direct.any():
        row, column = (int(i) for i in np.argwhere(direct)[0])
        raise ParameterError(
            f"{model.name}: {chosen.output_names[row]} has a direct term in {model.input_names[column]}; "
            f"a shock {motion} must depend on the state alone (use the continuous model)"
        )
    feedback = np.array(list(rates.values()), dtype=np.float64)[:, None] * chosen.C
    forces = [model.input_names.index(name) for name in chosen.input_names]
    return replace(model, A=model.A + model.B[:, forces] @ feedback, C=model.C + model.D[:, forces] @ feedback)
