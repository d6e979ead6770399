"""The documents of an assembly: page, picture, licence, reference results."""

from __future__ import annotations

import re

from builder.assembly.models import shock_law
from builder.assembly.plan import Assembly
from builder.assembly.reference import assembly_reference
from builder.documents.equations import equations
from builder.documents.markup import Column, Section, folded, paragraph, table
from builder.documents.page import Contents, Picture, page
from builder.documents.picture import curves_picture
from builder.documents.reference import reference_files
from builder.documents.validity import combined_member
from builder.interface import Interface
from builder.sources import source_folder

_PARTS = (Column("component", "name"), Column("FMU", "tight"), Column("description"), Column("GUID", "digest"))
_CONNECTIONS = (Column("from", "name"), Column("to", "name"), Column("gain", "number"), Column("offset", "number"))
_CAPTION = "Force at the port of each shock without gas force, over the fitted velocity range."


def assembly_documents(assembly: Assembly, interface: Interface) -> dict[str, bytes]:
    """Return the documents of an archive: member name -> content; the same assembly gives the same bytes."""
    picture = curves_picture(assembly.identifier, {part.name: shock_law(assembly, part) for part in assembly.shocks})
    reference = assembly_reference(assembly, interface)
    contents = Contents(
        assembly.identifier,
        assembly.text,
        interface,
        Picture(picture, _CAPTION),
        [_parts(assembly), _connections(assembly), _equations(assembly)],
        reference is not None,
    )
    return {
        "model.png": picture,
        "documentation/index.html": page(contents),
        "documentation/licenses/license.txt": (source_folder() / "LICENSE.txt").read_bytes(),
        **combined_member(
            {part.name: part.validity for part in assembly.parts},
            {link.target: link.source for link in assembly.links if link.gain * link.factor == 1.0},
            frozenset(v.name for v in interface.variables),
        ),
        **(reference_files(reference, assembly.identifier) if reference else {}),
    }


def _parts(assembly: Assembly) -> Section:
    rows = [(part.name, part.file, part.text, part.guid) for part in assembly.parts]
    return Section("Parts", table(_PARTS, rows))


def _connections(assembly: Assembly) -> Section:
    rows = [
        (
            link.source,
            link.target,
            f"{link.gain * link.factor:g}",
            f"{link.gain * link.offset:g}" if link.offset else "",
        )
        for link in assembly.links
    ]
    return Section("Connections", table(_CONNECTIONS, rows))


def _equations(assembly: Assembly) -> Section:
    """Return the texts of the parts; anchors are prefixed with the kind, because several texts have equal headings."""
    kinds = dict.fromkeys(part.kind for part in assembly.parts)
    html = paragraph("These texts are also in the documentation of the parts' own FMUs.")
    for kind in kinds:
        html += folded(kind, re.sub(r'(id="|href="#)', rf"\g<1>{kind}-", equations(kind)))
    return Section("Equations of the parts", html)
