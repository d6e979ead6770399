"""Glossary: each page explains the words that it contains, and docs/reference/glossary.md all."""

from __future__ import annotations

import re
from functools import cache
from html import unescape
from importlib.resources import files

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
