"""Estimation of a frequency response from records with any recipe."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

from eightpost.ident.response.records import Records, gather

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from eightpost.ident.response.frequency_response import FrequencyResponse
    from eightpost.signals import TimeSeries


class Recipe(Protocol):
    """Protocol of the estimators `H1`, `H2`, `Hv`, `LocalPolynomial`, `Sequential` and `SameDrive`."""

    def estimate(self, records: Records) -> FrequencyResponse:
        """Estimate the response of every output to every input."""
        ...


def estimate_response(
    records: Sequence[TimeSeries],
    *,
    inputs: Sequence[str],
    outputs: Sequence[str],
    recipe: Recipe,
    baseline_damping: Mapping[str, float] | None = None,
) -> FrequencyResponse:
    """Estimate frequency responses.

    Args:
        records: Records, one per test; sequential recipes define their order.
        inputs: Names of the inputs in every record, including shock forces.
        outputs: Names of the outputs in every record.
        recipe: Estimator.
        baseline_damping: C-bar by port [N.s/m]: `c v` is subtracted from the shock forces (Eq 6.4), and the result is
            the response of the vehicle with these dampers. None uses the forces without change.

    Raises:
        InputError: Records, channels and recipe do not match.
    """
    return recipe.estimate(gather(records, inputs, outputs, baseline_damping))
