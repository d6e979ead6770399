"""Shapes for the drawing of a system, as SVG elements; colours are classes of page.css."""

from __future__ import annotations

from xml.etree import ElementTree

#: Width of a letter of the drawing's monospaced text [px].
LETTER = 7.3

#: Maximum length of a name that is written in full; a longer one shows its ends, and the whole name as a tooltip.
_LONGEST = 30


#: Minimum scale of a drawing on the page, at which its letters remain readable.
_LEAST_SCALE = 0.8


class Drawing:
    """SVG element under construction; lengths in pixels, y downwards."""

    def __init__(self) -> None:
        self._root = ElementTree.Element("svg", {"role": "img", "class": "graph"})
        self._right = self._bottom = 0.0

    def rectangle(self, x: float, y: float, width: float, height: float, *, style: str) -> None:
        """Draw a rectangle with rounded corners."""
        self._reach(x + width, y + height)
        sizes = {"x": x, "y": y, "width": width, "height": height, "rx": 6}
        self._add("rect", style, {name: f"{value:.1f}" for name, value in sizes.items()})

    def text(self, x: float, y: float, content: str, *, style: str, anchor: str = "start") -> None:
        """Write a text; `y` is its middle, `anchor` is the part of it at `x`: start, middle or end."""
        element = self._add("text", style, {"x": f"{x:.1f}", "y": f"{y:.1f}", "text-anchor": anchor, "dy": "0.35em"})
        element.text = shortened(content)
        if element.text != content:
            ElementTree.SubElement(element, "title").text = content
        share = {"start": 1.0, "middle": 0.5, "end": 0.0}[anchor]
        self._reach(x + share * width(content), y + 10.0)

    def arrow(self, start: tuple[float, float], end: tuple[float, float], *, style: str) -> None:
        """Draw a horizontal arrow."""
        sign = 1.0 if end[0] > start[0] else -1.0
        self._add("path", f"line {style}", {"d": f"M{start[0]:.1f} {start[1]:.1f}H{end[0] - 6.0 * sign:.1f}"})
        self._head(end, sign, style)

    def arc(self, start: tuple[float, float], end: tuple[float, float], bulge: float, *, style: str) -> None:
        """Draw an arrow that leaves to the right and returns from the right."""
        (x, above), (_, below), far = start, end, start[0] + bulge
        curve = f"M{x:.1f} {above:.1f}C{far:.1f} {above:.1f} {far:.1f} {below:.1f} {x + 6.0:.1f} {below:.1f}"
        self._add("path", f"line {style}", {"d": curve})
        self._head(end, -1.0, style)
        self._reach(far, max(above, below))

    def badge(self, tip: tuple[float, float], side: float, content: str, *, style: str) -> None:
        """Write a sign or a factor in a badge next to the tip of an arrow: right of it for side 1, left for -1."""
        half = max(7.5, 0.5 * LETTER * len(content) + 4.0)
        x, y = tip[0] + side * (half + 13.0), tip[1]
        self.rectangle(x - half, y - 7.5, 2.0 * half, 15.0, style=f"badge {style}")
        self.text(x, y, content, style=f"sign {style}", anchor="middle")

    def finished(self, label: str, margin: float) -> str:
        """Return the SVG as text; `label` describes it for screen readers."""
        size = (self._right + margin, self._bottom + margin)
        self._root.set("aria-label", label)
        self._root.set("viewBox", f"0 0 {size[0]:.0f} {size[1]:.0f}")
        self._root.set("width", f"{size[0]:.0f}")
        self._root.set("height", f"{size[1]:.0f}")
        self._root.set("style", f"min-width: {_LEAST_SCALE * size[0]:.0f}px")
        return ElementTree.tostring(self._root, encoding="unicode")

    def _head(self, tip: tuple[float, float], sign: float, style: str) -> None:
        x, y = tip
        back = x - 9.0 * sign
        points = f"{x:.1f},{y:.1f} {back:.1f},{y - 4.5:.1f} {back:.1f},{y + 4.5:.1f}"
        self._add("polygon", f"head {style}", {"points": points})

    def _add(self, tag: str, style: str, attributes: dict[str, str]) -> ElementTree.Element:
        return ElementTree.SubElement(self._root, tag, {"class": style, **attributes})

    def _reach(self, right: float, bottom: float) -> None:
        self._right, self._bottom = max(self._right, right), max(self._bottom, bottom)


def shortened(content: str) -> str:
    """Return a text with its middle omitted if it is too long for a drawing."""
    half = (_LONGEST - 1) // 2
    return content if len(content) <= _LONGEST else f"{content[:half]}…{content[-half:]}"


def width(content: str) -> float:
    """Return the width of a text in the drawing [px]."""
    return LETTER * len(shortened(content))
