"""Conversion of frequency responses to and from python-control; for models see `StateSpace.to_control`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from eightpost.errors import ParameterError
from eightpost.extras import needs
from eightpost.ident.response import FrequencyResponse
from eightpost.vehicle.statespace import Channel


def to_frd(response: FrequencyResponse) -> Any:
    """Return the response as a continuous `control.FrequencyResponseData`, with frequencies in rad/s.

    python-control does not allow dots in names, so they become colons (`lf.road` -> `lf:road`). Units, coherence and
    variance are lost.
    """
    with needs("control", "exchange with python-control"):
        import control  # noqa: PLC0415  because loading it takes seconds

    return control.FrequencyResponseData(
        response.H,
        2.0 * np.pi * response.frequency,
        inputs=[name.replace(".", ":") for name in response.input_names],
        outputs=[name.replace(".", ":") for name in response.output_names],
    )


def from_frd(data: Any, *, input_units: Sequence[str], output_units: Sequence[str]) -> FrequencyResponse:
    """Convert a response of python-control, which has no units.

    Args:
        data: Response, a `control.FrequencyResponseData`.
        input_units: SI units, one per input.
        output_units: SI units, one per output.

    Raises:
        ParameterError: The number of units differs from the number of channels.
    """
    inputs = _channels(data.input_labels, input_units, "input")
    outputs = _channels(data.output_labels, output_units, "output")
    return FrequencyResponse(np.asarray(data.omega) / (2.0 * np.pi), np.asarray(data.frdata), inputs, outputs)


def _channels(labels: Sequence[str], units: Sequence[str], kind: str) -> tuple[Channel, ...]:
    if len(labels) != len(units):
        raise ParameterError(f"{len(units)} {kind} units given, but the response has {len(labels)} {kind}s: {labels}")
    return tuple(Channel(label.replace(":", "."), unit) for label, unit in zip(labels, units, strict=True))
