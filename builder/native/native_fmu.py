"""Native FMUs: generated headers, C sources, compiled binaries."""

from __future__ import annotations

import io
import pickle
import zipfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from importlib.metadata import version
from pathlib import Path

import builder
import eightpost
from builder.documents.reference import SECRET, Disclosure, Subject
from builder.fmu.description import Description, content_guid, model_description
from builder.fmu.interface import Interface, source_folder
from builder.fmu.product import Product
from builder.native.settings_data import settings_data
from builder.native.source_folder import build_members, version_files
from builder.native.tables import interface_header, interface_source, layout
from builder.native.toolchain import Library, Toolchain, compile_libraries
from builder.native.vehicle_data import kept_numbers, vehicle_data
from eightpost import __version__
from eightpost.cache import digest, keep, recall
from eightpost.progress import Progress
from eightpost.shock import Shock
from eightpost.vehicle.modal import modal_form

#: Endings of the program's files that an FMU depends on.
_PROGRAM = (".py", ".c", ".h", ".css", ".html", ".js", ".txt", ".toml", ".json")

# ---- The C sources of one FMU ---------------------------------------------------------------------------------------

COMMON = (
    "calls.h",
    "component.h",
    "derivatives.c",
    "elementary.c",
    "elementary.h",
    "exchange.c",
    "fmu_state.c",
    "fresh.h",
    "instance.h",
    "lifecycle.c",
    "logging.c",
    "memory.c",
    "message.c",
    "message.h",
    "model_exchange.c",
    "names.h",
    "real.h",
    "refusals.c",
    "state_check.c",
    "step.c",
    "update.c",
    "variables.c",
    "wide.h",
)
SHOCK = ("curve.h", "lag.h", "settings.h", "shock.c", "shock.h")
#: Files of fmus/vehicle_ss besides model.c.
VEHICLE = (
    "advance.h",
    "coupled.h",
    "factors.h",
    "modal.h",
    "phi.h",
    "friction.h",
    "port_forces.h",
    "rates.c",
    "steady_state.h",
    "sub_steps.h",
)


def c_sources(product: Product, visible: Interface, guid: str) -> dict[str, bytes]:
    """Return the sources that both FMI versions have, by file name; a host can see the variables of `visible`."""
    folder = source_folder()
    model = {"model.c": (folder / product.sources / "model.c").read_bytes()}
    states = 0
    generated: dict[str, str] = {}
    if isinstance(product.source, Shock):
        model |= {name: (folder / "common" / name).read_bytes() for name in SHOCK}
        if product.source.settings is not None:
            law = product.source.law
            generated = {"settings_data.h": settings_data(product.source.settings, law, product.interface)}
    else:
        space = product.source.coupled()
        form = modal_form(space)
        states = kept_numbers(form, product.interface)
        model |= {name: (folder / product.sources / name).read_bytes() for name in VEHICLE}
        generated = {"vehicle_data.h": vehicle_data(space, form, product.interface)}
    plan = layout(product.interface, states)
    generated |= {
        "interface.h": interface_header(plan, product.identifier, guid),
        "interface.c": interface_source(plan, visible.variables),
    }
    common = {name: (folder / "common" / name).read_bytes() for name in COMMON}
    return common | model | {name: text.encode() for name, text in generated.items()}


# ---- Construction of native FMUs ------------------------------------------------------------------------------------

#: Capabilities of fmus/common, which are the same for every model.
CAPABILITIES = {
    "needsExecutionTool": "false",
    "canHandleVariableCommunicationStepSize": "true",
    "canInterpolateInputs": "true",
    "canBeInstantiatedOnlyOncePerProcess": "false",
    "canNotUseMemoryManagementFunctions": "false",
    "canGetAndSetFMUstate": "true",
    "canSerializeFMUstate": "true",
    "providesDirectionalDerivative": "true",
}


#: The same of the element ModelExchange.
EXCHANGE = {
    "needsExecutionTool": "false",
    "completedIntegratorStepNotNeeded": "true",
    "canBeInstantiatedOnlyOncePerProcess": "false",
    "canNotUseMemoryManagementFunctions": "false",
    "canGetAndSetFMUstate": "true",
    "canSerializeFMUstate": "true",
    "providesDirectionalDerivative": "true",
}


@dataclass(frozen=True)
class Source:
    """An FMU without its binaries: the other members of the archive, and the library to compile."""

    members: dict[str, bytes]
    library: Library


def native_fmus(
    products: Sequence[tuple[Product, int]],
    *,
    toolchain: Toolchain,
    disclosure: Disclosure = Disclosure.FULL,
    progress: Progress | None = None,
) -> list[dict[str, bytes]]:
    """Return the members of each product's archive; the same product gives the same bytes.

    Args:
        products: FMUs to build, each with its FMI version, 2 or 3.
        toolchain: Compiler and its platforms.
        disclosure: Amount of information in the archive; a confidential FMU contains neither sources nor the curve.
        progress: Callback that receives the number of finished binaries and the total number.

    Raises:
        FmuError: The compiler fails.
    """
    return compiled(
        [without_binaries(product, disclosure, fmi) for product, fmi in products],
        toolchain=toolchain,
        progress=progress,
    )


def compiled(
    sources: Sequence[Source], *, toolchain: Toolchain, progress: Progress | None = None
) -> list[dict[str, bytes]]:
    """Return the members of each archive with its binaries."""
    libraries = [source.library for source in sources]
    binaries = compile_libraries(libraries, toolchain=toolchain, progress=progress)
    return [source.members | found for source, found in zip(sources, binaries, strict=True)]


def without_binaries(product: Product, disclosure: Disclosure = Disclosure.FULL, fmi: int = 2) -> Source:
    """Return a product's FMU of an FMI version, 2 or 3, without its binaries.

    Its pictures and texts take long, so it is kept in the cache.
    """
    key = digest((pickle.dumps((product, disclosure, fmi)), *_program()))
    kept = recall("fmus", key)
    if kept is None:
        made = _without_binaries(product, disclosure, fmi)
        keep("fmus", key, _packed({"members": made.members, "sources": made.library.sources}))
        return made
    found = _unpacked(kept)
    is_wide = not isinstance(product.source, Shock)
    library = Library(product.identifier, found["sources"], is_one_unit=True, is_wide=is_wide, fmi=fmi)
    return Source(found["members"], library)


@cache
def _program() -> tuple[bytes, ...]:
    """Return what an FMU depends on besides its product: files of the program, and versions of libraries."""
    folders = [Path(package.__file__ or "").parent for package in (builder, eightpost)]
    files = sorted(path for folder in (*folders, source_folder()) for path in folder.rglob("*.*"))
    versions = (version(name).encode() for name in ("matplotlib", "numpy"))
    return (*versions, *(path.read_bytes() for path in files if path.suffix in _PROGRAM))


def _packed(parts: Mapping[str, Mapping[str, bytes]]) -> bytes:
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w") as archive:
        for part, files in parts.items():
            for name, file in files.items():
                archive.writestr(f"{part}/{name}", file)
    return content.getvalue()


def _unpacked(content: bytes) -> dict[str, dict[str, bytes]]:
    found: dict[str, dict[str, bytes]] = {}
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        for path in archive.namelist():
            part, _, name = path.partition("/")
            found.setdefault(part, {})[name] = archive.read(path)
    return found


def _without_binaries(product: Product, disclosure: Disclosure, fmi: int) -> Source:
    from builder.documents.archive import documents  # noqa: PLC0415 -- drawing starts slowly, and most FMUs are kept

    visible = _visible(product.interface, disclosure)
    # By default, a shock has the name of its record, which is confidential.
    text = product.text if disclosure is Disclosure.FULL else visible.description
    subject = Subject(product.identifier, text, visible, product.source)
    members = documents(subject, disclosure=disclosure, fmi=fmi)
    description = Description(
        identifier=product.identifier,
        guid="",
        text=text,
        interface=visible,
        capabilities=CAPABILITIES,
        generation_tool=f"eightpost {__version__}",
        exchange=EXCHANGE,
    )
    return sealed(
        description,
        members,
        lambda guid: c_sources(product, visible, guid),
        fmi=fmi,
        disclosure=disclosure,
        is_one_unit=True,
        is_wide=not isinstance(product.source, Shock),
    )


#: Members that have another place in FMI 3.0.
_PLACES_3 = {"model.png": "documentation/diagram.png"}


def sealed(
    description: Description,
    members: Mapping[str, bytes],
    code: Callable[[str], dict[str, bytes]],
    *,
    fmi: int,
    disclosure: Disclosure = Disclosure.FULL,
    is_one_unit: bool = False,
    is_wide: bool = False,
) -> Source:
    """Return an FMU without its binaries, with a GUID that is a digest of its whole content.

    Args:
        description: Content of modelDescription.xml, without GUID and source files.
        members: Documents.
        code: Function that returns the C sources for a GUID.
        fmi: FMI version, 2 or 3.
        disclosure: Amount of information in the archive; a confidential FMU contains no sources.
        is_one_unit: Whether the C files can be compiled as one translation unit (see `Library`).
        is_wide: Whether they are also compiled for processors with AVX, which helps models with many sums of products.
    """
    version = version_files(description.identifier, fmi)
    drafted = code("") | version
    members = {_PLACES_3.get(name, name) if fmi == 3 else name: content for name, content in members.items()}
    named = {f"sources/{name}": content for name, content in drafted.items()}
    if disclosure is Disclosure.FULL:
        description = replace(description, source_files=tuple(n for n in sorted(drafted) if n.endswith(".c")))
        members = {**members, **build_members(description.identifier, description.source_files, fmi)}
    guid = content_guid(model_description(description, fmi), {**members, **named})
    found = code(guid) | version
    sources = {f"sources/{name}": content for name, content in found.items()} if description.source_files else {}
    xml = model_description(replace(description, guid=guid), fmi)
    library = Library(description.identifier, found, is_one_unit=is_one_unit, is_wide=is_wide, fmi=fmi)
    return Source({**members, "modelDescription.xml": xml, **sources}, library)


def _visible(interface: Interface, disclosure: Disclosure) -> Interface:
    """Remove the curve from a confidential interface: it is compiled in, and can be neither read nor set."""
    if disclosure is Disclosure.FULL:
        return interface
    shown = tuple(v for v in interface.variables if not v.name.startswith(SECRET))
    names = {v.name for v in shown}
    initial = {unknown: tuple(n for n in known if n in names) for unknown, known in interface.initial.items()}
    return replace(interface, variables=shown, initial=initial)
