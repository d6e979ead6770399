"""The documents of one FMU: a page, a picture, an icon, terminals, reference results, the licence."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from builder.documents.icon import icon
from builder.documents.markup import Section
from builder.documents.origin import open_shock_origin, shock_origin, vehicle_origin
from builder.documents.page import Contents, Picture, page
from builder.documents.picture import LOOP_FREQUENCY, shock_picture, vehicle_picture
from builder.documents.reference import results
from builder.documents.subject import SECRET, Disclosure, Subject
from builder.documents.terminals import terminals_and_icons
from builder.documents.validity import validity_member
from builder.sources import source_folder
from eightpost.shock import Response, Shock


@dataclass(frozen=True)
class _Told:
    """What may be told of a subject: the subject itself as far as it may, its picture, its origin, its results."""

    subject: Subject
    picture: Picture
    origin: Sequence[Section]
    recorded: tuple[str, ...]


def documents(subject: Subject, *, disclosure: Disclosure) -> dict[str, bytes]:
    """Return what an archive carries for people and tools: member name -> content.

    The same subject gives the same bytes. A confidential archive has no curve picture, no coefficients, and neither
    names nor digests of source files; nor the subject's name, which is often that of its file.
    """
    told = _TELL[disclosure](subject)
    known = told.subject
    reference = results(known, told.recorded)
    contents = Contents(known.identifier, known.text, known.interface, told.picture, told.origin, bool(reference))
    return {
        "model.png": told.picture.png,
        "documentation/index.html": page(contents),
        "documentation/licenses/license.txt": (source_folder() / "LICENSE.txt").read_bytes(),
        "terminalsAndIcons/terminalsAndIcons.xml": terminals_and_icons(known.interface),
        "terminalsAndIcons/icon.png": icon(known.source),
        **validity_member(subject.source, subject.identifier, disclosure),
        **reference,
    }


def _full(subject: Subject) -> _Told:
    source = subject.source
    if isinstance(source, Shock):
        caption = (
            "Force at the port without gas force; shaded: the fitted range. Where the law has lag, the loop is its "
            f"answer to a sine of {LOOP_FREQUENCY:g} Hz."
        )
        return _Told(subject, Picture(shock_picture(source), caption), shock_origin(source), Response._fields)
    caption = "Frequency responses with the linear dampers that the vehicle's source states; the FMU itself has none."
    return _Told(subject, Picture(vehicle_picture(source), caption), vehicle_origin(source), ())


def _confidential(subject: Subject) -> _Told:
    interface = subject.interface
    shown = replace(interface, variables=tuple(v for v in interface.variables if not v.name.startswith(SECRET)))
    origin = open_shock_origin(subject.source) if isinstance(subject.source, Shock) else []
    return _Told(
        replace(subject, text=interface.description, interface=shown),
        Picture(icon(subject.source), "A confidential build: what it was made from is not in this archive.", "icon"),
        origin,
        ("force",),
    )


_TELL: dict[Disclosure, Callable[[Subject], _Told]] = {Disclosure.FULL: _full, Disclosure.CONFIDENTIAL: _confidential}
