"""Construction of FMUs from shock files and vehicle files, native or with a slave in Python."""

from __future__ import annotations

import ast
import hashlib
import json
import re
import shutil
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass, replace
from functools import partial
from importlib.metadata import PackageNotFoundError, distribution, version
from pathlib import Path
from types import MappingProxyType
from typing import Any

import eightpost.shock
import eightpost.vehicle.friction
from builder.interface import Interface, content_guid, friction_ports, model_description, source_folder, spring_ports
from builder.native_fmu import compiled, without_binaries
from builder.product import Product, shock_product, vehicle_product
from builder.reference import Disclosure, validity_of
from builder.toolchain import find_toolchain
from eightpost import __version__
from eightpost.archive import read_archive, write_archive
from eightpost.display import Summarized, Summary, some
from eightpost.errors import FmuError, choice_of
from eightpost.extras import needs
from eightpost.files import document_kind
from eightpost.outputs import check_folder
from eightpost.progress import Progress, beats
from eightpost.shock import Shock, read_shock
from eightpost.validity import Validity
from eightpost.vehicle import Vehicle, read_vehicle
from eightpost.verdict import Verdict

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


#: Code of a Python FMU: the slave, unchanged copies of library files, and model data that is not a variable.
_Slave = tuple[Path, tuple[Path, ...], Mapping[str, Any]]


def _python_fmu(product: Product) -> dict[str, bytes]:
    """Return the archive's members; the same product gives the same bytes."""
    product = replace(product, interface=product.interface.without_states())
    source = product.source
    slave = _shock_slave(source) if isinstance(source, Shock) else _vehicle_slave(product.interface, source)
    with tempfile.TemporaryDirectory() as folder:
        staged = _stage(product, slave, Path(folder))
        members = _pack(staged, Path(folder) / "out")
    from builder.documents import documents  # noqa: PLC0415 -- drawing starts slowly

    members |= documents(product, disclosure=Disclosure.FULL)
    tool = f"eightpost {__version__} with PythonFMU {version('pythonfmu')}"
    described, kinds = (product.identifier, product.text, product.interface), {"CoSimulation": CAPABILITIES}
    describe = partial(model_description, *described, tool=tool, kinds=kinds)
    return members | {"modelDescription.xml": describe(guid=content_guid(describe(), members))}


def _shock_slave(shock: Shock) -> _Slave:
    law = Path(eightpost.shock.__file__).with_name(f"{shock.law_name}.py")
    common = source_folder() / "common"
    model: dict[str, Any] = {"law": law.stem, "class": type(shock.law).__name__}
    code = _imported_files(law)
    if shock.settings is not None:
        model["settings"] = asdict(shock.settings)
        code = tuple(dict.fromkeys((*code, *_imported_files(law.with_name("settings.py")))))
    return common / "shock_slave.py", (*code, common / "table_slave.py"), model


def _vehicle_slave(interface: Interface, vehicle: Vehicle) -> _Slave:
    model = vehicle.coupled()
    offsets = {v.name: v.offset for v in interface.variables}
    outputs = [c.name for c in model.outputs]
    data = {name: getattr(model, name).tolist() for name in "ABCD"} | {
        "inputs": [c.name for c in model.inputs],
        "outputs": outputs,
        "offsets": [offsets[name] for name in outputs],
        "ports": list(friction_ports(interface)),
        "springs": list(spring_ports(interface)),
    }
    code = _imported_files(Path(eightpost.vehicle.friction.__file__))  # includes the kernel
    fmus = source_folder()
    return fmus / interface.kind / "slave.py", (*code, fmus / "common" / "table_slave.py"), data


def _imported_files(source: Path) -> tuple[Path, ...]:
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


def _stage(product: Product, slave: _Slave, folder: Path) -> Path:
    """Write the slave, its package and its table under names unique to this FMU; return the slave's file."""
    main, code, model = slave
    rows = []
    for variable in product.interface.variables:
        row = asdict(variable)
        rows.append({"min": row.pop("minimum"), "max": row.pop("maximum"), **row})
    content = {"identifier": product.identifier, "description": product.text, "variables": rows}
    table = json.dumps(content | {"model": dict(model)}, indent=1, allow_nan=False)
    digest = hashlib.sha256(table.encode())
    for file in (main, *code):
        digest.update(file.read_bytes())
    name = f"{product.identifier}_{digest.hexdigest()[:8]}"
    package = folder / f"{name}_law"
    package.mkdir()
    note = '"""Unchanged copies of files of the eightpost library."""\n'
    (package / "__init__.py").write_text(note, encoding="utf-8")
    for file in code:
        shutil.copyfile(file, package / file.name)
    (folder / f"{name}.json").write_text(table + "\n", encoding="utf-8")
    shutil.copyfile(main, folder / f"{name}.py")
    return folder / f"{name}.py"


def _pack(slave: Path, folder: Path) -> dict[str, bytes]:
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


# ==== Build ==========================================================================================================

#: A built FMU and the members of its archive.
Members = tuple["Built", Mapping[str, bytes]]

TARGETS = ("native", "python", "all")

#: FMI versions to build for: 2.0, 3.0, or both.
VERSIONS: Mapping[str, tuple[int, ...]] = MappingProxyType({"2": (2,), "3": (3,), "all": (2, 3)})


@dataclass(frozen=True, repr=False)
class Built(Summarized):
    """One FMU that was written."""

    path: Path  #: FMU file.
    source: str  #: Shock file or vehicle file that the FMU was built from.
    interface: Interface  #: Variables of the FMU and their dependencies.
    target: str  #: `native` or `python`.
    validity: Validity  #: Verdict on the model and the ranges in which it may be used.
    fmi: int = 2  #: FMI version, 2 or 3.
    limits: str = ""  #: Limits of the toolchain, such as platforms without a binary, or an empty string.

    def __fspath__(self) -> str:
        return str(self.path)

    def _summary(self) -> Summary:
        names = self.interface.names
        return Summary.of(
            f"FMU {self.path}",
            ("source", Path(self.source).name),
            ("kind", f"{self.interface.kind} {self.interface.version}, FMI {self.fmi}.0, {self.target}"),
            ("verdict", self.validity.verdict.headline),
            *((f"{causality}s", some(names(causality))) for causality in ("input", "output", "parameter")),
            ("limits", self.limits),
        )


def build(
    sources: Sequence[str | Path],
    folder: str | Path,
    *,
    target: str = "native",
    fmi: str = "2",
    disclosure: Disclosure = Disclosure.FULL,
    temperature_input: bool = False,
    progress: Progress | None = None,
) -> list[Built]:
    """Build one FMU per source file into `folder`; each is named after its source.

    Args:
        sources: Shock files (`eightpost fit`) and vehicle files (.toml with parameters, .json with a state space).
        folder: Output folder; created if it does not exist. Nothing is written before all FMUs are built.
        target: `native`, `python`, or `all` for both: the Python FMU is then named <name>_python.fmu.
        fmi: FMI version of native FMUs: `2` for FMI 2.0, `3` for FMI 3.0, or `all` for both: the FMU of FMI 3.0 is
            then named <name>_fmi3.fmu. Python FMUs are of FMI 2.0.
        disclosure: Amount of information in the archive; a confidential FMU contains neither sources nor the curve,
            and must be native.
        temperature_input: Whether the temperature of shocks with settings is an input instead of a parameter.
        progress: Callback that receives the number of compiled binaries and the total number.

    Raises:
        FmuError: Two sources would give the same FMU, a vehicle cannot become an FMU, or there is no compiler.
        InputError: A source cannot be read.
    """
    target, fmi = choice_of("target", target, TARGETS), choice_of("FMI version", fmi, VERSIONS)
    if target != "native" and fmi != "2":
        raise FmuError("python FMUs are of FMI 2.0 (PythonFMU); build FMI 3.0 with --target native")
    if disclosure is not Disclosure.FULL and target != "native":
        raise FmuError("a python FMU contains its source code; a confidential FMU must be native (--target native)")
    check_folder(folder)
    products = [
        (str(source), product_of(Path(source), temperature_input=temperature_input)) for source in beats(sources)
    ]
    names = [product.identifier.lower() for _, product in products]  # Windows and macOS ignore case in file names
    if fmi == "all":
        names += [f"{name}_fmi3" for name in names]
    if doubled := sorted({name for name in names if names.count(name) > 1}):
        raise FmuError(f"several sources would be written to {doubled[0]}.fmu; rename one of them")
    built: list[Members] = []
    if target != "python":
        built += _native(products, Path(folder), VERSIONS[fmi], disclosure, progress)
    if target != "native":
        suffix = "_python" if target == "all" else ""
        for source, product in products:
            path = Path(folder) / f"{product.identifier}{suffix}.fmu"
            item = Built(path, source, product.interface, "python", validity_of(product.source))
            built.append((item, _python_fmu(product)))
    for item, members in built:
        write_archive(item.path, members)
    return [item for item, _ in built]


def verdict_on(built: Sequence[Built]) -> Verdict:
    """Return the verdict on all models, with the FMU that each reason is from."""
    return Verdict(
        replace(reason, origin=f"{item.path.name}: {reason.origin}")
        for item in built
        for reason in item.validity.verdict.reasons
    )


def _native(
    products: Sequence[tuple[str, Product]],
    folder: Path,
    versions: Sequence[int],
    disclosure: Disclosure,
    progress: Progress | None,
) -> list[Members]:
    toolchain = find_toolchain()
    suffix = "_fmi3" if len(versions) > 1 else ""  # of FMI 3.0 in a release with both versions
    wanted = [
        (source, replace(product, identifier=f"{product.identifier}{suffix if fmi == 3 else ''}"), fmi)
        for source, product in products
        for fmi in versions
    ]
    fmus = [without_binaries(product, disclosure, fmi) for _, product, fmi in wanted]
    archives = compiled(fmus, toolchain=toolchain, progress=progress)
    built: list[Members] = []
    for (source, product, fmi), members in zip(wanted, archives, strict=True):
        path, validity = folder / f"{product.identifier}.fmu", validity_of(product.source)
        built.append((Built(path, source, product.interface, "native", validity, fmi, toolchain.limits), members))
    return built


def product_of(source: Path, *, temperature_input: bool = False) -> Product:
    """Return the product of a shock file or vehicle file.

    Args:
        source: Path of the file.
        temperature_input: Whether the temperature of a shock with settings is an input instead of a parameter.

    Raises:
        FmuError: The file is not one, or its vehicle cannot become an FMU.
        InputError: The file cannot be read.
    """
    identifier = fmu_identifier(source.stem)
    if source.is_dir():
        raise FmuError(f"{source}: is a folder, not a file; name the files in it")
    if not source.is_file():
        raise FmuError(f"{source}: the file does not exist; correct the path, or create the file (eightpost fit)")
    if source.suffix == ".json" and document_kind(source) == "shock":
        return shock_product(read_shock(source), identifier, temperature_input=temperature_input)
    if source.suffix in (".json", ".toml"):
        _refuse_a_system(source)
        return vehicle_product(read_vehicle(source), identifier)
    advice = "; fit a record first (eightpost fit)" if source.suffix in (".csv", ".mat", ".parquet") else ""
    raise FmuError(f"{source}: build takes shock files (.json) and vehicle files (.toml, .json){advice}")


def _refuse_a_system(source: Path) -> None:
    """Raise an error if the file describes a system: a system has [components], a vehicle has a model."""
    if source.suffix == ".toml" and re.search(r"^\s*\[components", source.read_text("utf-8", "replace"), re.MULTILINE):
        raise FmuError(
            f"{source}: the file describes a system of FMUs, not a vehicle; run it (eightpost run) or pack it "
            "(eightpost ssp), and build the vehicle and shock files of its FMUs instead"
        )


#: Keywords of C, and names that Windows does not allow for files.
_RESERVED = frozenset(
    re.findall(
        r"\w+",
        """
        auto break case char const continue default do double else enum extern float for goto if inline int long
        register restrict return short signed sizeof static struct switch typedef union unsigned void volatile while
        con prn aux nul com1 com2 com3 com4 com5 com6 com7 com8 com9 lpt1 lpt2 lpt3 lpt4 lpt5 lpt6 lpt7 lpt8 lpt9
        """,
    )
)


def fmu_identifier(name: str) -> str:
    """Return a model identifier from a file's name: a valid C name (FMI) that is also a valid Windows file name."""
    identifier = re.sub(r"\W", "_", name, flags=re.ASCII)
    if identifier.lower() in _RESERVED:
        return f"{identifier}_"
    return f"_{identifier}" if identifier[:1].isdigit() or not identifier else identifier
