"""The page is complete, self-contained and correct."""

from __future__ import annotations

import dataclasses
import re

import pytest

from builder.interface import source_folder
from builder.page import mathml, render
from builder.product import shock_product
from eightpost.vehicle import read_vehicle, shipped

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


def test_a_parameters_row_has_unit_start_display_value_range_and_variability(archives):
    row = next(
        line
        for line in page_of(archives["lpnl2"]).splitlines()
        if line.startswith('<tr><td class="name"><code>gas_stiffness<')
    )
    # 700 N/m is 700 * 0.0254 / 4.4482216 lbf/in
    for cell in ("N/m", "700", "3.997 lbf/in", "0 … ∞", "tunable", "Parallel gas spring at the damper (Eq 3.14)"):
        assert f">{cell}</td>" in row


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


def test_the_page_shows_conditions_fit_and_digest_in_customary_units_and_si(fitted):
    shown = "".join(Reader(page_of(members_of(fitted))).shown)
    for text in ("build 7", "14 from closed", "150 psi", "1.034e+06 Pa", "80.3 to 84.1 °F", "-32.56 to 30.91 in/s"):
        assert text in shown
    for text in (
        "2.53 lbf",
        "1.35 %",
        "1.6 % (LPNL2: 2.4 %)",
        "3.515 lbf/in (615.5 N/m)",
        "0 to ∞ lbf/in",
        "0.0001 to 0.01 s",
    ):
        assert text in shown
    for text in ("the outer cubics join", "few samples at 30 in/s", "dyno_7.csv", "84a0a12e0ced6a1f"):
        assert text in shown


def test_the_page_of_a_vehicle_shows_its_parameters_and_modes(archives):
    page = page_of(archives["quarter_car"])
    assert "<td>1280 lbf/in</td><td>2.242e+05 N/m</td>" in page  # Table 4.1
    modes = read_vehicle(shipped("quarter_car")).with_damper().modes()
    for mode in modes:
        assert f"{mode.frequency_hz:.3g} Hz" in page


def test_names_with_special_characters_do_not_break_the_page(shocks):
    shock = dataclasses.replace(shocks["lpf1"], name="<b>R$5 & x_1$", conditions={"note": "</td><script>"})
    page = page_of(members_of(shock_product(shock, "odd")))
    assert "<b>" not in page and "<script>" not in page
    assert "&lt;b&gt;R$5 &amp; x_1$" in page
