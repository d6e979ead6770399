"""Models that the output-error engine fits, and models from the compiled right-hand side of a differential equation."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

import numba
import numpy as np

from eightpost.array_types import Array
from eightpost.errors import ParameterError


@dataclass(frozen=True, slots=True, eq=False)
class Record:
    """Measured inputs and outputs of one experiment.

    Raises:
        ParameterError: The shapes do not match, a value is not finite, or the settling is longer than the record.
    """

    inputs: Array  #: Inputs (N, U).
    outputs: Array  #: Measured outputs (N, Y).
    rate: float  #: Sample rate [Hz].
    #: Number of samples at the start that are simulated and do not count, e.g. because the start is unknown.
    settling: int = 0

    def __post_init__(self) -> None:
        """Check the shapes and that all values are finite."""
        if self.inputs.ndim != 2 or self.outputs.ndim != 2 or len(self.inputs) != len(self.outputs):
            raise ParameterError(
                f"a record has inputs of shape {self.inputs.shape} and outputs of shape {self.outputs.shape}; give "
                "(samples, channels) with the same number of samples"
            )
        if not (np.isfinite(self.inputs).all() and np.isfinite(self.outputs).all()):
            raise ParameterError("a record has values that are not finite; remove or repair these samples")
        if not 0 <= self.settling < len(self.inputs):
            raise ParameterError(
                f"the settling is {self.settling} samples of {len(self.inputs)}; it must be within them"
            )

    def counted(self, signals: Array) -> Array:
        """Return signals (..., N, Y) of the record without the settling at the start."""
        return signals[..., self.settling :, :]


class Model(Protocol):
    """A model with n states that is simulated for K sets of P parameters at once."""

    @property
    def state_sizes(self) -> Array:
        """Typical sizes of the states (n,), which scale the unknown states of multiple shooting."""
        ...

    def start(self, values: Array) -> Array:
        """Return the states (K, n) at the first sample of a record for parameters (K, P)."""
        ...

    def run(self, values: Array, states: Array, inputs: Array, rate: float) -> tuple[Array, Array]:
        """Simulate a part of a record.

        Args:
            values: Parameters (K, P).
            states: States at the first sample (K, n).
            inputs: Inputs (N + 1, U); the last row is the first sample after the part.
            rate: Sample rate [Hz].

        Returns:
            Outputs (K, N, Y), and the states (K, n) at the first sample after the part.
        """
        ...


def derivative_function(function: Callable[..., Any]) -> Any:
    """Compile a function f(x, u, p, dx) that fills the derivatives dx (n,), or g(x, u, p, y) that fills outputs."""
    return numba.njit(nogil=True, error_model="numpy")(function)


class SteppedModel:
    """Model of a differential equation, integrated with the fourth-order Runge-Kutta method.

        dx/dt = f(x, u, p),  y = g(x, u, p)

    Args:
        derivative: Compiled function f(x, u, p, dx) that fills dx (n,); see `derivative_function`.
        output: Compiled function g(x, u, p, y) that fills y (Y,).
        outputs: Number of outputs Y.
        state_sizes: Typical sizes of the states (n,).
        start: Function that returns the states (K, n) at the first sample for parameters (K, P); default: zeros.
        steps: Number of integration steps per sample.
        hold: Whether inputs are held between samples; otherwise they are interpolated linearly.
    """

    def __init__(
        self,
        derivative: Any,
        output: Any,
        *,
        outputs: int,
        state_sizes: Array,
        start: Callable[[Array], Array] | None = None,
        steps: int = 1,
        hold: bool = False,
    ) -> None:
        self.state_sizes = np.asarray(state_sizes, dtype=np.float64)
        self._start, self._outputs = start, outputs
        self._steps, self._hold = steps, hold
        self._march = _compiled_march(derivative, output)

    def start(self, values: Array) -> Array:
        """Return the states (K, n) at the first sample of a record for parameters (K, P)."""
        if self._start is None:
            return np.zeros((len(values), self.state_sizes.size))
        return np.ascontiguousarray(self._start(values))

    def run(self, values: Array, states: Array, inputs: Array, rate: float) -> tuple[Array, Array]:
        """Simulate a part of a record; arguments, shapes and results are those of `Model.run`."""
        outputs = np.empty((len(values), len(inputs) - 1, self._outputs))
        ends = np.array(states, dtype=np.float64)
        rows, drive = np.ascontiguousarray(values), np.ascontiguousarray(inputs)
        self._march(rows, ends, drive, 1.0 / (rate * self._steps), self._steps, self._hold, outputs)
        return outputs, ends


def _compiled_march(f: Any, g: Any) -> Any:
    """Return the compiled loop over parameters, samples and steps for a model's functions."""

    @numba.njit(nogil=True, error_model="numpy")  # type: ignore[untyped-decorator]
    def march(values: Array, states: Array, inputs: Array, h: float, steps: int, hold: bool, outputs: Array) -> None:
        n, count = states.shape[1], inputs.shape[1]
        k = np.empty((4, n))
        trial, u = np.empty(n), np.empty((3, count))
        for run in range(values.shape[0]):
            p, x = values[run], states[run]
            for sample in range(outputs.shape[1]):
                g(x, inputs[sample], p, outputs[run, sample])
                for step in range(steps):
                    for j in range(count):
                        rise = 0.0 if hold else (inputs[sample + 1, j] - inputs[sample, j]) / steps
                        for part in range(3):
                            u[part, j] = inputs[sample, j] + rise * (step + 0.5 * part)
                    f(x, u[0], p, k[0])
                    for stage in range(1, 4):
                        reach = h if stage == 3 else 0.5 * h
                        for i in range(n):
                            trial[i] = x[i] + reach * k[stage - 1, i]
                        f(trial, u[2] if stage == 3 else u[1], p, k[stage])
                    for i in range(n):
                        x[i] += h / 6.0 * (k[0, i] + 2.0 * k[1, i] + 2.0 * k[2, i] + k[3, i])

    return march
