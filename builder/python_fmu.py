"""Construction of a Python FMU: a slave with the library's own law or kernel, packed by PythonFMU.

The modelDescription.xml of PythonFMU has no units, dependencies and InitialUnknowns, and its archive differs from build
to build; both are replaced. A Python FMU is the readable reference implementation; it needs a host with Python.
"""

from __future__ import annotations

import ast
import hashlib
import json
import shutil
import sys
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass, replace
from importlib.metadata import PackageNotFoundError, distribution, version
from pathlib import Path
from typing import Any

import eightpost.shock
import eightpost.vehicle.friction
from builder.interface import Description, content_guid, friction_ports, model_description, source_folder, spring_ports
from builder.product import Product
from builder.reference import Disclosure, Subject
from eightpost import __version__
from eightpost.archive import read_archive
from eightpost.extras import needs
from eightpost.shock import Shock
from eightpost.vehicle import Vehicle

#: Capabilities of PythonFMU's binary (its Linux and Windows libraries forward all calls to the slave).
CAPABILITIES = {
    "needsExecutionTool": "true",
    "canHandleVariableCommunicationStepSize": "true",
    "canInterpolateInputs": "false",
    "canBeInstantiatedOnlyOncePerProcess": "false",
    "canNotUseMemoryManagementFunctions": "true",
    "canGetAndSetFMUstate": "true",
    "canSerializeFMUstate": "true",
    "providesDirectionalDerivative": "false",
}


@dataclass(frozen=True)
class _Slave:
    """Code of a Python FMU: the slave, unchanged copies of library files, and model data that is not a variable."""

    product: Product
    main: Path
    code: tuple[Path, ...]
    model: Mapping[str, Any]


def python_fmu(product: Product) -> dict[str, bytes]:
    """Return the archive's members; the same product gives the same bytes."""
    product = replace(product, interface=product.interface.without_states())
    source = product.source
    slave = _shock_slave(product, source) if isinstance(source, Shock) else _vehicle_slave(product, source)
    with tempfile.TemporaryDirectory() as folder:
        staged = _stage(slave, Path(folder))
        members = _pack(staged, Path(folder) / "out")
    subject = Subject(product.identifier, product.text, product.interface, source)
    from builder.documents import documents  # noqa: PLC0415 -- drawing starts slowly

    members |= documents(subject, disclosure=Disclosure.FULL)
    _describe(product, members)
    return members


def _shock_slave(product: Product, shock: Shock) -> _Slave:
    law = Path(eightpost.shock.__file__).with_name(f"{shock.law_name}.py")
    common = source_folder() / "common"
    model: dict[str, Any] = {"law": law.stem, "class": type(shock.law).__name__}
    code = imported_files(law)
    if shock.settings is not None:
        model["settings"] = asdict(shock.settings)
        code = tuple(dict.fromkeys((*code, *imported_files(law.with_name("settings.py")))))
    return _Slave(product, common / "shock_slave.py", (*code, common / "table_slave.py"), model)


def _vehicle_slave(product: Product, vehicle: Vehicle) -> _Slave:
    model = vehicle.coupled()
    offsets = {v.name: v.offset for v in product.interface.variables}
    outputs = [c.name for c in model.outputs]
    data = {name: getattr(model, name).tolist() for name in "ABCD"} | {
        "inputs": [c.name for c in model.inputs],
        "outputs": outputs,
        "offsets": [offsets[name] for name in outputs],
        "ports": list(friction_ports(product.interface)),
        "springs": list(spring_ports(product.interface)),
    }
    code = imported_files(Path(eightpost.vehicle.friction.__file__))  # includes the kernel
    fmus = source_folder()
    return _Slave(product, fmus / product.sources / "slave.py", (*code, fmus / "common" / "table_slave.py"), data)


def imported_files(source: Path) -> tuple[Path, ...]:
    """Return a module's file and all its relative imports; together they work in any other package."""
    found: dict[Path, None] = {}

    def visit(file: Path) -> None:
        if file not in found:
            found[file] = None
            for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
                if isinstance(node, ast.ImportFrom) and node.level == 1 and node.module:
                    visit(file.with_name(f"{node.module}.py"))

    visit(source)
    return tuple(found)


def _stage(slave: _Slave, folder: Path) -> Path:
    """Write the slave, its package and its table under names unique to this FMU; return the slave's file."""
    table = json.dumps(_table(slave), indent=1, allow_nan=False)
    digest = hashlib.sha256(table.encode())
    for file in (slave.main, *slave.code):
        digest.update(file.read_bytes())
    name = f"{slave.product.identifier}_{digest.hexdigest()[:8]}"
    package = folder / f"{name}_law"
    package.mkdir()
    (package / "__init__.py").write_text(
        '"""Unchanged copies of files of the eightpost library."""\n', encoding="utf-8"
    )
    for file in slave.code:
        shutil.copyfile(file, package / file.name)
    (folder / f"{name}.json").write_text(table + "\n", encoding="utf-8")
    shutil.copyfile(slave.main, folder / f"{name}.py")
    return folder / f"{name}.py"


def _table(slave: _Slave) -> dict[str, Any]:
    rows = []
    for variable in slave.product.interface.variables:
        row = asdict(variable)
        rows.append({"min": row.pop("minimum"), "max": row.pop("maximum"), **row})
    return {
        "identifier": slave.product.identifier,
        "description": slave.product.text,
        "variables": rows,
        "model": dict(slave.model),
    }


def _pack(slave: Path, folder: Path) -> dict[str, bytes]:
    """Pack the slave with PythonFMU; return the archive's members."""
    package = slave.with_name(f"{slave.stem}_law")
    with _clean_imports(slave.stem):
        with needs("build", "building python FMUs"):
            from pythonfmu.builder import FmuBuilder  # noqa: PLC0415 - the import is slow and only needed here

        path = FmuBuilder.build_FMU(slave, dest=folder, project_files=[package, slave.with_suffix(".json")])
    members = read_archive(path)
    del members["modelDescription.xml"]
    return members


@contextmanager
def _clean_imports(name: str) -> Iterator[None]:
    """Import PythonFMU as it is installed, and remove the paths and modules that it adds to inspect a slave.

    A python FMU that ran in this process has left its own copy of PythonFMU, which lacks what a build needs, and
    perhaps the same slave.
    """
    path, write_bytecode = sys.path.copy(), sys.dont_write_bytecode
    sys.dont_write_bytecode = True
    ours = (name, f"{name}_law", "pythonfmu")
    earlier = {key: sys.modules.pop(key) for key in list(sys.modules) if key.split(".")[0] in ours}
    with suppress(PackageNotFoundError):
        sys.path.insert(0, str(distribution("pythonfmu").locate_file("")))
    try:
        yield
    finally:
        sys.path[:], sys.dont_write_bytecode = path, write_bytecode
        for module in [key for key in sys.modules if key.split(".")[0] in ours]:
            del sys.modules[module]
        sys.modules |= earlier


def _describe(product: Product, members: dict[str, bytes]) -> None:
    """Add modelDescription.xml; its GUID is a digest of the whole archive."""
    library = version("pythonfmu")
    description = Description(
        identifier=product.identifier,
        guid="",
        text=product.text,
        interface=product.interface,
        capabilities=CAPABILITIES,
        generation_tool=f"eightpost {__version__} with PythonFMU {library}",
    )
    guid = content_guid(model_description(description), members)
    members["modelDescription.xml"] = model_description(replace(description, guid=guid))
