"""The page is complete, self-contained and correct."""

import dataclasses
import io
import re
from collections.abc import Callable, Mapping

import numpy as np
import pytest
from fmu_manipulation_toolbox.terminals import Terminals

from builder.interface import source_folder, vehicle_interface
from builder.page import mathml, render, terminals_and_icons
from builder.product import Product, shock_product
from builder.reference import Disclosure
from eightpost.vehicle import Channel, StateSpace

from .members import ALL, PICTURE, TERMINALS, Reader, kept_of, kinds_of, members_of, page_of


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


@pytest.mark.parametrize("name", ["quarter_car"])
def test_the_documents_of_a_model_are_the_same(
    name: str, archives: Mapping[str, Mapping[str, bytes]], unchanged: Callable[..., None]
) -> None:
    unchanged(kept_of(archives[name], name))


@pytest.mark.parametrize("disclosure", Disclosure)
def test_the_documents_of_a_fitted_shock_are_the_same(
    disclosure: Disclosure, fitted: Product, unchanged: Callable[..., None]
) -> None:
    unchanged(kept_of(members_of(fitted, disclosure), "front_shock"))


# ---- Confidential archives -------------------------------------------------------------------------------------------


def spellings(value: float) -> set[str]:
    """Return the possible spellings of a coefficient with six or more digits; the fitted range is shown with four."""
    return {repr(value), *(f"{value:.{digits}g}" for digits in range(6, 17))}


def test_a_confidential_archive_contains_no_coefficient(fitted):
    everything = b"\n".join(members_of(fitted, Disclosure.CONFIDENTIAL).values()).decode("latin-1")
    curve = fitted.source.law.curve
    numbers = [
        n for field in curve.__slots__ if "knot" not in field for n in np.atleast_1d(getattr(curve, field)).tolist()
    ]
    assert len(numbers) == 29
    assert not [text for number in numbers for text in spellings(number) if text in everything]
    assert "2605.74" in page_of(members_of(fitted))  # the same search finds it in an open archive


def test_a_confidential_archive_contains_no_source_file_name_build_or_digest(fitted):
    members = members_of(fitted, Disclosure.CONFIDENTIAL)
    everything = b"\n".join([*members.values(), *(name.encode() for name in members)]).decode("latin-1")
    for text in ("dyno_7", "run_7", "build 7", "84a0a12e", "14 from closed", "150 psi", "few samples"):
        assert text not in everything


def test_a_confidential_archive_has_an_icon_in_place_of_the_curve(archives, fitted, products):
    for product, full in ((fitted, members_of(fitted)), (products["seven_dof"], archives["seven_dof"])):
        members = members_of(product, Disclosure.CONFIDENTIAL)
        assert members[PICTURE] == members["terminalsAndIcons/icon.png"]
        assert members[PICTURE] != full[PICTURE]


def test_a_confidential_vehicle_discloses_no_parameter_and_no_mode(archives, products):
    page = page_of(members_of(products["seven_dof"], Disclosure.CONFIDENTIAL))
    for text in ("2550 lbm", "1280 lbf/in", "damping ratio", "Boggs"):
        assert text in page_of(archives["seven_dof"])
        assert text not in page


# ---- Terminals -------------------------------------------------------------------------------------------------------


def test_a_vehicle_has_one_port_per_corner_whose_force_flows_in(archives):
    found = kinds_of(archives["seven_dof"][TERMINALS])
    assert list(found) == ["lf", "rf", "lr", "rr"]
    for corner, members in found.items():
        assert members["velocity"] == (f"{corner}.velocity", "signal")
        assert members["displacement"] == (f"{corner}.displacement", "signal")
        assert members["force"] == (f"{corner}.force", "inflow")
    assert list(kinds_of(archives["quarter_car"][TERMINALS])) == ["port"]


def test_fmutool_connects_a_shock_to_a_corner(archives):
    shock = next(iter(Terminals.from_xml_source(io.BytesIO(archives["lpnl2"][TERMINALS]))))
    corner = Terminals.from_xml_source(io.BytesIO(archives["seven_dof"][TERMINALS])).terminals["rr"]
    assert shock == corner  # terminals of the same kind
    assert set(corner.connect(shock)) == {(f"rr.{name}", name) for name in ("velocity", "displacement", "force")}


def test_a_vehicle_without_displacements_has_ports_without_displacements():
    model = StateSpace(
        [[0.0]], [[1.0]], [[1.0]], [[0.0]], (Channel("lf.force", "N"),), (Channel("lf.velocity", "m/s"),)
    )
    assert list(kinds_of(terminals_and_icons(vehicle_interface(model)))["lf"]) == ["velocity", "force"]
