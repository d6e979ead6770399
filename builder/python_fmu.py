"""The python FMU: a slave staged with the library's own law or kernel, packed by pythonfmu, described by us.

pythonfmu's own XML lacks units, dependencies and InitialUnknowns, and its archive differs from build to build; both
are replaced. It is the readable reference: it needs a Python host.
"""

from __future__ import annotations

import ast
import hashlib
import json
import shutil
import sys
import tempfile
import uuid
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from builder.description import Description, model_description
from builder.interface import Interface
from builder.sources import source_folder
from eightpost import __version__
from eightpost.archive import read_archive, write_archive

#: What pythonfmu's binary can do (its Linux and Windows libraries forward to the slave).
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

_NAMESPACE = uuid.uuid5(uuid.NAMESPACE_DNS, "fmu.eightpost")


@dataclass(frozen=True)
class PythonModel:
    """What a python FMU is made of.

    `slave` is the folder under fmus/ whose slave.py it runs, `code` the library files that it ships to the byte, and
    `model` what the slave needs beyond its variables (JSON values).
    """

    identifier: str
    text: str
    interface: Interface
    slave: str
    code: tuple[Path, ...]
    model: Mapping[str, Any]
    documents: Mapping[str, bytes]


def build_python_fmu(model: PythonModel, path: str | Path) -> None:
    """Write the FMU; the same model gives the same bytes."""
    with tempfile.TemporaryDirectory() as folder:
        staged = _stage(model, Path(folder))
        members = _pack(staged, Path(folder) / "out")
    members |= model.documents
    _describe(model, members)
    write_archive(path, members)


def imported_files(source: Path) -> tuple[Path, ...]:
    """Return a module's file and all that it imports relatively, so that they work together in another package."""
    found: dict[Path, None] = {}

    def visit(file: Path) -> None:
        if file not in found:
            found[file] = None
            for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
                if isinstance(node, ast.ImportFrom) and node.level == 1 and node.module:
                    visit(file.with_name(f"{node.module}.py"))

    visit(source)
    return tuple(found)


def _stage(model: PythonModel, folder: Path) -> Path:
    """Lay out slave, package and table under names that no other FMU has; return the slave's file."""
    table = json.dumps(_table(model), indent=1, allow_nan=False)
    slave = source_folder() / model.slave / "slave.py"
    digest = hashlib.sha256(table.encode())
    for file in (slave, *model.code):
        digest.update(file.read_bytes())
    name = f"{model.identifier}_{digest.hexdigest()[:8]}"
    package = folder / f"{name}_law"
    package.mkdir()
    (package / "__init__.py").write_text('"""The library\'s own files, to the byte."""\n', encoding="utf-8")
    for file in model.code:
        shutil.copyfile(file, package / file.name)
    (folder / f"{name}.json").write_text(table + "\n", encoding="utf-8")
    shutil.copyfile(slave, folder / f"{name}.py")
    return folder / f"{name}.py"


def _table(model: PythonModel) -> dict[str, Any]:
    rows = []
    for variable in model.interface.variables:
        row = asdict(variable)
        rows.append({"min": row.pop("minimum"), "max": row.pop("maximum"), **row})
    return {
        "identifier": model.identifier,
        "description": model.text,
        "variables": rows,
        "model": dict(model.model),
    }


def _pack(slave: Path, folder: Path) -> dict[str, bytes]:
    """Let pythonfmu pack the slave; return the archive's members."""
    from pythonfmu.builder import FmuBuilder  # noqa: PLC0415 - only a python build pays for its import

    package = slave.with_name(f"{slave.stem}_law")
    with _clean_imports(slave.stem):
        path = FmuBuilder.build_FMU(slave, dest=folder, project_files=[package, slave.with_suffix(".json")])
    members = read_archive(path)
    del members["modelDescription.xml"]
    return members


@contextmanager
def _clean_imports(name: str) -> Iterator[None]:
    """Undo what pythonfmu leaves behind when it imports a slave to look at it: paths and modules."""
    path, write_bytecode = sys.path.copy(), sys.dont_write_bytecode
    sys.dont_write_bytecode = True
    try:
        yield
    finally:
        sys.path[:], sys.dont_write_bytecode = path, write_bytecode
        for module in [key for key in sys.modules if key.split(".")[0] in (name, f"{name}_law")]:
            del sys.modules[module]


def _describe(model: PythonModel, members: dict[str, bytes]) -> None:
    """Add modelDescription.xml, its GUID drawn from everything that is in the archive."""
    from pythonfmu import __version__ as pythonfmu_version  # noqa: PLC0415

    description = Description(
        identifier=model.identifier,
        guid="",
        text=model.text,
        interface=model.interface,
        capabilities=CAPABILITIES,
        generation_tool=f"eightpost {__version__} with PythonFMU {pythonfmu_version}",
    )
    digest = hashlib.sha256(model_description(description))
    for name in sorted(members):
        digest.update(name.encode() + b"\0" + hashlib.sha256(members[name]).digest())
    guid = str(uuid.uuid5(_NAMESPACE, digest.hexdigest()))
    members["modelDescription.xml"] = model_description(replace(description, guid=guid))
