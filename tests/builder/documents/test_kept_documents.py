"""The tables of the page, the reference results and the terminals of an FMU: none of their numbers changes unseen."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import pytest

from builder.product import Product
from builder.reference import Disclosure

from .members import kept_of, members_of


@pytest.mark.parametrize("name", ["quarter_car"])
def test_the_documents_of_a_model_are_the_same(
    name: str, archives: Mapping[str, Mapping[str, bytes]], unchanged: Callable[..., None]
) -> None:
    unchanged(kept_of(archives[name], name))


@pytest.mark.parametrize("disclosure", Disclosure)
def test_the_documents_of_a_fitted_shock_are_the_same(
    disclosure: Disclosure, fitted: Product, unchanged: Callable[..., None]
) -> None:
    unchanged(kept_of(members_of(fitted, disclosure), "front_shock"))
