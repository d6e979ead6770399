"""Sign convention that a dynamometer file states: which channels are positive in extension."""

from __future__ import annotations

import re
from collections.abc import Iterable

_INWARD, _OUTWARD = "compression|bump|jounce|bound|inward|push", "extension|rebound|droop|tension|outward|pull"
_POSITIVE = r"(?:is\s+|are\s+|=\s*|:\s*)?(?:positive|pos\b|\+\s*ve\b|\+(?!\s*[\d.]))"
_CHANNELS = {
    "force": r"force|load",
    "displacement": r"displacement|position|travel|stroke|motion",
    "velocity": r"velocity|speed|motion",
}
_WORDS = "|".join(_CHANNELS.values())
#: A stroke, perhaps a channel, and `positive`; or `positive` and a stroke.
_STATED = re.compile(
    rf"(?P<before>(?:{_WORDS})\s*(?:is\s+|are\s+|[:=(,]\s*)*)?(?:"
    rf"(?<!\w)(?P<one>{_INWARD}|{_OUTWARD})\s*(?P<behind>{_WORDS})?\s*{_POSITIVE}"
    rf"|(?:positive|\+\s*ve|\+\s*=)\s*(?:is\s+|in\s+|for\s+|=\s*|:\s*)*(?P<other>{_INWARD}|{_OUTWARD})(?!\w))",
    re.IGNORECASE,
)


def stated_convention(lines: Iterable[str], channels: Iterable[str]) -> tuple[str, tuple[str, ...]]:
    """Return the statements on signs in the lines of a preamble, and the channels that are positive in extension.

    `Extension positive` is about all channels, `force positive in rebound` about one.

    Args:
        lines: Lines of the preamble.
        channels: Names of the channels whose signs may be stated.
    """
    found: list[str] = []
    outward: dict[str, bool] = {}
    for match in (match for line in lines for match in _STATED.finditer(line)):
        named = (match["before"] or "") + (match["behind"] or "")
        about = [name for name, words in _CHANNELS.items() if re.search(words, named, re.IGNORECASE)]
        stroke = match["one"] or match["other"]
        found.append(match[0].strip(" :,(="))
        is_outward = re.fullmatch(_OUTWARD, stroke, re.IGNORECASE) is not None
        outward |= dict.fromkeys(about or set(_CHANNELS) - set(outward), is_outward)
    return ", ".join(found), tuple(name for name in channels if outward.get(name))
