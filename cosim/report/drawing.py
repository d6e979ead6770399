"""Drawing of a system, as SVG."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from xml.etree import ElementTree

from cosim.components.component import named_unit
from cosim.session.setup import connected
from cosim.systems.coupling import Scenario, targets_of
from cosim.systems.system import Connection, System
from eightpost.errors import UnknownUnitError

# ---- Connections of a system for a drawing --------------------------------------------------------------------------

#: Kinds of arrows from outside, used in place of a component's name.
DRIVE, CONSTANT = "drive", "constant"


@dataclass(frozen=True, slots=True)
class End:
    """One end of an arrow: a component (empty for outside) and the text there."""

    component: str
    text: str


@dataclass(frozen=True, slots=True)
class Arrow:
    """One connection."""

    source: End  #: Start of the arrow.
    target: End  #: End of the arrow.
    unit: str  #: Unit of the source; both units if the target has another one.
    gain: float  #: Gain of the connection; its sign is drawn.
    kind: str  #: velocity, displacement or force of a bond, drive, constant, or connection.
    bond: str = ""  #: Name of its bond; empty without one.
    summed: bool = False  #: Whether its target adds up several sources.

    def joins(self, component: str) -> bool:
        """Return whether it starts or ends at a component."""
        return component in (self.source.component, self.target.component)


def arrows(system: System, scenario: Scenario) -> tuple[Arrow, ...]:
    """Return all connections: those of bonds, the others, the drive's channels, the constants."""
    found = list[Arrow]()
    for bond in system.bonds:
        ways = {"velocity": bond.velocity, "displacement": bond.displacement, "force": bond.force}
        found += [_of_connection(system, c, kind, bond.name) for kind, c in ways.items() if c is not None]
    found += [_of_connection(system, c, "connection", "") for c in system.connections]
    outside = [(DRIVE, *one) for one in _driven(system, scenario)]
    for name, value in system.constants.items():
        unit = system.input(name).unit
        outside.append((CONSTANT, name, f"{value:g}", unit.name if unit else ""))
    found += [Arrow(End("", text), _end(name), unit, 1.0, kind, "", name in system.sums)
              for kind, name, text, unit in outside]  # fmt: skip
    return tuple(found)


def middle(names: Iterable[str], joined: Iterable[Arrow]) -> str:
    """Return the component that is connected with the most others; the first one in case of a tie."""
    others = {name: set(near) - {name} for name, near in _neighbours_of(names, joined).items()}
    return max(others, key=lambda name: len(others[name]), default="")


def _neighbours_of(names: Iterable[str], joined: Iterable[Arrow]) -> dict[str, list[str]]:
    """Return, for each component, the components that it is connected with, once per connection."""
    neighbours: dict[str, list[str]] = {name: [] for name in names}
    for arrow in joined:
        ends = (arrow.source.component, arrow.target.component)
        if all(ends):
            neighbours[ends[0]].append(ends[1])
            neighbours[ends[1]].append(ends[0])
    return neighbours


def order(names: Iterable[str], joined: Iterable[Arrow], center: str) -> tuple[str, ...]:
    """Return the components except the middle one: in the given order, each followed by those connected through it."""
    neighbours = _neighbours_of(names, joined)
    near = set(neighbours.get(center, ()))
    placed: dict[str, None] = {center: None}
    for name in (*neighbours.get(center, ()), *neighbours):
        waiting = [name]
        while waiting:
            component = waiting.pop()
            if component not in placed:
                placed[component] = None
                waiting += reversed([n for n in neighbours[component] if n not in near])
    return tuple(placed)[1:]


def _of_connection(system: System, connection: Connection, kind: str, bond: str) -> Arrow:
    source, target = system.output(connection.source).unit, system.input(connection.target).unit
    unit = " → ".join(dict.fromkeys(unit.name for unit in (source, target) if unit is not None))
    is_summed = connection.target in system.sums
    return Arrow(_end(connection.source), _end(connection.target), unit, connection.gain, kind, bond, is_summed)


def _end(name: str) -> End:
    component, _, variable = name.partition(".")
    return End(component, variable)


def _driven(system: System, scenario: Scenario) -> Iterator[tuple[str, str, str]]:
    """Yield driven inputs with the channel of the drive, and its unit or both units if the input has another one."""
    if scenario.drive is None:
        return
    for target, index in targets_of(system, scenario).items():
        unit, own = scenario.drive.units[index], system.input(target).unit
        with suppress(UnknownUnitError):
            own = None if own is not None and named_unit(unit) == named_unit(own.name) else own
        yield target, scenario.drive.names[index], unit if own is None else f"{unit} → {own.name}"


# ---- Unconnected parts of a system; parts that are alike share one drawing ------------------------------------------

#: Properties that two parts must have in common to be alike.
_Likeness = tuple[tuple[str, ...], tuple[tuple[object, ...], ...]]


@dataclass(frozen=True, slots=True)
class Group:
    """Group of components that are connected with each other."""

    components: tuple[str, ...]  #: Names of the components, in the order of the system.
    arrows: tuple[Arrow, ...]  #: Connections, drive and constants of the components.
    alike: tuple[tuple[str, ...], ...] = ()  #: Components of every other group with the same files and connections.


def groups(names: Sequence[str], joined: Sequence[Arrow], sources: Mapping[str, str]) -> tuple[Group, ...]:
    """Sort components and their connections into groups, and merge groups that are alike."""
    distinct: dict[_Likeness, Group] = {}
    for components in connected(names, _neighbours_of(names, joined)):
        group = Group(tuple(components), tuple(a for a in joined if a.target.component in components))
        likeness = _likeness(group, sources)
        first = distinct.setdefault(likeness, group)
        if first is not group:
            distinct[likeness] = replace(first, alike=(*first.alike, group.components))
    return tuple(distinct.values())


def _likeness(group: Group, sources: Mapping[str, str]) -> _Likeness:
    """Return files and connections without the names of components, bonds and drive channels."""
    numbers = {name: k for k, name in enumerate(group.components)} | {"": -1}
    return (
        tuple(sources.get(name, "") for name in group.components),
        tuple(
            (
                numbers[a.source.component],
                "" if a.kind == DRIVE else a.source.text,
                numbers[a.target.component],
                a.target.text,
                *(a.unit, a.gain, a.kind, bool(a.bond), a.summed),
            )
            for a in group.arrows
        ),
    )


# ---- Shapes for the drawing of a system, as SVG elements; colours are classes of page.css ---------------------------

#: Width of a letter of the drawing's monospaced text [px].
LETTER = 7.3

#: Maximum length of a name that is written in full; a longer one shows its ends, and the whole name as a tooltip.
_LONGEST = 30


#: Minimum scale of a drawing on the page, at which its letters remain readable.
_LEAST_SCALE = 0.8


class _Drawing:
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
        half = 0.5 * LETTER * len(content) + 4.0
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


# ---- Drawing of the system (SVG) ------------------------------------------------------------------------------------

#: Lengths in pixels: lane of one arrow, heading of a box, vertical and horizontal distance of boxes, margin.
_LANE, _HEADING, _SPACE, _GAP, _EDGE = 24.0, 46.0, 18.0, 150.0, 12.0

#: Width of letters in a heading relative to those of the ports.
_TITLE = 1.08

#: Width of the first arc between two components on the right, and increment for each further one [px].
_ARC, _ARC_STEP = 70.0, 16.0

#: Maximum number of components drawn next to the middle one.
_SHOWN = 24

#: Label for the component in the middle if it feeds itself.
_ITSELF = "its own outputs"


@dataclass(frozen=True, slots=True)
class _Box:
    """Rectangle with a heading."""

    name: str
    x: float
    y: float
    width: float
    height: float

    @property
    def right(self) -> float:
        return self.x + self.width

    def lane(self, index: int) -> float:
        """Return the height of the middle of a lane, counted from the heading."""
        return self.y + _HEADING + _LANE * (index + 0.5)


def graph(group: Group, sources: Mapping[str, str]) -> str:
    """Draw components that are connected."""
    center = middle(group.components, group.arrows)
    others = order(group.components, group.arrows, center)
    shown = {"", center, *others[:_SHOWN]}
    joined = [a for a in group.arrows if a.source.component in shown and a.target.component in shown]
    return _Sheet(joined, center, others[:_SHOWN], sources).drawn(hidden=len(others[_SHOWN:]))


class _Sheet:
    """Layout of a drawing, from left to right."""

    def __init__(self, joined: Sequence[Arrow], center: str, others: Sequence[str], sources: Mapping[str, str]) -> None:
        self._sources = sources
        self._others = others
        self._inner = {name: [a for a in joined if a.joins(center) and a.joins(name)] for name in others}
        self._outer = {name: _outer(joined, name, center) for name in others}
        self._feeding = [a for a in joined if a.target.component == center and a.source.component in ("", center)]
        self._arcs = [a for a in joined if a.source.component and not a.joins(center)]
        self._gap = max([_GAP, *(width(a.unit) + 100.0 for a in joined), *(width(a.bond) + 24.0 for a in joined)])
        self._left = _left_boxes(self._feeding)
        self._center = self._center_box(center)
        self._right = dict(self._right_boxes())
        self._drawing = _Drawing()

    def drawn(self, *, hidden: int) -> str:
        """Return the drawing; `hidden` is the number of components that it omits."""
        for name, box in self._right.items():
            self._bonds(name, box)
        boxes = [(box, "outside") for box, _ in self._left.values()] + [(self._center, "center")]
        for box, style in (*boxes, *((box, "component") for box in self._right.values())):
            self._drawing.rectangle(box.x, box.y, box.width, box.height, style=f"box {style}")
            self._drawing.text(box.x + 12.0, box.y + 15.0, box.name, style="title")
            self._drawing.text(box.x + 12.0, box.y + 31.0, self._sources.get(box.name, ""), style="below")
        for name, (box, feeding) in self._left.items():
            for k, arrow in enumerate(feeding):
                self._flow(arrow, (box, self._center), box.lane(k), note=name)
        for name, box in self._right.items():
            for k, arrow in _numbered(self._inner[name]):
                self._flow(arrow, (self._center, box), box.lane(k))
            self._stubs(name, box)
        for k, arrow in enumerate(self._arcs):
            start, end = self._outer_end(arrow, "out"), self._outer_end(arrow, "in")
            bulge = _ARC + _ARC_STEP * (k % 8)
            self._drawing.arc(start, end, bulge, style=arrow.kind)
            self._sign(arrow, end, 1.0)
            self._drawing.text(start[0] + 0.75 * bulge + 4.0, 0.5 * (start[1] + end[1]), arrow.unit, style="unit")
        if hidden:
            bottom = max(box.y + box.height for box in (self._center, *self._right.values()))
            content = f"and {hidden} more"
            self._drawing.text(next(iter(self._right.values())).x, bottom + 18.0, content, style="title")
        return self._drawing.finished("Components and connections of the system", _EDGE)

    def _center_box(self, center: str) -> _Box:
        x = max((box.right for box, _ in self._left.values()), default=_EDGE - self._gap) + self._gap
        bottom = max((box.y + box.height for box, _ in self._left.values()), default=0.0)
        height = sum(self._height(name) + _SPACE for name in self._others) - _SPACE
        rights = (_at(a, center) for lanes in self._inner.values() for a in lanes)
        wide = self._wide(center, (a.target.text for a in self._feeding), rights)
        return _Box(center, x, _EDGE, wide, max(height, bottom - _EDGE, _HEADING + _EDGE))

    def _height(self, name: str) -> float:
        lanes = max([k for k, _ in _numbered(self._inner[name])], default=-1) + 1
        return _HEADING + _LANE * max(lanes, len(self._outer[name])) + 8.0

    def _right_boxes(self) -> Iterable[tuple[str, _Box]]:
        x, y = self._center.right + self._gap, _EDGE
        ports = {name: (_at(a, name) for a in self._inner[name]) for name in self._others}
        widths = (self._wide(n, at, (text for _, text, _ in self._outer[n])) for n, at in ports.items())
        wide = max(widths, default=0.0)
        for name in self._others:
            yield name, _Box(name, x, y, wide, self._height(name))
            y += self._height(name) + _SPACE

    def _wide(self, name: str, lefts: Iterable[str], rights: Iterable[str]) -> float:
        heading = _TITLE * _widest([name, self._sources.get(name, "")]) + 32.0
        return max(_widest(lefts) + _widest(rights) + 40.0, heading, 130.0)

    def _bonds(self, name: str, box: _Box) -> None:
        """Shade each bond, and write its name above."""
        lanes: dict[str, list[int]] = {}
        for k, arrow in _numbered(self._inner[name]):
            lanes.setdefault(arrow.bond, []).append(k)
        for bond in filter(None, lanes):
            top, bottom = box.lane(lanes[bond][0]) - 0.5 * _LANE, box.lane(lanes[bond][-1]) + 0.5 * _LANE
            self._drawing.rectangle(self._center.right, top - 24.0, self._gap, bottom - top + 28.0, style="bond")
            self._drawing.text(box.x - 0.5 * self._gap, top - 14.0, bond, style="bondname", anchor="middle")

    def _flow(self, arrow: Arrow, boxes: tuple[_Box, _Box], y: float, *, note: str = "") -> None:
        left, right = boxes
        forward = bool(note) or arrow.source.component == left.name
        ends = (left.right, right.x) if forward else (right.x, left.right)
        texts = (arrow.source.text, arrow.target.text) if forward else (arrow.target.text, arrow.source.text)
        self._drawing.arrow((ends[0], y), (ends[1], y), style=arrow.kind)
        self._drawing.text(left.right - 8.0, y, texts[0], style="port", anchor="end")
        self._drawing.text(right.x + 8.0, y, texts[1], style="port")
        self._drawing.text(0.5 * sum(ends), y - 8.0, arrow.unit, style="unit", anchor="middle")
        self._sign(arrow, (ends[1], y), -1.0 if forward else 1.0)

    def _sign(self, arrow: Arrow, tip: tuple[float, float], side: float) -> None:
        """Write an arrow's sign next to its tip: to the right for side 1, to the left for -1.

        A factor follows if it is not one; a sum sign precedes if the target adds up several sources.
        """
        factor = "" if abs(arrow.gain) == 1.0 else f"{abs(arrow.gain):.4g}"
        sign = f"{'Σ ' if arrow.summed else ''}{'+' if arrow.gain > 0.0 else '−'}{factor}"
        self._drawing.badge(tip, side, sign, style="minus" if arrow.gain < 0.0 else "plus")

    def _stubs(self, name: str, box: _Box) -> None:
        """Draw the external inputs of a component on the right, and the port names at which arcs end."""
        for k, (arrow, text, _) in enumerate(self._outer[name]):
            y = box.lane(k)
            self._drawing.text(box.right - 8.0, y, text, style="port", anchor="end")
            if not arrow.source.component:
                self._drawing.arrow((box.right + 60.0, y), (box.right, y), style=arrow.kind)
                self._sign(arrow, (box.right, y), 1.0)
                content = f"{arrow.kind} {arrow.source.text} {arrow.unit}"
                self._drawing.text(box.right + 66.0, y, content, style="port")

    def _outer_end(self, arrow: Arrow, way: str) -> tuple[float, float]:
        component = arrow.source.component if way == "out" else arrow.target.component
        ways = [(id(a), w) for a, _, w in self._outer[component]]
        box = self._right[component]
        return box.right, box.lane(ways.index((id(arrow), way)))


def _outer(joined: Iterable[Arrow], name: str, center: str) -> list[tuple[Arrow, str, str]]:
    """Return the arrows at the right side of a component: each arrow, its text there, and its direction."""
    ends = []
    for arrow in joined:
        if arrow.joins(center):
            continue
        if arrow.source.component == name:
            ends.append((arrow, arrow.source.text, "out"))
        if arrow.target.component == name:
            ends.append((arrow, arrow.target.text, "in"))
    return ends


def _left_boxes(feeding: Sequence[Arrow]) -> dict[str, tuple[_Box, list[Arrow]]]:
    """Place the boxes that feed the component in the middle from outside: the drive, constants."""
    groups: dict[str, list[Arrow]] = {}
    for arrow in feeding:
        groups.setdefault(_ITSELF if arrow.source.component else arrow.kind, []).append(arrow)
    wide = max((_widest([name, *(a.source.text for a in group)]) + 32.0 for name, group in groups.items()), default=0.0)
    boxes: dict[str, tuple[_Box, list[Arrow]]] = {}
    y = _EDGE
    for name, group in groups.items():
        height = _HEADING + _LANE * len(group) + 8.0
        boxes[name] = (_Box(name, _EDGE, y, wide, height), group)
        y += height + _SPACE
    return boxes


def _numbered(lanes: Sequence[Arrow]) -> list[tuple[int, Arrow]]:
    """Return each arrow with its lane; a lane above each further bond is left free for its name."""
    numbered: list[tuple[int, Arrow]] = []
    for arrow in lanes:
        last = numbered[-1] if numbered else None
        lane = 0 if last is None else last[0] + 1 + (arrow.bond != last[1].bond)
        numbered.append((lane, arrow))
    return numbered


def _at(arrow: Arrow, component: str) -> str:
    return arrow.source.text if arrow.source.component == component else arrow.target.text


def _widest(texts: Iterable[str]) -> float:
    return max(map(width, texts), default=0.0)
