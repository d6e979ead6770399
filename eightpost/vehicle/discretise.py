"""Conversion of a continuous model to the equivalent discrete model."""

from __future__ import annotations

from typing import Literal

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
        return StateSpace(Ad, B0 + B1, model.C, model.D, model.inputs, model.outputs, float(step), model.name)
    if hold == "first":
        return StateSpace(
            Ad,
            B0 + Ad @ B1,
            model.C,
            model.D + model.C @ B1,
            model.inputs,
            model.outputs,
            float(step),
            model.name,
        )
    raise ParameterError(f"{model.name}: unknown hold {hold!r}; choose 'zero' or 'first'")
