"""The tables of the page, the reference results and the terminals of an FMU: none of their numbers changes unseen."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping

import lxml.html
import pytest

from builder.product import Product
from builder.reference import Disclosure

from .members import EXTRA, TERMINALS, members_of, page_of, reference_of


def _rows(page: str) -> list[str]:
    """Return the headings, rows of tables and texts of pictures, one a line; of an array the first element."""
    found = lxml.html.fromstring(page).xpath("//h1 | //h2 | //h3 | //tr | //img | //pre")
    parts = ([*one.itertext(), one.get("alt", "")] for one in found)
    rows = [" | ".join(" ".join(part.split()) for part in texts if part.strip()) for texts in parts]
    return [row for row in rows if not re.match(r"\S+\[([2-9]|\d\d)\] ", row)]


def _kept(members: Mapping[str, bytes], name: str) -> dict[str, object]:
    inputs, outputs = reference_of(dict(members), name) if f"{EXTRA}/{name}_in.csv" in members else ({}, {})
    texts = {
        one: content.decode()
        for one, content in members.items()
        if one.startswith(("extra/", "resources/")) and not one.endswith(".csv")
    }
    return {"page": _rows(page_of(dict(members))), "inputs": inputs, "outputs": outputs} | texts | {
        "terminals": members[TERMINALS].decode(), "members": sorted(members)
    }  # fmt: skip


@pytest.mark.parametrize("name", ["quarter_car", "hysteresis"])
def test_the_documents_of_a_model_are_the_same(
    name: str, archives: Mapping[str, Mapping[str, bytes]], unchanged: Callable[..., None]
) -> None:
    unchanged(_kept(archives[name], name))


@pytest.mark.parametrize("disclosure", Disclosure)
def test_the_documents_of_a_fitted_shock_are_the_same(
    disclosure: Disclosure, fitted: Product, unchanged: Callable[..., None]
) -> None:
    unchanged(_kept(members_of(fitted, disclosure), "front_shock"))
