"""Laws of mechanics that relate the channels of a rig record, whatever the car, drive and setup."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from eightpost.ident.preparation.plausibility.comparison import Comparison
from eightpost.ident.preparation.plausibility.laws.body import body_comparisons
from eightpost.ident.preparation.plausibility.laws.commands import command_comparisons
from eightpost.ident.preparation.plausibility.laws.hub import hub_comparisons
from eightpost.ident.preparation.plausibility.laws.newton import newton_comparisons
from eightpost.ident.preparation.plausibility.laws.tire import tire_comparisons
from eightpost.ident.preparation.plausibility.laws.travel import slope_comparisons, travel_comparisons
from eightpost.ident.preparation.plausibility.spectra import Spectra


def comparisons(spectra: Spectra, corners: Sequence[str], mass: float | None = None) -> Iterator[Comparison]:
    """Yield the comparisons of all laws whose channels are known.

    Args:
        spectra: Spectra of a record.
        corners: Names of its corners; one empty name for a quarter car.
        mass: Mass of the car [kg], None if it is unknown.
    """
    yield from tire_comparisons(spectra, corners)
    yield from travel_comparisons(spectra, corners)
    yield from slope_comparisons(spectra, corners)
    yield from hub_comparisons(spectra, corners)
    yield from newton_comparisons(spectra, corners, mass)
    yield from body_comparisons(spectra, corners)
    yield from command_comparisons(spectra, corners)


__all__ = ["comparisons"]
