"""Rules for the zip archive itself."""

from __future__ import annotations

import re
import zipfile
from collections import Counter
from collections.abc import Iterator
from pathlib import PurePosixPath

from builder.check.catalogue import archive as rules
from builder.check.catalogue import description as described
from builder.check.rules import Finding, listed
from builder.check.subject import XML, Subject
from eightpost.archive import unsafe_reason

_TOP = {XML, "model.png", "binaries", "sources", "documentation", "resources", "licenses", "terminalsAndIcons", "extra"}
_DECLARATION = re.compile(rb"""\A\s*<\?xml[^>]*encoding\s*=\s*["']([^"']+)["']""")


def at_top(subject: Subject) -> Iterator[Finding]:
    """Check that modelDescription.xml is at the top of the archive."""
    if XML not in subject.members:
        found = next(name for name in subject.members if PurePosixPath(name.replace("\\", "/")).name == XML)
        yield rules.ROOT.finding(f"it is at {found!r}; nothing else could be checked")


def paths(subject: Subject) -> Iterator[Finding]:
    """Check that no entry is outside the archive's folder."""
    for entry in subject.entries:
        if reason := unsafe_reason(entry):
            yield rules.PATHS.finding(f"the entry {entry.orig_filename!r} {reason}")


def duplicates(subject: Subject) -> Iterator[Finding]:
    """Check that entries are unique, also if upper and lower case are ignored."""
    counts = Counter(entry.filename for entry in subject.entries)
    for name, count in counts.items():
        if count > 1:
            yield rules.DUPLICATES.finding(f"{name!r} occurs {count} times")
    folded = Counter(name.casefold() for name in counts)
    alike = sorted(name for name in counts if folded[name.casefold()] > 1)
    if alike:
        yield rules.CASE.finding(f"{listed(alike)} are the same file on some systems")


def compression(subject: Subject) -> Iterator[Finding]:
    """Check that entries are deflated or stored."""
    odd = [e.filename for e in subject.entries if e.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)]
    if odd:
        yield rules.COMPRESSION.finding(f"compressed with other methods: {listed(odd)}")


def dates(subject: Subject) -> Iterator[Finding]:
    """Check that all entries have the same date."""
    found = sorted({entry.date_time for entry in subject.entries})
    if len(found) > 1:
        first, last = ("{:04}-{:02}-{:02} {:02}:{:02}:{:02}".format(*date) for date in (found[0], found[-1]))
        yield rules.DATES.finding(f"its entries have {len(found)} dates, from {first} to {last}")


def stray(subject: Subject) -> Iterator[Finding]:
    """Check that there are no unknown files at the top of the archive."""
    foreign = sorted({PurePosixPath(name).parts[0] for name in subject.members if name} - _TOP - {"/"})
    if XML in subject.members and foreign:
        yield rules.STRAY.finding(f"unknown: {listed(foreign)}")


def well_formed(subject: Subject) -> Iterator[Finding]:
    """Check that the XML can be parsed."""
    if subject.xml_error:
        yield described.WELL_FORMED.finding(f"{subject.xml_error}; its content could not be checked")


def encoding(subject: Subject) -> Iterator[Finding]:
    """Check that the XML is UTF-8."""
    content = subject.members.get(XML, b"").removeprefix(b"\xef\xbb\xbf")
    declared = _DECLARATION.match(content)
    if declared and declared[1].lower() not in (b"utf-8", b"utf8"):
        yield described.ENCODING.finding(f"it declares {declared[1].decode('latin-1')}")


RULES = (at_top, paths, duplicates, compression, dates, stray, well_formed, encoding)
