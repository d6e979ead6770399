"""HTML pages in one file that needs no network: style, scripts, data and the plotting library are part of it."""

from __future__ import annotations

import base64
import gzip
import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import cache
from html import unescape
from importlib.resources import files
from pathlib import Path
from typing import Any

from eightpost import __version__
from eightpost import cache as disk
from eightpost.extras import needs
from eightpost.files import write_text
from eightpost.report import numbers, tables
from eightpost.report.charts import Figure
from eightpost.report.numbers import Display
from eightpost.report.tables import ResultTable
from eightpost.units import shown_system
from eightpost.verdict import Verdict

# ---- Glossary: each page explains the words that it contains, and docs/reference/glossary.md all --------------------

#: Comment of glossary.txt after which words are too common to be explained on every page.
_COMMON = "# Common words"


@cache
def glossary(*, common: bool = False) -> dict[str, str]:
    """Return the definitions of glossary.txt by word, with common words or without; spellings have ` | ` between."""
    text = files("eightpost.report").joinpath("glossary.txt").read_text(encoding="utf-8")
    lines = (text if common else text.partition(_COMMON)[0]).splitlines()
    pairs = (line.partition(": ") for line in lines if line and not line.startswith("#"))
    return {word: text for word, _, text in sorted(pairs, key=lambda pair: pair[0].lower())}


def explained(html: str) -> dict[str, str]:
    """Return the definitions of the words that the text of a page contains, in alphabetical order."""
    text = unescape(re.sub(r"<style>.*?</style>|<[^>]*>", " ", html, flags=re.DOTALL))
    return {word.split(" | ")[0]: meaning for word, meaning in glossary().items() if _pattern(word).search(text)}


@cache
def _pattern(word: str) -> re.Pattern[str]:
    """Return a pattern of the spellings of a word; words of capitals and names must be written as they are."""
    spellings = "|".join(re.escape(one) for one in word.split(" | "))
    return re.compile(rf"\b(?:{spellings})s?\b", re.IGNORECASE if word[0].islower() else 0)


with needs("report", "writing pages"):
    import jinja2
    from markupsafe import Markup
    from plotly.offline import get_plotlyjs

# ---- The page shell -------------------------------------------------------------------------------------------------

_KIT = "eightpost.report"

#: Place of the glossary in shell.html.
_WORDS = "<!-- words -->"

_FILTERS = {
    "figure": numbers.figure,
    "fixed": numbers.fixed,
    "percent": numbers.percent,
    "listed": numbers.listed,
    "cell": tables.cell_html,
    "unit": tables.unit_html,
    "caption": tables.caption_html,
}


def page(package: str, scripts: Sequence[str], /, name: str = "page", **context: Any) -> str:
    """Return the HTML of a package's template, which extends the kit's shell.html. All values are escaped.

    Args:
        package: Package with the files of the page.
        scripts: Script files of the package in the order of their dependencies; they follow the kit's shell.js.
        name: Path of the template and of its style, which follows the kit's shell.css, without the suffix.
        context: Values of the template: at least `title`, `verdict`, `places` (identifier and heading of each section)
            and `data` (identifier and text of each script element with data). An undefined name is an error. `words`
            are definitions in addition to those of the glossary.
    """
    loaders = [jinja2.PackageLoader(package, "."), jinja2.PackageLoader(_KIT, "templates")]
    environment = jinja2.Environment(
        bytecode_cache=_Compiled(),
        loader=jinja2.ChoiceLoader(loaders),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= _FILTERS
    own = [_file(package, script) for script in scripts]
    html = environment.get_template(f"{name}.html").render(
        {
            "style": _file(_KIT, "templates/shell.css") + _file(package, f"{name}.css"),
            "script": Markup("\n").join([_file(_KIT, "templates/shell.js"), *own]),
            "plotly": _plotly(),
            "version": __version__,
            "is_metric": shown_system() == "si",
            "written": datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC"),
        }
        | context
    )
    words = explained(html.partition("<script")[0]) | context.get("words", {})
    return html.replace(_WORDS, environment.get_template("words.html").render(words=words), 1)


def write_page(path: str | Path, content: str) -> Path:
    """Write a page; an existing file is replaced only when the new one is complete. Return the path."""
    return write_text(path, content)


def compressed(content: bytes) -> str:
    """Return bytes compressed with gzip and encoded in base64, whose characters cannot end a script element."""
    return base64.b64encode(gzip.compress(content, compresslevel=9, mtime=0)).decode("ascii")


@cache
def _plotly() -> str:
    """Return the plotting library, compressed; that takes long, so it is kept in the cache."""
    content = get_plotlyjs().encode()
    key = disk.digest([content])
    kept = disk.recall("pages", key)
    if kept is None:
        kept = compressed(content).encode()
        disk.keep("pages", key, kept)
    return kept.decode()


class _Compiled(jinja2.BytecodeCache):
    """Templates as compiled code in the cache."""

    def load_bytecode(self, bucket: jinja2.bccache.Bucket) -> None:
        if (code := disk.recall("pages", bucket.key)) is not None:
            bucket.bytecode_from_string(code)

    def dump_bytecode(self, bucket: jinja2.bccache.Bucket) -> None:
        disk.keep("pages", bucket.key, bucket.bytecode_to_string())


def _file(package: str, name: str) -> Markup:
    """Return a file of a package unchanged, for a style or a script element."""
    return Markup(files(package).joinpath(name).read_text(encoding="utf-8"))


# ---- A printable document of texts, tables and figures --------------------------------------------------------------

#: Content of a section: a paragraph, HTML (Markup), a list of texts, a table, or a figure.
Block = str | tuple[str, ...] | ResultTable | Figure


@dataclass(frozen=True, slots=True)
class Section:
    """A section of a document."""

    name: str  #: Identifier of the section on the page.
    heading: str  #: Heading of the section, which is also its link at the top of the page.
    blocks: Sequence[Block]  #: Contents in their order.
    folded: bool = False  #: Whether a reader unfolds it first; it is not printed unless it is unfolded.


def document(
    title: str,
    verdict: Verdict,
    sections: Sequence[Section],
    *,
    lead: str = "",
    fold: int | None = None,
    links: Mapping[str, str] | None = None,
) -> str:
    """Return the HTML of a document; all texts are escaped, except for Markup.

    Args:
        title: Heading of the page.
        verdict: Verdict at its top.
        sections: Sections in their order.
        lead: Text below the verdict; default none.
        fold: Number of reasons after which the list is folded; default: it is never folded. A folded list is not
            printed, so that the sections must contain it.
        links: Names of other pages by their paths relative to this one.
    """
    figures = [block for section in sections for block in section.blocks if isinstance(block, Figure)]
    shown = {unit: Display.us(unit) for figure in figures for unit in sorted(figure.units)}
    content = {
        "figures": [figure.content() for figure in figures],
        "units": {unit: [scale.factor, scale.unit] for unit, scale in shown.items()},
    }
    return page(
        _KIT,
        ["templates/document.js"],
        name="templates/document",
        title=title,
        verdict=verdict,
        lead=lead,
        fold=fold,
        places=[(section.name, section.heading) for section in sections if section.blocks],
        links=links or {},
        sections=[section for section in sections if section.blocks],
        data={"figures": compressed(json.dumps(content, allow_nan=False, separators=(",", ":")).encode())},
    )


def soft(text: str) -> Markup:
    """Return a paragraph in a soft colour."""
    return Markup('<p class="soft">{}</p>').format(text)


def digest(*texts: str) -> Markup:
    """Return digests in small letters, one below the other."""
    return Markup("<br>").join(Markup('<span class="digest">{}</span>').format(text) for text in texts)
