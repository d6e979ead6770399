"""Covariance of the estimate when residuals are correlated in time and between outputs."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.ndimage import uniform_filter1d

from eightpost.array_types import Array, Complex
from eightpost.ident.output_error.band import REACH, Band

#: Minimum number of lines over which the residual's spectrum is averaged.
_WIDTH = 5


def covariance(residuals: Sequence[Complex], slopes: Sequence[Complex], band: Band, prior: Array) -> Array:
    """Return the covariance (P, P) of the estimated coordinates.

        cov = A^-1 M A^-1,  A = sum_f Re J_f^H J_f + Lambda,  M = 1/2 sum_fg Re J_f^H C_fg J_g + Lambda

    C_fg is the covariance of the residual's spectral lines: its smoothed spectrum (between all outputs) times the
    correlation of the window's lines. Coloured residuals therefore widen the intervals as they must. Lambda is the
    inverse of the prior's covariance.

    Args:
        residuals: Residual lines (Y, B) of every record.
        slopes: Derivatives (P, Y, B) of the residual lines.
        band: Band of the residuals.
        prior: One over the prior's standard deviations (P,).
    """
    count = len(prior)
    curvature, scatter = np.diag(prior**2), np.zeros((count, count))
    for r, J in zip(residuals, slopes, strict=True):
        flat = J.reshape(count, -1)
        curvature = curvature + np.real(flat.conj() @ flat.T)
        scatter = scatter + _scatter(r, J, band)
    values = 2 * sum(r.size for r in residuals)
    inverse = np.linalg.pinv(curvature, hermitian=True)
    scatter = scatter * (values / max(values - count, 1)) + np.diag(prior**2)
    return np.asarray(inverse @ scatter @ inverse)


def _scatter(r: Complex, J: Complex, band: Band) -> Array:
    """Return 1/2 sum_fg Re J_f^H C_fg J_g of one record, with residuals (Y, B) and slopes (P, Y, B)."""
    lines = r.shape[1]
    width = min(lines, max(_WIDTH, round(lines**0.5)))
    products = r[:, None, :] * r[None].conj()
    spectrum = uniform_filter1d(products.real, width) + 1j * uniform_filter1d(products.imag, width)
    driven = np.einsum("yzf,pzf->pyf", spectrum, J)
    found = 0.0
    for apart, share in enumerate(band.correlations()[: REACH + 1]):
        if apart < lines and abs(share) > 1e-9:
            part = np.real(np.einsum("pyf,qyf->pq", J[..., : lines - apart].conj(), driven[..., apart:]))
            found = found + share * (part if apart == 0 else part + part.T)
    return 0.5 * np.asarray(found)
