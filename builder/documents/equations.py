"""Conversion of an FMU's text and equations from Markdown with LaTeX to HTML with MathML, which browsers can display.

The equations use GitHub's notation: `$...$` within a line, a fenced block with the info string `math` otherwise.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any

from builder.fmu.interface import source_folder
from eightpost.extras import needs

with needs("build", "building FMUs"):
    from latex2mathml.converter import convert
    from markdown_it import MarkdownIt
    from markdown_it.renderer import RendererHTML
    from markdown_it.rules_inline import StateInline
    from markdown_it.token import Token

#: Links between the texts are replaced by anchors, because all texts are on one page.
_PLACES = {"../common/shock.md": "#the-port"}

_TITLE = re.compile(r"\A# .*\n+")


def equations(kind: str) -> str:
    """Return the text of an interface kind as HTML: purpose, equations, signs, limits; without its title.

    The text of a shock is followed by the text that all shocks share: the port and the curve.
    """
    folder = source_folder()
    texts = [_TITLE.sub("", (folder / kind / "README.md").read_text(encoding="utf-8"))]
    if kind.startswith("shock_"):
        texts.append((folder / "common" / "shock.md").read_text(encoding="utf-8"))
    return render("\n".join(texts))


def render(text: str) -> str:
    """Return Markdown as HTML."""
    markdown = MarkdownIt("commonmark").enable("table")
    markdown.inline.ruler.before("escape", "math", _parse_math)
    markdown.add_render_rule("math", _math)
    markdown.add_render_rule("fence", _fence)
    markdown.add_render_rule("heading_open", _heading)
    markdown.add_render_rule("link_open", _link)
    return str(markdown.render(text))


def mathml(latex: str, *, display: str) -> str:
    """Return LaTeX mathematics as MathML; `display` is `inline` or `block`."""
    # HTML does not need the namespace, and without it the page contains no URL at all.
    return convert(latex, display=display).replace(' xmlns="http://www.w3.org/1998/Math/MathML"', "")


def _parse_math(state: StateInline, silent: bool) -> bool:
    if state.src[state.pos] != "$":
        return False
    end = state.src.find("$", state.pos + 1)
    if end < 0:
        return False
    if not silent:
        state.push("math", "math", 0).content = state.src[state.pos + 1 : end]
    state.pos = end + 1
    return True


def _math(_: RendererHTML, tokens: Sequence[Token], index: int, *__: Any) -> str:
    return mathml(" ".join(tokens[index].content.split()), display="inline")


def _fence(self: RendererHTML, tokens: Sequence[Token], index: int, options: Any, env: Any) -> str:
    if tokens[index].info.strip() != "math":
        return str(self.fence(tokens, index, options, env))
    return f'<div class="equation">{mathml(tokens[index].content.strip(), display="block")}</div>\n'


def _heading(_: RendererHTML, tokens: Sequence[Token], index: int, *__: Any) -> str:
    name = re.sub(r"\W+", "-", tokens[index + 1].content.lower()).strip("-")
    return f'<{tokens[index].tag} id="{name}">'


def _link(self: RendererHTML, tokens: Sequence[Token], index: int, options: Any, env: Any) -> str:
    target = str(tokens[index].attrGet("href"))
    tokens[index].attrSet("href", _PLACES.get(target, target))
    return str(self.renderToken(tokens, index, options, env))
