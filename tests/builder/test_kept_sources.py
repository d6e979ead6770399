"""The descriptions and the C data that are written for an FMU: none of their numbers changes unseen."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from pathlib import Path

import pytest

from builder.native_fmu import _c_sources
from builder.product import shock_product
from eightpost.archive import read_archive

from .shock_over_settings import shock_of

#: What differs with every change of the sources, and the lines of arrays.
_OWN = r'(guid|instantiationToken|version|generationTool)="[^"]*"|\{[0-9a-f-]{36}\}|0x[0-9a-f]+|\d{15,}'


def _lines(content: bytes) -> list[str]:
    text = re.sub(_OWN, "", content.decode())
    return [line.strip() for line in text.splitlines() if line.strip() and "<File name" not in line]


@pytest.mark.parametrize("version", ["2", "3"])
def test_the_description_of_a_car_is_the_same(
    version: str, fmus: Mapping[str, Path], fmus3: Mapping[str, Path], unchanged: Callable[..., None]
) -> None:
    unchanged(_lines(read_archive((fmus if version == "2" else fmus3)["quarter_car"])["modelDescription.xml"]))


@pytest.mark.parametrize("name", ["interface.c", "interface.h", "vehicle_data.h"])
def test_the_c_data_of_a_car_are_the_same(name: str, fmus: Mapping[str, Path], unchanged: Callable[..., None]) -> None:
    unchanged(_lines(read_archive(fmus["quarter_car"])[f"sources/{name}"]))


def test_the_c_data_of_a_shock_over_settings_are_the_same(unchanged: Callable[..., None]) -> None:
    product = shock_product(shock_of("hysteresis_lagged"), "shock", temperature_input=True)
    sources = _c_sources(product, product.interface, "0")
    unchanged([line for line in _lines(sources["settings_data.h"]) if not line.startswith("{0.0, 0.0, 0.0, 0.0")])
