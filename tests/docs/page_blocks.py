"""Code blocks of all pages, and what each is: run by a test, an equation, an output, or not run for a stated reason.

A comment on the line before a block states what is not the default:

    <!-- not run: needs MATLAB -->
    <!-- run by tests/hosts/test_host_programs.py -->

`<!-- all blocks: ... -->` states the same for all blocks of a page. Without a comment, tests/docs/test_pages_run.py
runs the blocks of a page one after the other.
"""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from markdown_it import MarkdownIt

ROOT = Path(__file__).resolve().parents[2]

#: Languages whose blocks are run by default, and those of files, which the commands of the same page read.
RUN = ("sh", "python")
FILES = ("toml", "json", "xml")
#: Languages of blocks that nobody can run: outputs, layouts, equations.
SHOWN = {"text": "output", "math": "equation"}

_NOTE = re.compile(r"^<!-- (not run: .+|run by .+) -->$")
#: Parser of the blocks alone: the text within them is not read.
_PARSER = MarkdownIt("commonmark").enable("table")
_PARSER.core.ruler.enableOnly(["normalize", "block"])

_FOR_ALL = re.compile(r"^<!-- all blocks: (not run: .+|run by .+) -->$", re.MULTILINE)


@dataclass(frozen=True)
class Block:
    """A fenced block of a page."""

    page: str  #: Path of the page from the root of the repository.
    line: int  #: Line of its first fence.
    language: str  #: First word of its info string.
    text: str  #: Content.
    note: str  #: Comment before the block, or that for all blocks of the page; empty without one.

    @property
    def kind(self) -> str:
        """Name of what the block is: run, run elsewhere, not run, file, output, equation or unknown."""
        if self.language in SHOWN:
            return SHOWN[self.language]
        if self.note.startswith("not run: "):
            return "not run"
        if self.note.startswith("run by "):
            return "run elsewhere"
        if self.language in RUN:
            return "run"
        return "file" if self.language in FILES else "unknown"

    @property
    def place(self) -> str:
        """Page and line, as error messages show them."""
        return f"{self.page}:{self.line}"


def pages() -> list[Path]:
    """Return all pages of the documentation."""
    found = [ROOT / name for name in ("README.md", "CONTRIBUTING.md")]
    return [*found, *sorted((ROOT / "docs").rglob("*.md")), *sorted((ROOT / "fmus").rglob("*.md"))]


@cache
def blocks(page: Path) -> tuple[Block, ...]:
    """Return the blocks of a page in order; directives of the site (```{...}) are left out."""
    text = page.read_text(encoding="utf-8")
    lines = text.split("\n")
    for_all = _FOR_ALL.search(text)
    found = []
    for token in _PARSER.parse(text):
        if token.type not in ("fence", "code_block") or token.info.startswith("{") or token.markup.startswith(":"):
            continue
        first = token.map[0]
        note = _NOTE.match(lines[first - 1].strip()) if first else None
        found.append(
            Block(
                page=page.relative_to(ROOT).as_posix(),
                line=first + 1,
                language=(token.info.split() or [""])[0] if token.type == "fence" else "indented",
                text=token.content,
                note=note[1] if note else for_all[1] if for_all else "",
            )
        )
    return tuple(found)


def all_blocks() -> list[Block]:
    """Return the blocks of all pages."""
    return [block for page in pages() for block in blocks(page)]


def commands(block: Block) -> Iterator[list[str]]:
    """Yield the words of each command of an sh block, without comments, variables and redirection."""
    for line in block.text.replace("\\\n", " ").splitlines():
        words = shlex.split(line, comments=True)
        while words and re.match(r"\w+=", words[0]):
            words.pop(0)
        if ">" in words:
            words = words[: words.index(">")]
        if words:
            yield words
