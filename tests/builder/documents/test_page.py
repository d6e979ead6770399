"""The page is complete, self-contained and correct."""

from __future__ import annotations

import dataclasses
import re

import pytest

from builder.interface import source_folder
from builder.page import mathml, render
from builder.product import shock_product

from .members import ALL, Reader, members_of, page_of


@pytest.mark.parametrize("name", ALL)
def test_the_page_is_well_formed_and_has_no_external_resources(archives, name):
    page = page_of(archives[name])
    reader = Reader(page)
    assert not reader.open
    assert len(reader.loaded) == 1
    assert all(load.startswith("data:image/png;base64,") for load in reader.loaded)
    assert not re.search(r"https?:|@import|url\(|<script|<link|<iframe", page)


@pytest.mark.parametrize("name", ALL)
def test_every_link_of_the_page_refers_to_an_anchor_on_it(archives, name):
    reader = Reader(page_of(archives[name]))
    assert {link.removeprefix("#") for link in reader.links} <= reader.places
    assert all(link.startswith("#") for link in reader.links)


@pytest.mark.parametrize("name", ALL)
def test_the_page_has_one_row_for_every_variable(archives, products, name):
    rows = re.findall(
        r'<tr><td class="name"><code>(.*?)</code></td><td class="number">(\d+)</td>', page_of(archives[name])
    )
    expected = sorted((v.name, str(v.reference)) for v in products[name].interface.variables)
    assert sorted(rows) == expected


@pytest.mark.parametrize("name", ALL)
def test_the_page_shows_every_equation_of_its_text_and_no_latex(archives, products, name):
    kind = products[name].interface.kind
    texts = [(source_folder() / kind / "README.md").read_text(encoding="utf-8")]
    if kind.startswith("shock_"):
        texts.append((source_folder() / "common" / "shock.md").read_text(encoding="utf-8"))
    displayed = re.findall(r"```math\n(.*?)\n```", "\n".join(texts), re.DOTALL)
    page = page_of(archives[name])
    assert page.count('<div class="equation">') == len(displayed) > 3
    for latex in displayed:
        assert mathml(latex, display="block") in page
    assert not re.search(r"[$\\`]", "".join(Reader(page).shown))


def test_mathematics_becomes_inline_and_block_mathml():
    inline = '<p>so <math display="inline"><mrow><msub><mi>F</mi><mi>s</mi></msub></mrow></math> is</p>\n'
    assert render("so $F_s$ is") == inline
    assert render("```math\nF\n```").startswith('<div class="equation"><math display="block">')
    assert "<pre>" in render("```python\nF\n```")
    assert render("5 $ is a price") == "<p>5 $ is a price</p>\n"


def test_the_page_shows_changes_warnings_and_digest_of_a_fit_outside_its_tables(fitted):
    shown = "".join(Reader(page_of(members_of(fitted))).shown)
    for text in ("the outer cubics join", "few samples at 30 in/s", "84a0a12e0ced6a1f"):
        assert text in shown


def test_names_with_special_characters_do_not_break_the_page(shocks):
    shock = dataclasses.replace(shocks["lpf1"], name="<b>R$5 & x_1$", conditions={"note": "</td><script>"})
    page = page_of(members_of(shock_product(shock, "odd")))
    assert "<b>" not in page and "<script>" not in page
    assert "&lt;b&gt;R$5 &amp; x_1$" in page
