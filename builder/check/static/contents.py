"""Rules for further contents of the archive: sources, documents, icon, reference results."""

from __future__ import annotations

import io
from collections.abc import Iterator

from builder.check.catalogue import archive as rules
from builder.check.catalogue import description as described
from builder.check.rules import Finding, listed
from builder.check.subject import Subject

_PNG = b"\x89PNG\r\n\x1a\n"


def sources(subject: Subject) -> Iterator[Finding]:
    """Check that the listed sources exist."""
    listed_files = subject.description.source_files if subject.description else ()
    missing = [name for name in listed_files if f"sources/{name}" not in subject.members]
    if missing:
        yield rules.SOURCE_FILES.finding(f"missing in sources/: {listed(missing)}")
    if not listed_files:
        yield rules.SOURCES.finding("no sources are listed")


def documents(subject: Subject) -> Iterator[Finding]:
    """Check that documentation and licence exist and are not empty."""
    page = subject.members.get("documentation/index.html")
    if page is None:
        yield rules.DOCUMENTATION.finding("it is missing")
    elif not page.strip():
        yield rules.DOCUMENTATION.finding("it is empty")
    licences = [name for name in subject.members if name.startswith(("documentation/licenses/", "licenses/"))]
    if not licences:
        yield rules.LICENSE.finding("it is missing")
    if empty := [name for name in licences if not subject.members[name].strip()]:
        yield rules.LICENSE.finding(f"empty: {listed(empty)}")


def icon(subject: Subject) -> Iterator[Finding]:
    """Check that model.png exists and can be decoded."""
    content = subject.members.get("model.png")
    if content is None:
        yield rules.ICON.finding("it is missing")
    elif not content.startswith(_PNG):
        yield rules.ICON_FORMAT.finding("it does not start with a PNG signature")
    elif fault := _fault_of_png(content):
        yield rules.ICON_FORMAT.finding(fault)


#: Maximum number of pixels that are decoded: a file of a few kilobytes can decode to gigabytes of one colour.
_MOST_PIXELS = 2**24


def _fault_of_png(content: bytes) -> str:
    from PIL import Image  # noqa: PLC0415 - comes with matplotlib; only a file with an icon needs it

    try:
        with Image.open(io.BytesIO(content), formats=("PNG",)) as picture:
            if picture.width * picture.height > _MOST_PIXELS:
                return f"it has {picture.width} x {picture.height} pixels, too many to be decoded"
            picture.load()
    except Exception as error:  # an exception of the decoder is a finding
        return f"it cannot be decoded: {str(error).partition(' <')[0]}"
    return ""


def reference(subject: Subject) -> Iterator[Finding]:
    """Check that there are reference results."""
    if not any(name.startswith("extra/") and name.endswith("_ref.csv") for name in subject.members):
        yield rules.REFERENCE_GIVEN.finding("there is no extra/.../*_ref.csv")


def file_name(subject: Subject) -> Iterator[Finding]:
    """Check that the file is named after the modelIdentifier."""
    identifier = subject.description.identifier if subject.description else ""
    if identifier and subject.path.stem != identifier:
        yield described.FILE_NAME.finding(f"the file is {subject.path.name}, the modelIdentifier {identifier}")


RULES = (sources, documents, icon, reference, file_name)
