"""Pages of one file: a template with its style and script beside it, the plotting library packed in."""

from __future__ import annotations

import base64
import gzip
from collections.abc import Callable, Mapping
from functools import cache
from importlib.resources import files
from typing import Any

import jinja2
from markupsafe import Markup
from plotly.offline import get_plotlyjs


def template(package: str, filters: Mapping[str, Callable[..., Any]]) -> jinja2.Template:
    """Return a package's page.html: what is filled in is escaped, and a name that is missing is an error.

    It may include what all pages share: `page_parts/` beside this file.

    Raises:
        jinja2.TemplateNotFound: The package has none.
    """
    environment = jinja2.Environment(
        loader=jinja2.ChoiceLoader([jinja2.PackageLoader(package, "."), jinja2.PackageLoader("eightpost", ".")]),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= filters
    return environment.get_template("page.html")


def insert(package: str, name: str) -> Markup:
    """Return a file of a package as it is, for a style or a script element."""
    return Markup(files(package).joinpath(name).read_text(encoding="utf-8"))


@cache
def plotly() -> str:
    """Return the plotting library, compressed."""
    return compressed(get_plotlyjs().encode())


def compressed(content: bytes) -> str:
    """Return bytes compressed (gzip) in base 64: letters that cannot end a script element."""
    return base64.b64encode(gzip.compress(content, compresslevel=9, mtime=0)).decode("ascii")
