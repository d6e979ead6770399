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
class _Disclosed:
    """The information about a subject that may be disclosed: variables, picture, origin, recorded outputs."""

    subject: Subject
    picture: Picture
    origin: Sequence[Section]
    recorded: tuple[str, ...]


def documents(subject: Subject, *, disclosure: Disclosure) -> dict[str, bytes]:
    """Return the documents of an archive, for people and for tools: member name -> content.

    The same subject gives the same bytes. A confidential archive contains no curve picture, no coefficients, and
    neither names nor digests of source files. It also omits the subject's name, which is often the name of its file.
    """
    disclosed = _DISCLOSE[disclosure](subject)
    shown, picture = disclosed.subject, disclosed.picture
    reference = results(shown, disclosed.recorded)
    contents = Contents(shown.identifier, shown.text, shown.interface, picture, disclosed.origin, bool(reference))
    return {
        "model.png": picture.png,
        "documentation/index.html": page(contents),
        "documentation/licenses/license.txt": (source_folder() / "LICENSE.txt").read_bytes(),
        "terminalsAndIcons/terminalsAndIcons.xml": terminals_and_icons(shown.interface),
        "terminalsAndIcons/icon.png": icon(shown.source),
        **validity_member(subject.source, subject.identifier, disclosure),
        **reference,
    }


def _full(subject: Subject) -> _Disclosed:
    source = subject.source
    if isinstance(source, Shock):
        caption = (
            "Force at the port without gas force. Shaded: fitted range. If the law has lag, the loop is its "
            f"response to a sine of {LOOP_FREQUENCY:g} Hz."
        )
        return _Disclosed(subject, Picture(shock_picture(source), caption), shock_origin(source), Response._fields)
    caption = "Frequency responses with the linear dampers of the vehicle's source file. The FMU itself has no dampers."
    return _Disclosed(subject, Picture(vehicle_picture(source), caption), vehicle_origin(source), ())


def _confidential(subject: Subject) -> _Disclosed:
    interface = subject.interface
    shown = replace(interface, variables=tuple(v for v in interface.variables if not v.name.startswith(SECRET)))
    origin = open_shock_origin(subject.source) if isinstance(subject.source, Shock) else []
    return _Disclosed(
        replace(subject, text=interface.description, interface=shown),
        Picture(icon(subject.source), "A confidential build: its sources are not in this archive.", "icon"),
        origin,
        ("force",),
    )


_DISCLOSE: dict[Disclosure, Callable[[Subject], _Disclosed]] = {
    Disclosure.FULL: _full,
    Disclosure.CONFIDENTIAL: _confidential,
}
