"""Shock files and vehicle files into FMUs."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from builder.interface import Interface
from builder.product import Product, shock_product, vehicle_product
from builder.python_fmu import build_python_fmu
from eightpost.errors import FmuError
from eightpost.files import check_output_folder, document_kind
from eightpost.shock import read_shock
from eightpost.vehicle import read_vehicle

TARGETS = ("python",)


@dataclass(frozen=True)
class Built:
    """One FMU that was written, and from what."""

    path: Path
    source: str
    interface: Interface


def build(sources: Sequence[str | Path], folder: str | Path, *, target: str = "python") -> list[Built]:
    """Build one FMU per source file into `folder`; each is named after its source.

    Args:
        sources: Shock files (`eightpost fit`) and vehicle files (.toml with parameters, .json with a state space).
        folder: Where the FMUs go; made if it is not there.
        target: `python`.

    Raises:
        FmuError: Two sources would give the same FMU, or a vehicle cannot be one.
        InputError: A source cannot be read.
    """
    if target not in TARGETS:
        raise FmuError(f"target {target!r} is not known; known are {', '.join(TARGETS)}")
    check_output_folder(folder)
    products = [_product(Path(source)) for source in sources]
    names = [product.identifier for product in products]
    if doubled := sorted({name for name in names if names.count(name) > 1}):
        raise FmuError(f"several sources would be written to {doubled[0]}.fmu; rename one of them")
    built = []
    for source, product in zip(sources, products, strict=True):
        path = Path(folder) / f"{product.identifier}.fmu"
        build_python_fmu(product, path)
        built.append(Built(path, str(source), product.interface))
    return built


def _product(source: Path) -> Product:
    identifier = fmu_identifier(source.stem)
    if source.suffix == ".json" and document_kind(source) == "shock":
        return shock_product(read_shock(source), identifier)
    if source.suffix in (".json", ".toml"):
        return vehicle_product(read_vehicle(source), identifier)
    raise FmuError(f"{source}: build takes shock files (.json) and vehicle files (.toml, .json)")


def fmu_identifier(name: str) -> str:
    """Return a C name from a file's name: what FMI asks of a model identifier."""
    identifier = re.sub(r"\W", "_", name, flags=re.ASCII)
    return f"_{identifier}" if identifier[:1].isdigit() or not identifier else identifier
