"""The native FMU: description, sources, binaries and documents of one archive."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from builder.description import Description, content_guid, model_description
from builder.documents import SECRET, Disclosure, Subject, documents
from builder.interface import Interface
from builder.native.compiler import Library, compile_libraries
from builder.native.sources import c_sources
from builder.native.toolchain import Toolchain
from builder.product import Product
from eightpost import __version__

#: What fmus/common does for every model.
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


@dataclass(frozen=True)
class _Source:
    """An FMU without its binaries: the archive's other members, and what to compile."""

    members: dict[str, bytes]
    library: Library


def native_fmus(
    products: Sequence[Product],
    *,
    toolchain: Toolchain,
    disclosure: Disclosure = Disclosure.FULL,
    progress: Callable[[int, int], None] | None = None,
) -> list[dict[str, bytes]]:
    """Return the members of each product's archive; the same product gives the same bytes.

    Args:
        products: What to build.
        toolchain: What compiles, and for which platforms.
        disclosure: A confidential FMU carries neither sources nor the curve.
        progress: Called with the number of binaries done and of all.

    Raises:
        FmuError: A vehicle has no modal form, or the compiler refuses.
    """
    sources = [_source(product, disclosure) for product in products]
    libraries = [source.library for source in sources]
    binaries = compile_libraries(libraries, toolchain=toolchain, progress=progress)
    return [source.members | found for source, found in zip(sources, binaries, strict=True)]


def _source(product: Product, disclosure: Disclosure) -> _Source:
    visible = _visible(product.interface, disclosure)
    # A shock is named after its record, unless it was given a name.
    text = product.text if disclosure is Disclosure.FULL else visible.description
    subject = Subject(product.identifier, text, visible, product.source)
    members = documents(subject, disclosure=disclosure)
    open_source = disclosure is Disclosure.FULL
    drafted = c_sources(product, visible, "")
    description = Description(
        identifier=product.identifier,
        guid="",
        text=text,
        interface=visible,
        capabilities=CAPABILITIES,
        generation_tool=f"eightpost {__version__}",
        source_files=tuple(name for name in sorted(drafted) if name.endswith(".c")) if open_source else (),
    )
    guid = content_guid(description, members | {f"sources/{name}": content for name, content in drafted.items()})
    code = c_sources(product, visible, guid)
    members["modelDescription.xml"] = model_description(replace(description, guid=guid))
    if open_source:
        members |= {f"sources/{name}": content for name, content in code.items()}
    return _Source(members, Library(product.identifier, code))


def _visible(interface: Interface, disclosure: Disclosure) -> Interface:
    """Leave the curve out of a confidential interface: it is compiled in, and can be neither read nor set."""
    if disclosure is Disclosure.FULL:
        return interface
    shown = tuple(v for v in interface.variables if not v.name.startswith(SECRET))
    names = {v.name for v in shown}
    initial = {output: tuple(n for n in known if n in names) for output, known in interface.initial.items()}
    return replace(interface, variables=shown, initial=initial)
