"""Parallel model of one transfer function per path."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from eightpost.errors import ParameterError
from eightpost.ident.vehicle.transfer_function import TransferFunction
from eightpost.vehicle.statespace import Channel, StateSpace

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    Array = NDArray[np.float64]


def parallel_model(
    paths: Mapping[tuple[str, str], TransferFunction],
    inputs: Sequence[Channel],
    outputs: Sequence[Channel],
    *,
    name: str = "parallel",
) -> StateSpace:
    """Return the linear model whose paths are the given transfer functions; each path has its own poles.

    Args:
        paths: Transfer function by (output, input); missing paths are zero.
        inputs: Inputs of the model.
        outputs: Outputs of the model.
        name: Name of the model.

    Raises:
        ParameterError: There is no path, or both continuous and discrete ones are given.
    """
    rates = {path.dt for path in paths.values()}
    if len(rates) != 1:
        raise ParameterError(
            f"all paths must have the same sample time; the given ones have {sorted(map(str, rates)) or 'none'}"
        )
    rows, columns = [channel.name for channel in outputs], [channel.name for channel in inputs]
    n = sum(path.order for path in paths.values())
    A, B = np.zeros((n, n)), np.zeros((n, len(columns)))
    C, D = np.zeros((len(rows), n)), np.zeros((len(rows), len(columns)))
    at = 0
    for (output, source), path in paths.items():
        i, j, part = rows.index(output), columns.index(source), slice(at, at + path.order)
        sections = path.sections()
        A[part, part], B[part, j], C[i, part], D[i, j] = sections[0], sections[1][:, 0], sections[2][0], path.direct
        at += path.order
    return StateSpace(A, B, C, D, tuple(inputs), tuple(outputs), rates.pop(), name)
