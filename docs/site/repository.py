"""What the site needs of the repository: titles in place of file names, words to search for, a page in its root."""

import posixpath
import re
from pathlib import Path
from typing import Any

from docutils import nodes
from sphinx.application import Sphinx

_FRONT = """<!doctype html><meta charset="utf-8"><title>eightpost</title>
<meta http-equiv="refresh" content="0; url=docs/index.html"><a href="docs/index.html">eightpost</a>
"""


#: Words by which a reader looks for a page; the comment is invisible in the repository.
_SEARCH = re.compile(r"^<!-- search: (.+) -->$", re.MULTILINE)


def _search_words(_: Sphinx, __: str, source: list[str]) -> None:
    """Replace the comment with the search words of a page by main entries of the index, which a search lists first."""
    source[0] = _SEARCH.sub(lambda found: f"```{{index}} !{found[1].replace(', ', ', !')}\n```", source[0])


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
    """Connect the search words, the titles and the front page."""
    app.connect("source-read", _search_words)
    app.connect("doctree-resolved", _title_links)
    app.connect("build-finished", _front_page)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
