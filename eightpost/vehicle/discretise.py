"""From a continuous model to the equivalent discrete one."""

from __future__ import annotations

from typing import Literal

from eightpost.errors import ParameterError
from eightpost.vehicle import kernel
from eightpost.vehicle.statespace import StateSpace

Hold = Literal["zero", "first"]


def discretise(model: StateSpace, step: float, hold: Hold = "zero") -> StateSpace:
    """Return the discrete model with exactly the same samples, the inputs between them as `hold` says.

    "zero": inputs held over the step. `x[k+1] = Ad x[k] + (B0 + B1) u[k]`; C and D stay, so an output without
    direct term keeps none.

    "first": inputs linear over the step. `x[k+1] = Ad x[k] + B0 u[k] + B1 u[k+1]` becomes a proper state
    space in the state `xi = x - B1 u`:

        xi[k+1] = Ad xi[k] + (B0 + Ad B1) u[k],    y[k] = C xi[k] + (D + C B1) u[k]

    The new direct term is no property of the vehicle: it says that an input which is linear up to the sample
    has acted by then. With a shock it makes an algebraic loop; coupled runs keep the continuous model.

    Args:
        model: A continuous model.
        step: Sample time [s].
        hold: What the inputs do between samples.

    Returns:
        The discrete model, same channels, `dt` set.

    Raises:
        ParameterError: The model is discrete already, or the step or the hold cannot be used.
    """
    if model.dt is not None:
        raise ParameterError(f"{model.name}: the model is discrete already (dt = {model.dt:g} s)")
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
