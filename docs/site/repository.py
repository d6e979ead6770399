"""What the site needs of the repository: titles in place of file names, the list of notebooks, a page in its root."""

import os
import posixpath
import re
from pathlib import Path
from typing import Any

from docutils import nodes
from sphinx.application import Sphinx

_FRONT = """<!doctype html><meta charset="utf-8"><title>eightpost</title>
<meta http-equiv="refresh" content="0; url=docs/index.html"><a href="docs/index.html">eightpost</a>
"""

#: Page and mark that the list of notebooks replaces.
_LIST, _MARK = "docs/notebooks/index", "<!-- list of notebooks -->"


def _list_notebooks(app: Sphinx, name: str, source: list[str]) -> None:
    """Put the notebooks that are there into the page of notebooks."""
    if name != _LIST:
        return
    here = Path(app.srcdir, *_LIST.split("/")).parent
    found = sorted(doc for doc in app.env.found_docs if str(app.env.doc2path(doc)).endswith(".ipynb"))
    links = [Path(os.path.relpath(Path(app.srcdir, doc), here)).as_posix() for doc in found]
    tree = "\n".join(["```{toctree}", ":maxdepth: 1", "", *links, "```"]) if links else "No notebook is there yet."
    source[0] = source[0].replace(_MARK, tree)


def _title_links(app: Sphinx, doctree: nodes.document, name: str) -> None:
    """Replace the text of links that is the name of a page's file, which is useful in the repository only."""
    here = posixpath.dirname(app.builder.get_target_uri(name))
    titles = {app.builder.get_target_uri(doc): title.astext() for doc, title in app.env.titles.items()}
    for link in doctree.findall(nodes.reference):
        if re.fullmatch(r"[\w/]+\.md", link.astext()) and not link.get("refuri", ":").count(":"):
            target = posixpath.normpath(posixpath.join(here, link["refuri"].partition("#")[0]))
            if target in titles:
                link.clear()
                link.append(nodes.Text(titles[target]))


def _front_page(app: Sphinx, error: Exception | None) -> None:
    if error is None and app.builder.format == "html":
        (Path(app.outdir) / "index.html").write_text(_FRONT, encoding="utf-8")


def setup(app: Sphinx) -> dict[str, Any]:
    """Connect the list, the titles and the front page."""
    app.connect("source-read", _list_notebooks)
    app.connect("env-get-outdated", lambda *_: [_LIST])
    app.connect("doctree-resolved", _title_links)
    app.connect("build-finished", _front_page)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
