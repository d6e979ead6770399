"""The gallery: scripts of docs/make/gallery run when the site is built, and are shown with their pictures.

A script begins with a docstring, its title in the first line and its text after an empty line, and leaves a `figure`.
It runs in the folder of the repository.
"""

import ast
import os
import runpy
from pathlib import Path
from typing import Any

from sphinx.application import Sphinx

_PAGE, _MARK = "docs/gallery", "<!-- pictures -->"
#: Folder of the pictures in the repository; it is not under version control.
PICTURES = "out/gallery"


def scripts(root: Path) -> list[Path]:
    """Return the scripts of the gallery."""
    return sorted((root / "docs" / "make" / "gallery").glob("*.py"))


def draw(script: Path, root: Path) -> Path:
    """Run a script and save its figure; return the picture."""
    picture = root / PICTURES / f"{script.stem}.png"
    picture.parent.mkdir(parents=True, exist_ok=True)
    before = Path.cwd()
    os.chdir(root)
    try:
        runpy.run_path(str(script))["figure"].savefig(picture, dpi=110)
    finally:
        os.chdir(before)
    return picture


def section(script: Path) -> str:
    """Return the part of the page that shows a script: title, text, picture, code."""
    source = script.read_text(encoding="utf-8")
    tree = ast.parse(source)
    title, _, text = (ast.get_docstring(tree) or "").partition("\n\n")
    code = "\n".join(source.splitlines()[tree.body[1].lineno - 1 :])
    lines = [f"## {title}", "", text, "", f"![{title}](../{PICTURES}/{script.stem}.png)", ""]
    return "\n".join([*lines, ":::{dropdown} Code", "```python", code, "```", ":::", ""])


def _fill(app: Sphinx, name: str, source: list[str]) -> None:
    if name == _PAGE:
        root = Path(app.srcdir)
        for script in scripts(root):
            draw(script, root)
        source[0] = source[0].replace(_MARK, "\n".join(map(section, scripts(root))))


def _always(*_: Any) -> list[str]:
    return [_PAGE]


def setup(app: Sphinx) -> dict[str, Any]:
    """Fill the page of the gallery with its scripts."""
    app.connect("source-read", _fill)
    app.connect("env-get-outdated", _always)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
