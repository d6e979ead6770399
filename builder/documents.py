"""What an archive carries for people: documentation/index.html and the licence."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from html import escape
from typing import Any

from builder.interface import Interface, Variable
from builder.sources import source_folder

_PAGE = """<!DOCTYPE html>
<html lang="en"><head><meta charset="utf-8"><title>{title}</title>
<style>body{{font:15px/1.5 sans-serif;max-width:70em;margin:2em auto;padding:0 1em}}
table{{border-collapse:collapse}}td,th{{border-bottom:1px solid #ccc;padding:.2em .8em;text-align:left}}
pre{{white-space:pre-wrap}}</style></head><body>
<h1>{title}</h1><p>{text}.</p>
<h2>Model, limits and signs</h2><pre>{readme}</pre>
<h2>Conditions of the measurement</h2><pre>{conditions}</pre>
<h2>Variables</h2><table><tr><th>name</th><th>causality</th><th>unit</th><th>display</th><th>start</th><th>meaning</th></tr>
{rows}</table></body></html>
"""


def documents(identifier: str, text: str, interface: Interface, conditions: Mapping[str, Any]) -> dict[str, bytes]:
    """Return the archive's documentation: member name -> content."""
    folder = source_folder()
    page = _PAGE.format(
        title=escape(identifier),
        text=escape(text),
        readme=escape((folder / interface.kind / "README.md").read_text(encoding="utf-8")),
        conditions=escape(json.dumps(dict(conditions), indent=1) if conditions else "None stated."),
        rows="\n".join(_rows(interface.variables)),
    )
    return {
        "documentation/index.html": page.encode(),
        "documentation/licenses/license.txt": (folder / "LICENSE.txt").read_bytes(),
    }


def _rows(variables: Iterable[Variable]) -> Iterable[str]:
    for v in variables:
        cells = (
            v.name,
            v.causality,
            v.unit or "",
            v.display or "",
            "" if v.start is None else v.start,
            v.description,
        )
        yield "<tr>" + "".join(f"<td>{escape(str(cell))}</td>" for cell in cells) + "</tr>"
