"""Estimators H1, H2 and Hv, averaged over windowed blocks."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from eightpost.errors import InputError
from eightpost.ident.response.blocks import Blocks, Spectra
from eightpost.ident.response.coherence import multiple_coherence, partial_coherence, response_variance
from eightpost.ident.response.frequency_response import FrequencyResponse
from eightpost.ident.response.regression import Regression, regress

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from eightpost.ident.response.records import Records

    Array = NDArray[np.float64]
    Complex = NDArray[np.complex128]

#: Amplitude of an input, relative to its largest, below which it has no power (-50 dB) [1].
POWER_FLOOR = 3e-3


@dataclass(frozen=True, slots=True)
class H1:
    """Linear regression for noise on the outputs (Eq 4.19, 5.32; the global method of Eq 6.7 for several shocks).

    Attributes:
        blocks: Division of the records into blocks.
        power_floor: Amplitude of an input, relative to its largest, below which it is dropped at a frequency [1].
    """

    blocks: Blocks
    power_floor: float = POWER_FLOOR

    def estimate(self, records: Records) -> FrequencyResponse:
        """Estimate from all records at once."""
        spectra, solved = _regressed(self.blocks, self.power_floor, records)
        return response_from(records, spectra, solved, solved.H)


@dataclass(frozen=True, slots=True)
class H2:
    """Linear regression for noise on the inputs, `H2 = S_yy S_uy^-1`; it needs as many outputs as inputs.

    The inputs are regressed on the outputs and the result is inverted. Coherence and variance are those of H1.

    Attributes:
        blocks: Division of the records into blocks.
        power_floor: Relative amplitude below which an input is dropped [1]; see `H1`.
    """

    blocks: Blocks
    power_floor: float = POWER_FLOOR

    def estimate(self, records: Records) -> FrequencyResponse:
        """Estimate from all records at once.

        Raises:
            InputError: The numbers of inputs and outputs differ.
        """
        if len(records.inputs) != len(records.outputs):
            raise InputError(
                f"H2 needs as many outputs as inputs, not {len(records.outputs)} and {len(records.inputs)}; "
                "select channels, or use H1 or Hv"
            )
        spectra, solved = _regressed(self.blocks, self.power_floor, records)
        names = [channel.name for channel in records.outputs]
        backward = regress(spectra.Y, spectra.U, power_floor=0.0, names=names)
        H = np.linalg.pinv(backward.H.transpose(2, 0, 1)).transpose(1, 2, 0)
        return response_from(records, spectra, solved, np.where(solved.active[None], H, 0.0))


@dataclass(frozen=True, slots=True)
class Hv:
    """Total least squares for noise on inputs and outputs that is proportional to the size of each channel.

    For one input and one output it is the geometric mean of H1 and H2. Coherence and variance are those of H1.

    Attributes:
        blocks: Division of the records into blocks.
        power_floor: Relative amplitude below which an input is dropped [1]; see `H1`.
    """

    blocks: Blocks
    power_floor: float = POWER_FLOOR

    def estimate(self, records: Records) -> FrequencyResponse:
        """Estimate from all records at once."""
        spectra, solved = _regressed(self.blocks, self.power_floor, records)
        H = solved.H.copy()
        for k in range(len(spectra.frequency)):
            used = solved.active[:, k]
            for i in np.flatnonzero(solved.total[:, k] > 0.0):
                H[i, used, k] = _total_least_squares(spectra.U[k][:, used], spectra.Y[k][:, i])
        return response_from(records, spectra, solved, H)


def response_from(records: Records, spectra: Spectra, solved: Regression, H: Complex) -> FrequencyResponse:
    """Return a response with the coherences and the variance of its regression."""
    return FrequencyResponse(
        spectra.frequency,
        H,
        records.inputs,
        records.outputs,
        multiple_coherence(solved),
        partial_coherence(solved),
        response_variance(solved, spectra.U.shape[1], spectra.independent),
    )


def _regressed(blocks: Blocks, power_floor: float, records: Records) -> tuple[Spectra, Regression]:
    spectra = blocks.spectra(records)
    names = [channel.name for channel in records.inputs]
    return spectra, regress(spectra.U, spectra.Y, power_floor=power_floor, names=names)


def _total_least_squares(U: Complex, y: Complex) -> Complex:
    """Return h (m,) of `(U + dU) h = y + dy` with the smallest scaled disturbances dU and dy."""
    joined = np.column_stack((U, y))
    size = np.linalg.norm(joined, axis=0)
    smallest = np.linalg.svd(joined / size, full_matrices=False)[2][-1].conj()
    if smallest[-1] == 0.0:
        return np.zeros(U.shape[1], dtype=np.complex128)
    return np.asarray(-(smallest[:-1] / size[:-1]) / (smallest[-1] / size[-1]), dtype=np.complex128)
