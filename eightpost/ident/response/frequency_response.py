"""Frequency responses: what an output answers to an input, frequency by frequency."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from eightpost.errors import ParameterError
from eightpost.vehicle.statespace import Channel, StateSpace

if TYPE_CHECKING:
    from collections.abc import Iterable

    from numpy.typing import ArrayLike, NDArray

    Array = NDArray[np.float64]
    Complex = NDArray[np.complex128]


@dataclass(frozen=True, slots=True, eq=False)
class FrequencyResponse:
    """Frequency responses between named channels; arrays are (output, input, frequency), as in python-control.

    Attributes:
        frequency: (K,) increasing [Hz].
        H: (p, m, K), output unit per input unit. 0 where an input had no power.
        inputs: The m inputs.
        outputs: The p outputs.
        coherence: Multiple coherence (p, K) [1]: the part of an output's power that all inputs explain; or None.
        partial_coherence: (p, m, K) [1]: of input and output, what the other inputs explain taken out; or None.
        variance: Of H (p, m, K), `E |H - E H|^2`; infinite where an input had no power; or None.

    The arrays are copied and read-only.
    """

    frequency: Array
    H: Complex
    inputs: tuple[Channel, ...]
    outputs: tuple[Channel, ...]
    coherence: Array | None = None
    partial_coherence: Array | None = None
    variance: Array | None = None

    def __post_init__(self) -> None:
        """Freeze the arrays and check that everything fits together."""
        object.__setattr__(self, "inputs", tuple(self.inputs))
        object.__setattr__(self, "outputs", tuple(self.outputs))
        object.__setattr__(self, "frequency", _frozen(self.frequency, np.float64))
        object.__setattr__(self, "H", _frozen(self.H, np.complex128))
        p, m, count = len(self.outputs), len(self.inputs), self.frequency.size
        _check_frequency(self.frequency)
        _check_shape("H", self.H, (p, m, count))
        for name, shape in {
            "coherence": (p, count),
            "partial_coherence": (p, m, count),
            "variance": (p, m, count),
        }.items():
            values = getattr(self, name)
            if values is not None:
                object.__setattr__(self, name, _frozen(values, np.float64))
                _check_shape(name, values, shape)
        if not np.isfinite(self.H).all():
            raise ParameterError("a frequency response holds values that are not finite")
        _check_names("inputs", self.input_names)
        _check_names("outputs", self.output_names)

    @property
    def input_names(self) -> tuple[str, ...]:
        """The names of the inputs, in order."""
        return tuple(channel.name for channel in self.inputs)

    @property
    def output_names(self) -> tuple[str, ...]:
        """The names of the outputs, in order."""
        return tuple(channel.name for channel in self.outputs)

    def between(self, output: str, input: str) -> Complex:
        """Return the response (K,) of one output to one input."""
        row, column = _position("output", self.output_names, output), _position("input", self.input_names, input)
        path: Complex = self.H[row, column]
        return path

    def with_response(self, H: ArrayLike) -> FrequencyResponse:
        """Return the same with other values of H (p, m, K); coherences and variances stay those of the estimate."""
        return replace(self, H=np.asarray(H, dtype=np.complex128))

    def select(self, *, inputs: Iterable[str] | None = None, outputs: Iterable[str] | None = None) -> FrequencyResponse:
        """Return the channels asked for, in the order asked for; None keeps all."""
        columns = _positions("input", self.input_names, inputs)
        rows = _positions("output", self.output_names, outputs)
        paths = np.ix_(rows, columns)
        return FrequencyResponse(
            self.frequency,
            self.H[paths],
            tuple(self.inputs[i] for i in columns),
            tuple(self.outputs[i] for i in rows),
            None if self.coherence is None else self.coherence[rows],
            None if self.partial_coherence is None else self.partial_coherence[paths],
            None if self.variance is None else self.variance[paths],
        )

    def band(self, low: float, high: float) -> FrequencyResponse:
        """Return the frequencies with `low <= frequency <= high` [Hz]."""
        inside = (self.frequency >= low) & (self.frequency <= high)
        if not inside.any():
            span = f"{self.frequency[0]:g} to {self.frequency[-1]:g} Hz"
            raise ParameterError(f"no frequency between {low:g} and {high:g} Hz; the response has {span}")
        return self.at(inside)

    def at(self, chosen: slice | NDArray[np.bool_]) -> FrequencyResponse:
        """Return some of the frequencies, by position."""
        return FrequencyResponse(
            self.frequency[chosen],
            self.H[..., chosen],
            self.inputs,
            self.outputs,
            None if self.coherence is None else self.coherence[..., chosen],
            None if self.partial_coherence is None else self.partial_coherence[..., chosen],
            None if self.variance is None else self.variance[..., chosen],
        )


def response_of(model: StateSpace, frequency_hz: ArrayLike) -> FrequencyResponse:
    """Return the exact frequency response of a linear model at `frequency_hz` (K,) [Hz]."""
    frequency = np.atleast_1d(np.asarray(frequency_hz, dtype=np.float64))
    return FrequencyResponse(frequency, model.frequency_response(frequency), model.inputs, model.outputs)


def contribution_error(estimate: FrequencyResponse, reference: FrequencyResponse, input_power: ArrayLike) -> Array:
    """Return how much an estimate errs where it matters: the error of each output's answer to given inputs.

        e_i = sqrt( sum_jk |dH_ij(f_k)|^2 S_j(f_k)  /  sum_jk |H_ij(f_k)|^2 S_j(f_k) )

    A path that hardly contributes to its output hardly counts, however wrong it is.

    Args:
        estimate: What is judged.
        reference: The truth, on the same channels and frequencies.
        input_power: S, power of each input (m, K), in any common scale over frequency and input.

    Returns:
        (p,) relative errors [1].
    """
    if estimate.H.shape != reference.H.shape or not np.allclose(estimate.frequency, reference.frequency):
        raise ParameterError("the two responses differ in channels or frequencies; select and evaluate them alike")
    S = np.asarray(input_power, dtype=np.float64)
    wrong = np.sum(np.abs(estimate.H - reference.H) ** 2 * S, axis=(1, 2))
    whole = np.sum(np.abs(reference.H) ** 2 * S, axis=(1, 2))
    return np.asarray(np.sqrt(wrong / whole), dtype=np.float64)


def _frozen(values: ArrayLike, kind: type[np.float64] | type[np.complex128]) -> NDArray[Any]:
    copy: NDArray[Any] = np.array(values, dtype=kind, order="C")
    copy.setflags(write=False)
    return copy


def _check_frequency(frequency: Array) -> None:
    if frequency.ndim != 1 or not frequency.size:
        raise ParameterError(f"the frequencies have the shape {frequency.shape}; give a vector with one or more")
    if not np.isfinite(frequency).all() or frequency[0] < 0.0 or (np.diff(frequency) <= 0.0).any():
        raise ParameterError("the frequencies must be finite, not negative, and increase")


def _check_shape(name: str, values: NDArray[Any], expected: tuple[int, ...]) -> None:
    if values.shape != expected:
        raise ParameterError(f"{name} has the shape {values.shape}; channels and frequencies need {expected}")


def _check_names(kind: str, names: tuple[str, ...]) -> None:
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise ParameterError(f"{kind} hold {', '.join(twice)} more than once; names must differ")


def _position(kind: str, names: tuple[str, ...], wanted: str) -> int:
    if wanted not in names:
        raise ParameterError(f"{kind} {wanted!r} is not there; there are {', '.join(names)}")
    return names.index(wanted)


def _positions(kind: str, names: tuple[str, ...], wanted: Iterable[str] | None) -> list[int]:
    if wanted is None:
        return list(range(len(names)))
    chosen = [wanted] if isinstance(wanted, str) else list(wanted)
    return [_position(kind, names, name) for name in chosen]
