"""The places in a C source that can be changed: operators, signs, bounds and constants.

The search relies on the format of fmus/: a binary operator has a space on both sides, a sign or a pointer's star has no
space after it.
"""

from __future__ import annotations

import re
from functools import partial

from benchmarks.mutants.site import Site

_NO_CODE = re.compile(r'/\*.*?\*/|//[^\n]*|"(?:\\.|[^"\\\n])*"|^[ \t]*#(?:\\\n|[^\n])*', re.DOTALL | re.MULTILINE)
_NUMBER = re.compile(r"(?<![\w.])(?:0x[0-9a-fA-F.]+(?:p[+-]?\d+)?|\d+(?:\.\d*)?(?:[eE][+-]?\d+)?)(?![\w.])")
_SIGN = re.compile(r"(?<![-\w)\]])-(?=[\w(.])|!(?=[\w(])")
_OPERATOR = re.compile(r"(?<=\s)(?:[-+*/]|[-+*/]=|[<>]=?|[=!]=|&&|\|\|)(?=\s)")
_OTHERS = {
    "+": "-*", "-": "+*", "*": "/+", "/": "*-",
    "+=": ("-=",), "-=": ("+=",), "*=": ("/=",), "/=": ("*=",),
    "<": ("<=", ">="), "<=": ("<", ">"), ">": (">=", "<="), ">=": (">", "<"), "==": ("!=",), "!=": ("==",),
    "&&": ("||",), "||": ("&&",),
}  # fmt: skip


def c_sites(source: str) -> list[Site]:
    """Return the places of a C source, in the order of the text."""
    code = _NO_CODE.sub(lambda found: re.sub(r"[^\n]", " ", found[0]), source)
    sites = [_site(source, found, ("",)) for found in _SIGN.finditer(code)]
    sites += [_site(source, found, _OTHERS[found[0]]) for found in _OPERATOR.finditer(code)]
    sites += [_site(source, found, _neighbours(found[0])) for found in _NUMBER.finditer(code)]
    return sorted(sites, key=lambda site: site[:2])


def _site(source: str, found: re.Match[str], others: str | tuple[str, ...]) -> Site:
    before = source[: found.start()]
    changes = tuple(partial(_changed, found.span(), other) for other in others)
    return Site(before.count("\n") + 1, len(before) - before.rfind("\n") - 1, changes)


def _neighbours(number: str) -> tuple[str, ...]:
    """Return the number plus one and minus one, like cosmic-ray does for Python."""
    if number.isdigit():
        return str(int(number) + 1), str(int(number) - 1)
    value = float.fromhex(number) if number.startswith("0x") else float(number)
    return repr(value + 1.0), repr(value - 1.0)


def _changed(span: tuple[int, int], other: str, source: str) -> str:
    return source[: span[0]] + other + source[span[1] :]
