"""The descriptions and C data that are written for an FMU, and how it is compiled: nothing of it changes unseen."""

from __future__ import annotations

import re
import struct
import sys
from collections.abc import Callable, Mapping
from pathlib import Path

import pytest

from builder.build import fmu_identifier
from builder.native_fmu import _c_sources
from builder.product import shock_product
from builder.toolchain import BROWSER, PLATFORMS, SystemCompiler, Toolchain, Zig, universal
from eightpost.archive import read_archive

from .shock_over_settings import shock_of

FILES = ["a.c", "b.c"]
#: What differs with every change of the sources, and the lines of arrays.
_OWN = r'(guid|instantiationToken|version|generationTool)="[^"]*"|\{[0-9a-f-]{36}\}|0x[0-9a-f]+|\d{15,}'


def _lines(content: bytes) -> list[str]:
    text = re.sub(_OWN, "", content.decode())
    return [line.strip() for line in text.splitlines() if line.strip() and not re.match(r"\s*(<File name|</)", line)]


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


@pytest.mark.parametrize("compiler", [Zig, SystemCompiler])
def test_a_library_is_compiled_with_the_same_command(compiler: type[Toolchain], unchanged: Callable[..., None]) -> None:
    toolchain = compiler(sys.executable)
    platforms = [*PLATFORMS.values(), BROWSER] if compiler is Zig else [PLATFORMS["linux64"]]
    unchanged({
        f"{platform.name}, {platform.name_3}, {target}": [
            platform.member("car"), platform.member("car", 3),
            " ".join(re.sub(r"^/.*/", "", word) for word in toolchain.command("car", platform, target, FILES)[1:]),
        ]
        for platform in platforms for target in platform.targets
    })  # fmt: skip


def test_a_universal_library_has_aligned_slices_and_their_processors() -> None:
    slices = [struct.pack("<IiI", 0xFEEDFACF, kind, 3) + bytes(size) for kind, size in ((7, 100), (12, 40_000), (7, 1))]
    made = universal(slices)
    assert struct.unpack_from(">II", made) == (0xCAFEBABE, 3)
    entries = [struct.unpack_from(">iIIII", made, 8 + 20 * k) for k in range(3)]
    assert [entry[:2] for entry in entries] == [(7, 3), (12, 3), (7, 3)]
    assert [entry[2] for entry in entries] == [1 << 14, 2 << 14, 5 << 14]
    assert [entry[4] for entry in entries] == [14, 14, 14]
    assert [made[start : start + size] for _, _, start, size, _ in entries] == slices
    assert len(made) == (5 << 14) + len(slices[2])


@pytest.mark.parametrize(
    ("name", "identifier"),
    [
        ("A b-c", "A_b_c"),
        ("3 inch", "_3_inch"),
        ("Ä", "_"),
        ("", "_"),
        ("_x_", "_x_"),
        ("if", "if_"),
        ("Con", "Con_"),
        ("LPT1", "LPT1_"),
    ],
)
def test_an_identifier_of_an_fmu_is_one_of_c(name: str, identifier: str) -> None:
    assert fmu_identifier(name) == identifier
