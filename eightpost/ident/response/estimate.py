"""The verb: records to a frequency response, by any recipe."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

from eightpost.ident.response.records import Records, gather

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from eightpost.ident.response.frequency_response import FrequencyResponse
    from eightpost.signals import TimeSeries


class Recipe(Protocol):
    """A way to estimate: `H1`, `H2`, `Hv`, `LocalPolynomial`, `Sequential`, `SameDrive`."""

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
        records: One record per test; sequential recipes say in which order.
        inputs: Channels of every record, shock forces among them.
        outputs: Channels of every record.
        recipe: How.
        baseline_damping: C-bar [N.s/m] by port: the shock forces become what they are more than `c v` (Eq 6.4), and
            the answer is that of the vehicle with these dampers. None takes the forces as they are.

    Raises:
        InputError: Records, channels or recipe do not fit together; the message says how.
    """
    return recipe.estimate(gather(records, inputs, outputs, baseline_damping))
