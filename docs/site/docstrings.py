"""Docstrings are plain text with Markdown's backticks; this turns them into what Sphinx reads."""

import re
from typing import Any

from sphinx.application import Sphinx

#: Text between backticks is code; in all other text, these characters stand for themselves.
_CODE = re.compile(r"(`+)(.+?)\1")
_SPECIAL = re.compile(r"([*|\\]|_(?=\W|$))")
#: Priorities of handlers before and after that of napoleon.
_BEFORE, _AFTER = 400, 600


def escaped(line: str) -> str:
    """Return a line whose code is marked for Sphinx and whose other characters stand for themselves."""
    parts, place = [], 0
    for match in _CODE.finditer(line):
        parts += [_SPECIAL.sub(r"\\\1", line[place : match.start()]), f"``{match[2]}``"]
        # Sphinx wants a character that ends the code.
        if match.end() < len(line) and (line[match.end()].isalnum() or line[match.end()] == "_"):
            parts.append("\\")
        place = match.end()
    return "".join([*parts, _SPECIAL.sub(r"\\\1", line[place:])])


_SECTION = re.compile(r"(Args|Returns|Raises|Yields|Attributes|Example|Examples|Note):$")


def converted(lines: list[str]) -> list[str]:
    """Return the lines of a docstring; an indented block outside the sections of arguments is shown as it is."""
    found: list[str] = []
    in_section, in_block = False, False
    for line in lines:
        indented = line.startswith("    ")
        if line and not indented:
            in_section, in_block = bool(_SECTION.match(line)), False
        if in_section or not indented:
            found.append(escaped(line))
            continue
        if not in_block:
            in_block = True
            found += [*([""] if found and found[-1] else []), "::", ""]
        found.append(line)
    return found


#: Stands for a colon of a property's text, which the conversion of Google's sections would take for a type.
_COLON = "\ue000"


#: Module that its page introduces; the docstring is for readers of the source.
_INTRODUCED = "eightpost"


def _process(_: Sphinx, what: str, name: str, *rest: Any) -> None:
    lines: list[str] = rest[-1]
    lines[:] = converted(lines) if name != _INTRODUCED else []
    if what in ("property", "attribute"):
        lines[:1] = [line.replace(": ", f"{_COLON} ") for line in lines[:1]]


def _restore(*arguments: Any) -> None:
    lines: list[str] = arguments[-1]
    lines[:] = [line.replace(_COLON, ":") for line in lines]


def setup(app: Sphinx) -> dict[str, Any]:
    """Connect the conversion before that of Google's sections."""
    app.connect("autodoc-process-docstring", _process, priority=_BEFORE)
    app.connect("autodoc-process-docstring", _restore, priority=_AFTER)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
