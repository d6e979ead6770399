"""Write docs/development/licences.md, the licences of all packages that eightpost[all] installs.

Run `python docs/make/make_licences.py`.

A licence is what a package states about itself: the licence expression of its metadata, its classifiers, its licence
field, or its licence file, in this order. A licence that the table below does not know stops the script, because
somebody has to look at it.
"""

from __future__ import annotations

import importlib.metadata
import re
from dataclasses import dataclass
from pathlib import Path

from packaging.requirements import Requirement

from eightpost.extras import EXTRAS, REQUIRED

PAGE = Path(__file__).parents[1] / "development" / "licences.md"

PERMISSIVE, WEAK, STRONG = "permissive", "weak copyleft", "copyleft"

#: Families of licences: words with which packages state them, and their kind. The first lines are read first.
FAMILIES = (
    (r"LGPL|GNU (Lesser|Library)", "LGPL", WEAK),
    (r"\bA?GPL|GNU (Affero )?General", "GPL", STRONG),
    (r"\bMPL|Mozilla Public", "MPL", WEAK),
    (r"Apache", "Apache-2.0", PERMISSIVE),
    (r"\bBSD\b|\bBSD-|Kiwi licensing|Redistribution and use in source and binary forms", "BSD", PERMISSIVE),
    (r"MIT-CMU|HPND", "MIT-CMU", PERMISSIVE),
    (r"\bMIT\b|Permission is hereby granted, free of charge", "MIT", PERMISSIVE),
    (r"PSF|Python Software Foundation", "PSF-2.0", PERMISSIVE),
    (r"\bISC\b", "ISC", PERMISSIVE),
    (r"0BSD|Unlicense|CC0|Public Domain", "public domain", PERMISSIVE),
)

INTRODUCTION = """# Licences of the dependencies

eightpost has the MIT licence. It contains no code of the packages below; `pip` installs them from their own
distributions. The table lists everything that `eightpost[all]` installs on Linux with Python {python}, including what
these packages depend on, with the licence that each package states. This page is generated:
`python docs/make/make_licences.py` writes it, and stops at a licence that it does not know.

"""


@dataclass(frozen=True, slots=True)
class Package:
    """One installed package.

    Attributes:
        name: Name of the distribution.
        stated: Licence as the package states it, shortened.
        kind: Kind of the licence.
        extras: Extras that install it; empty if every installation has it.
    """

    name: str
    stated: str
    kind: str
    extras: tuple[str, ...]


# ---- Which packages, and who needs them -----------------------------------------------------------------------------


def closure(names: set[str]) -> set[str]:
    """Return the normalized names of distributions and of all that they depend on on this machine."""
    found: set[str] = set()
    waiting = list(names)
    while waiting:
        name = normal(waiting.pop())
        if name not in found:
            found.add(name)
            requirements = map(Requirement, importlib.metadata.distribution(name).requires or [])
            waiting += [one.name for one in requirements if one.marker is None or one.marker.evaluate({"extra": ""})]
    return found


def normal(name: str) -> str:
    """Return a distribution's name in the form in which two spellings of it are equal."""
    return re.sub(r"[-_.]+", "-", name).lower()


def packages() -> list[Package]:
    """Return all packages of eightpost[all]; every one must be installed."""
    always = closure(set(REQUIRED.values()))
    of_extra = {name: closure(set(extra.packages.values())) - always for name, extra in EXTRAS.items()}
    found = []
    for name in sorted(always.union(*of_extra.values())):
        distribution = importlib.metadata.distribution(name)
        stated, kind = licence(distribution)
        extras = tuple(extra for extra, names in of_extra.items() if name in names)
        found.append(Package(name, stated, kind, extras))
    return found


# ---- Which licence --------------------------------------------------------------------------------------------------


def licence(distribution: importlib.metadata.Distribution) -> tuple[str, str]:
    """Return the licence that a package states, and its kind.

    Raises:
        SystemExit: The package states no licence, or one that is not in FAMILIES.
    """
    for text in _statements(distribution):
        if any(re.search(words, text) for words, _, _ in FAMILIES):
            return _short(text), _kind(text)
    raise SystemExit(f"{distribution.name}: look at its licence and add it to FAMILIES: {_statements(distribution)!r}")


def _statements(distribution: importlib.metadata.Distribution) -> list[str]:
    """Return what a package states about its licence, the most precise statement first."""
    about = distribution.metadata
    classifiers = [one.rpartition(" :: ")[2] for one in about.get_all("Classifier") or [] if one.startswith("License")]
    paths = [path for path in distribution.files or () if re.match(r"(LICEN[CS]E|COPYING)", path.name)]
    files = [Path(str(path.locate())).read_text(encoding="utf-8", errors="replace") for path in paths]
    field = about.get("License") or ""
    return [text for text in (about.get("License-Expression") or "", ", ".join(classifiers), field, *files) if text]


def _short(text: str) -> str:
    """Return a statement of one line as it is, and the family of a whole licence text."""
    if len(text) < 80 and "\n" not in text and "Copyright" not in text:
        return text
    return next(family for words, family, _ in FAMILIES if re.search(words, text))


def _kind(text: str) -> str:
    """Return the kind of a statement; a choice (OR) has that of its first alternative that is permissive."""
    parts = text.split(" OR ") if len(text) < 80 else [text]
    kinds = [next((kind for words, _, kind in FAMILIES if re.search(words, part)), STRONG) for part in parts]
    return PERMISSIVE if PERMISSIVE in kinds else kinds[0]


# ---- The page -------------------------------------------------------------------------------------------------------


def page(found: list[Package], python: str) -> str:
    """Return the text of the page."""
    groups = {kind: [one for one in found if one.kind == kind] for kind in (PERMISSIVE, WEAK, STRONG)}
    counts = ", ".join(f"{len(group)} {kind}" for kind, group in groups.items())
    notes = [f"Of {len(found)} packages, the licences are: {counts}."]
    for one in groups[WEAK] + groups[STRONG]:
        notes.append(f"- {one.name} ({one.stated}): installed by {_extras(one)}.")
    if groups[WEAK]:
        notes.append(
            "\nA weak copyleft licence asks that changes of that package itself are published; it puts no condition on "
            "eightpost or on your FMUs, which contain none of these packages. Leave out an extra if your rules exclude "
            "its licence."
        )
    by_licence: dict[str, list[str]] = {}
    for one in found:
        by_licence.setdefault(one.stated, []).append(one.name)
    table = ["| licence as stated | packages |", "|---|---|"]
    table += [f"| {stated} | {', '.join(by_licence[stated])} |" for stated in sorted(by_licence, key=str.lower)]
    return INTRODUCTION.format(python=python) + "\n".join([*notes, "", *table]) + "\n"


def _extras(one: Package) -> str:
    return ", ".join(f"`eightpost[{extra}]`" for extra in one.extras) or "`eightpost`"


if __name__ == "__main__":
    import platform

    PAGE.write_text(page(packages(), ".".join(platform.python_version_tuple()[:2])), encoding="utf-8")
