"""Conversion of frequency responses to python-control; for models see `StateSpace.to_control`."""

from __future__ import annotations

from typing import Any

import numpy as np

from eightpost.extras import needs
from eightpost.ident.response import FrequencyResponse


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
