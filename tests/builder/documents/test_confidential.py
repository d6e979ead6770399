"""The documents of a confidential archive disclose only permitted information."""

from __future__ import annotations

import numpy as np

from builder.reference import Disclosure

from .members import PICTURE, members_of, page_of


def spellings(value: float) -> set[str]:
    """Return the possible spellings of a coefficient with six or more digits; the fitted range is shown with four."""
    return {repr(value), *(f"{value:.{digits}g}" for digits in range(6, 17))}


def test_a_confidential_archive_contains_no_coefficient(fitted):
    everything = b"\n".join(members_of(fitted, Disclosure.CONFIDENTIAL).values()).decode("latin-1")
    curve = fitted.source.law.curve
    numbers = [
        n for field in curve.__slots__ if "knot" not in field for n in np.atleast_1d(getattr(curve, field)).tolist()
    ]
    assert len(numbers) == 29
    assert not [text for number in numbers for text in spellings(number) if text in everything]
    assert "2605.74" in page_of(members_of(fitted))  # the same search finds it in an open archive


def test_a_confidential_archive_contains_no_source_file_name_build_or_digest(fitted):
    members = members_of(fitted, Disclosure.CONFIDENTIAL)
    everything = b"\n".join([*members.values(), *(name.encode() for name in members)]).decode("latin-1")
    for text in ("dyno_7", "run_7", "build 7", "84a0a12e", "14 from closed", "150 psi", "few samples"):
        assert text not in everything


def test_a_confidential_archive_has_an_icon_in_place_of_the_curve(archives, fitted, products):
    for product, full in ((fitted, members_of(fitted)), (products["seven_dof"], archives["seven_dof"])):
        members = members_of(product, Disclosure.CONFIDENTIAL)
        assert members[PICTURE] == members["terminalsAndIcons/icon.png"]
        assert members[PICTURE] != full[PICTURE]


def test_a_confidential_vehicle_discloses_no_parameter_and_no_mode(archives, products):
    page = page_of(members_of(products["seven_dof"], Disclosure.CONFIDENTIAL))
    for text in ("2550 lbm", "1280 lbf/in", "damping ratio", "Boggs"):
        assert text in page_of(archives["seven_dof"])
        assert text not in page
