"""Self-contained HTML pages: a template with style, script and the plotting library in one file."""

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
    """Return a package's page.html as a template. Values are escaped, and an undefined name is an error.

    The template may include the shared parts in the folder `page_parts` of this package.

    Raises:
        jinja2.TemplateNotFound: The package has no page.html.
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
    """Return a file of a package unchanged, for a style or a script element."""
    return Markup(files(package).joinpath(name).read_text(encoding="utf-8"))


@cache
def plotly() -> str:
    """Return the plotting library, compressed."""
    return compressed(get_plotlyjs().encode())


def compressed(content: bytes) -> str:
    """Return bytes compressed with gzip and encoded in base64, whose characters cannot end a script element."""
    return base64.b64encode(gzip.compress(content, compresslevel=9, mtime=0)).decode("ascii")
