"""The documents and the C data of an assembly: none of their numbers changes unseen."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

from eightpost.archive import read_archive
from tests.builder.documents.members import kept_of


def test_the_documents_and_the_wiring_of_a_car_with_shocks_are_the_same(
    car: Path, unchanged: Callable[..., None]
) -> None:
    members = read_archive(car)
    lines = members["sources/assembly_data.h"].decode().splitlines()
    kept = kept_of({name: one for name, one in members.items() if "sources/" not in name}, "car_with_shocks")
    page = [row for row in kept.pop("page") if not row.startswith(("lf.", "lr.", "rr.", "car."))]
    unchanged(kept | {"page": page, "wiring": [re.sub(r"\d{15,}", "", line) for line in lines]})
