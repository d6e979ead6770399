"""Functions that read the documents of an archive."""

import re
import xml.etree.ElementTree as ET
from collections.abc import Mapping
from html.parser import HTMLParser
from typing import Any

import lxml.html
import numpy as np

import eightpost.shock
from builder.documents import documents
from builder.product import Product
from builder.reference import Disclosure

LAWS = ("polylinear", "lpf1", "lpnl2")
CARS = ("seven_dof", "quarter_car")
ALL = (*eightpost.shock.LAWS, *CARS)
PAGE, PICTURE, TERMINALS = "documentation/index.html", "model.png", "terminalsAndIcons/terminalsAndIcons.xml"
EXTRA = "extra/eightpost"


def members_of(product: Product, disclosure: Disclosure = Disclosure.FULL) -> dict[str, bytes]:
    return documents(product, disclosure=disclosure)


def page_of(members: dict[str, bytes]) -> str:
    return members[PAGE].decode()


class Reader(HTMLParser):
    """Parser that rejects tags that are not closed in order; it keeps the visible text and the loaded resources."""

    VOID = ("meta", "img")

    def __init__(self, page: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.shown: list[str] = []
        self.loaded: list[str] = []
        self.places: set[str] = set()
        self.links: list[str] = []
        self.feed(page)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        known = dict(attrs)
        self.loaded += [str(known[name]) for name in ("src", "srcset", "data", "poster") if name in known]
        self.links += [str(known["href"])] if tag == "a" else []
        self.loaded += [str(known["href"])] if tag == "link" else []
        self.places |= {str(known["id"])} if "id" in known else set()
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        assert tag == "mspace"

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        if not {"style", "pre", "code"} & set(self.open):
            self.shown.append(data)


def kinds_of(xml: bytes) -> dict[str, dict[str, tuple[str, str]]]:
    return {
        str(terminal.get("name")): {
            str(m.get("memberName")): (str(m.get("variableName")), str(m.get("variableKind"))) for m in terminal
        }
        for terminal in ET.fromstring(xml).iter("Terminal")
    }


def table_of(content: bytes) -> tuple[tuple[str, ...], np.ndarray]:
    head, *lines = content.decode().splitlines()
    assert re.fullmatch(r'"[^"]+"(,"[^"]+")*', head)
    return tuple(head.replace('"', "").split(",")), np.array(
        [[float(cell) for cell in line.split(",")] for line in lines]
    )


def reference_of(members: dict[str, bytes], name: str) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
    inputs, outputs = (table_of(members[f"{EXTRA}/{name}_{kind}.csv"]) for kind in ("in", "ref"))
    return tuple(dict(zip(names, values.T, strict=True)) for names, values in (inputs, outputs))  # type: ignore[return-value]


def assert_close(found: np.ndarray, expected: np.ndarray) -> None:
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-9 * max(np.abs(expected).max(), 1e-9))


def _rows(page: str) -> list[str]:
    """Return the headings, rows of tables and texts of pictures, one a line; of an array the first element."""
    found = lxml.html.fromstring(page).xpath("//h1 | //h2 | //h3 | //tr | //img | //pre")
    parts = ([*one.itertext(), one.get("alt", "")] for one in found)
    rows = [" | ".join(" ".join(part.split()) for part in texts if part.strip()) for texts in parts]
    return [row for row in rows if not re.match(r"\S+\[([2-9]|\d\d)\] ", row)]


def kept_of(members: Mapping[str, bytes], name: str) -> dict[str, Any]:
    """Return what is kept of the documents of an FMU: tables of the page, reference results, texts, terminals."""
    inputs, outputs = reference_of(dict(members), name) if f"{EXTRA}/{name}_in.csv" in members else ({}, {})
    texts = {
        one: content.decode()
        for one, content in members.items()
        if one.startswith(("extra/", "resources/")) and not one.endswith(".csv")
    }
    return {"page": _rows(page_of(dict(members))), "inputs": inputs, "outputs": outputs} | texts | {
        "terminals": members.get(TERMINALS, b"").decode(), "members": sorted(members)
    }  # fmt: skip
