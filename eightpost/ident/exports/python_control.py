"""Frequency responses as python-control has them; models go by `StateSpace.to_control`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from eightpost.errors import ParameterError
from eightpost.ident.response import FrequencyResponse
from eightpost.vehicle.statespace import Channel

if TYPE_CHECKING:
    from collections.abc import Sequence


def to_frd(response: FrequencyResponse) -> Any:
    """Return the response as a `control.FrequencyResponseData`, continuous, with frequencies in rad/s.

    Its names admit no dots, so they become colons (`lf.road` -> `lf:road`). Units, coherence and variance are lost.
    """
    import control  # noqa: PLC0415  here, as loading it takes seconds

    return control.FrequencyResponseData(
        response.H,
        2.0 * np.pi * response.frequency,
        inputs=[name.replace(".", ":") for name in response.input_names],
        outputs=[name.replace(".", ":") for name in response.output_names],
    )


def from_frd(data: Any, *, input_units: Sequence[str], output_units: Sequence[str]) -> FrequencyResponse:
    """Take over a response of python-control, with units, which it does not know.

    Args:
        data: A `control.FrequencyResponseData`.
        input_units: One SI unit per input.
        output_units: One SI unit per output.

    Raises:
        ParameterError: The number of units does not fit.
    """
    inputs = _channels(data.input_labels, input_units, "input")
    outputs = _channels(data.output_labels, output_units, "output")
    return FrequencyResponse(np.asarray(data.omega) / (2.0 * np.pi), np.asarray(data.frdata), inputs, outputs)


def _channels(labels: Sequence[str], units: Sequence[str], kind: str) -> tuple[Channel, ...]:
    if len(labels) != len(units):
        raise ParameterError(f"{len(units)} {kind} units given; the response has {len(labels)} {kind}s: {labels}")
    return tuple(Channel(label.replace(":", "."), unit) for label, unit in zip(labels, units, strict=True))
