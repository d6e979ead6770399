"""An archive's documents are complete, self-contained and true; a confidential archive's tell what they may."""

from __future__ import annotations

import dataclasses
import io
import re
import xml.etree.ElementTree as ET
import zipfile
from html.parser import HTMLParser
from pathlib import Path

import fmpy
import matplotlib
import numpy as np
import pytest
from fmpy.util import read_csv, read_ref_opt_file
from fmu_manipulation_toolbox.terminals import Terminals
from lxml import etree
from numpy.polynomial import polynomial
from PIL import Image
from scipy.signal import cont2discrete

from builder.documents import Disclosure, Subject, documents
from builder.documents.equations import mathml, render
from builder.documents.terminals import terminals_and_icons
from builder.interface import vehicle_interface
from builder.product import Product, shock_product, vehicle_product
from builder.sources import source_folder
from eightpost.shock import Lpnl2, Shock, StaticCurve
from eightpost.vehicle import Channel, IdentifiedVehicle, StateSpace, StructuralVehicle, read_vehicle, shipped

LAWS = ("polylinear", "lpf1", "lpnl2")
CARS = ("seven_dof", "quarter_car")
ALL = (*LAWS, *CARS)
PAGE, PICTURE, TERMINALS = "documentation/index.html", "model.png", "terminalsAndIcons/terminalsAndIcons.xml"
EXTRA = "extra/eightpost"


@pytest.fixture(scope="module")
def products(shocks) -> dict[str, Product]:
    cars = {name: vehicle_product(read_vehicle(shipped(name)), name) for name in CARS}
    return {name: shock_product(shock, name) for name, shock in shocks.items()} | cars


def members_of(product: Product, disclosure: Disclosure = Disclosure.FULL) -> dict[str, bytes]:
    subject = Subject(product.identifier, product.text, product.interface, product.source)
    return documents(subject, disclosure=disclosure)


@pytest.fixture(scope="module")
def archives(products) -> dict[str, dict[str, bytes]]:
    return {name: members_of(product) for name, product in products.items()}


def page_of(members: dict[str, bytes]) -> str:
    return members[PAGE].decode()


# The page


class Reader(HTMLParser):
    """Refuses tags that do not close in order; keeps what a browser would show and what it would load."""

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


@pytest.mark.parametrize("name", ALL)
def test_the_page_is_well_formed_and_loads_nothing(archives, name):
    page = page_of(archives[name])
    reader = Reader(page)
    assert not reader.open
    assert len(reader.loaded) == 1
    assert all(load.startswith("data:image/png;base64,") for load in reader.loaded)
    assert not re.search(r"https?:|@import|url\(|<script|<link|<iframe", page)


@pytest.mark.parametrize("name", ALL)
def test_every_link_of_the_page_leads_to_a_place_on_it(archives, name):
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
def test_the_page_draws_every_equation_of_its_text_and_leaves_no_latex_over(archives, products, name):
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


def test_mathematics_becomes_mathml_in_the_line_and_by_itself():
    inline = '<p>so <math display="inline"><mrow><msub><mi>F</mi><mi>s</mi></msub></mrow></math> is</p>\n'
    assert render("so $F_s$ is") == inline
    assert render("```math\nF\n```").startswith('<div class="equation"><math display="block">')
    assert "<pre>" in render("```python\nF\n```")
    assert render("5 $ is a price") == "<p>5 $ is a price</p>\n"


FITTED = {
    "conditions": {
        "build": "build 7",
        "clicks": "14 from closed",
        "gas_pressure [Pa]": 1034213.59,
        "temperature_range [K]": [299.9833, 302.0944],
        "velocity_range [m/s]": [-0.827, 0.7851],
        "source": "run_7_raw.csv",
    },
    "fit": {
        "rms [N]": 11.255,
        "percent": 1.35,
        "status": "converged from dyno_7.csv",
        "parameters": {
            "time_constant": {"value": 0.00148, "unit": "s", "standard_error": 4e-5, "bounds": [1e-4, 1e-2]},
            "gas_stiffness": {"value": 615.5, "unit": "N/m", "standard_error": 39.0, "bounds": [0.0, None]},
        },
        "changes": ["the outer cubics join the inner polynomial"],
        "warnings": ["few samples at 30 in/s"],
    },
    "inputs": ({"name": "dyno_7.csv", "sha256": "84a0a12e0ced6a1f"},),
}


@pytest.fixture(scope="module")
def fitted() -> Product:
    """A shock as `eightpost fit` leaves it: coefficients with all their digits, conditions, a fit, source files."""
    rng = np.random.default_rng(7)
    curve = StaticCurve(
        inner=(2605.7363180956877, *rng.uniform(-300.0, 300.0, 14).tolist()),
        compression=tuple(rng.uniform(100.0, 900.0, 4).tolist()),
        rebound=tuple(rng.uniform(-900.0, -100.0, 4).tolist()),
        transition_speed=0.3812345678,
        transition_width=0.0127123456,
        compression_speed=0.7850956316405265,
        rebound_speed=0.8269828490984555,
        compression_slope=2057.320521989052,
        rebound_slope=2635.797629716069,
    )
    shock = Shock("dyno_7", Lpnl2(curve, 0.00148, 123.8, 1881.9), **FITTED)
    return shock_product(shock, "front_shock")


def test_the_page_tells_conditions_fit_and_digest_in_customary_units_and_si(fitted):
    shown = "".join(Reader(page_of(members_of(fitted))).shown)
    for text in ("build 7", "14 from closed", "150 psi", "1.034e+06 Pa", "80.3 to 84.1 °F", "-32.56 to 30.91 in/s"):
        assert text in shown
    for text in ("2.53 lbf", "1.35 %", "3.515 lbf/in (615.5 N/m)", "0 to ∞ lbf/in", "0.0001 to 0.01 s"):
        assert text in shown
    for text in ("the outer cubics join", "few samples at 30 in/s", "dyno_7.csv", "84a0a12e0ced6a1f"):
        assert text in shown


def test_the_page_of_a_vehicle_tells_its_parameters_and_modes(archives):
    page = page_of(archives["quarter_car"])
    assert "<td>1280 lbf/in</td><td>2.242e+05 N/m</td>" in page  # Table 4.1
    modes = read_vehicle(shipped("quarter_car")).with_damper().modes()
    for mode in modes:
        assert f"{mode.frequency_hz:.3g} Hz" in page


def test_what_people_name_cannot_break_the_page(shocks):
    shock = dataclasses.replace(shocks["lpf1"], name="<b>R$5 & x_1$", conditions={"note": "</td><script>"})
    page = page_of(members_of(shock_product(shock, "odd")))
    assert "<b>" not in page and "<script>" not in page
    assert "&lt;b&gt;R$5 &amp; x_1$" in page


# The picture and the icon


@pytest.mark.parametrize("name", ALL)
def test_the_pictures_are_the_same_bytes_twice_whatever_the_users_style(archives, products, name):
    with matplotlib.rc_context({"lines.linewidth": 9.0, "font.size": 30.0, "axes.grid": True, "savefig.dpi": 30}):
        again = members_of(products[name])
    assert again == archives[name]


@pytest.mark.parametrize("name", ALL)
def test_the_picture_is_legible_and_the_icon_square_and_neither_tells_who_made_it(archives, name):
    for member, size in ((PICTURE, (900, 600)), ("terminalsAndIcons/icon.png", (256, 256))):
        image = Image.open(io.BytesIO(archives[name][member]))
        assert image.size == size
        assert set(image.info) <= {"dpi"}
        colours = np.unique(np.asarray(image.convert("RGB")).reshape(-1, 3), axis=0)
        assert len(colours) > 20


def test_the_curve_in_the_picture_is_the_shocks_own(shocks):
    shock = shocks["polylinear"]
    stiffer = dataclasses.replace(shock, law=dataclasses.replace(shock.law, port=dataclasses.replace(shock.law.port, compression_scale=2.0)))  # fmt: skip # noqa: E501
    gassed = dataclasses.replace(shock, law=dataclasses.replace(shock.law, port=dataclasses.replace(shock.law.port, gas_preload=400.0)))  # fmt: skip # noqa: E501
    first, second, third = (members_of(shock_product(s, "x"))[PICTURE] for s in (shock, stiffer, gassed))
    assert first != second
    assert first == third  # the gas force is left out


def test_a_model_without_roads_and_tires_has_a_picture_too():
    model = StateSpace([[0.0, 1.0], [-100.0, -1.0]], [[0.0], [1.0]], [[0.0, 1.0]], [[0.0]],
                       (Channel("force", "N"),), (Channel("velocity", "m/s"),))  # fmt: skip
    product = vehicle_product(IdentifiedVehicle("bare", model), "bare")
    assert Image.open(io.BytesIO(members_of(product)[PICTURE])).size == (900, 600)


# Terminals


@pytest.mark.parametrize("name", ALL)
def test_terminals_and_icons_is_valid_against_the_schema_of_fmi_3(archives, name):
    folder = Path(fmpy.__file__).parent / "schema" / "fmi3"
    schema = etree.XMLSchema(etree.parse(str(folder / "fmi3TerminalsAndIcons.xsd")))
    schema.assertValid(etree.fromstring(archives[name][TERMINALS]))


def kinds_of(xml: bytes) -> dict[str, dict[str, tuple[str, str]]]:
    return {
        str(terminal.get("name")): {
            str(m.get("memberName")): (str(m.get("variableName")), str(m.get("variableKind"))) for m in terminal
        }
        for terminal in ET.fromstring(xml).iter("Terminal")
    }


def test_a_shock_has_one_port_whose_force_flows_out():
    # Read from the file that the standard's rules are for, not from the type behind it.
    product = shock_product(Shock("x", _any_law()), "x")
    assert kinds_of(members_of(product)[TERMINALS]) == {
        "port": {
            "velocity": ("velocity", "signal"),
            "displacement": ("displacement", "signal"),
            "force": ("force", "outflow"),
        }
    }


def _any_law() -> Lpnl2:
    curve = StaticCurve(
        (1.0,) + (0.0,) * 14, (1.0, 0.0, 0.0, 0.0), (-1.0, 0.0, 0.0, 0.0), 0.4, 0.01, 1.0, 1.0, 1.0, 1.0
    )
    return Lpnl2(curve, 1e-3, 1.0, 2.0)


def test_a_vehicle_has_one_port_per_corner_whose_force_flows_in(archives):
    found = kinds_of(archives["seven_dof"][TERMINALS])
    assert list(found) == ["lf", "rf", "lr", "rr"]
    for corner, members in found.items():
        assert members["velocity"] == (f"{corner}.velocity", "signal")
        assert members["displacement"] == (f"{corner}.displacement", "signal")
        assert members["force"] == (f"{corner}.force", "inflow")
    assert list(kinds_of(archives["quarter_car"][TERMINALS])) == ["port"]


def test_kirchhoffs_law_at_the_terminals_gives_the_vehicle_the_shocks_force(archives):
    """Inflows minus outflows are zero at a connection: with force 1 out of the shock, 1 goes into the vehicle."""
    sign = {"inflow": 1.0, "outflow": -1.0}
    shock = sign[kinds_of(archives["lpnl2"][TERMINALS])["port"]["force"][1]]
    vehicle = sign[kinds_of(archives["quarter_car"][TERMINALS])["port"]["force"][1]]
    assert -shock * 1.0 / vehicle == 1.0


def test_fmutool_connects_a_shock_to_a_corner(archives):
    shock = next(iter(Terminals.from_xml_source(io.BytesIO(archives["lpnl2"][TERMINALS]))))
    corner = Terminals.from_xml_source(io.BytesIO(archives["seven_dof"][TERMINALS])).terminals["rr"]
    assert shock == corner  # of one kind
    assert set(corner.connect(shock)) == {(f"rr.{name}", name) for name in ("velocity", "displacement", "force")}


def test_a_vehicle_without_displacements_has_ports_without_them():
    model = StateSpace(
        [[0.0]], [[1.0]], [[1.0]], [[0.0]], (Channel("lf.force", "N"),), (Channel("lf.velocity", "m/s"),)
    )
    assert list(kinds_of(terminals_and_icons(vehicle_interface(model)))["lf"]) == ["velocity", "force"]


# Reference results


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


@pytest.mark.parametrize("name", ALL)
def test_the_reference_files_keep_the_cross_check_rules(archives, products, name):
    (input_names, u), (output_names, y) = (
        table_of(archives[name][f"{EXTRA}/{name}_{kind}.csv"]) for kind in ("in", "ref")
    )
    interface = products[name].interface
    assert input_names[0] == output_names[0] == "time"
    assert set(input_names) - {"time"} == set(interface.names("input"))
    assert set(output_names) - {"time"} <= set(interface.names("output")) | set(interface.names("local"))
    assert set(interface.names("output")) <= set(output_names)
    for values in (u, y):
        np.testing.assert_array_equal(values[:, 0], [k / 1000 for k in range(1001)])
        assert np.isfinite(values).all()
    assert all(len(archives[name][f"{EXTRA}/{name}_{kind}.csv"]) < 1_000_000 for kind in ("in", "ref"))
    assert not u[0, 1:].any()
    assert (np.ptp(u[:, 1:], axis=0) > 0.0).all()


@pytest.mark.parametrize("name", LAWS)
def test_a_shocks_reference_goes_beyond_the_fit_on_both_sides_and_moves_as_its_velocity_says(archives, shocks, name):
    inputs, outputs = reference_of(archives[name], name)
    damper = shocks[name].law.port.motion_ratio * inputs["velocity"]
    assert damper.max() > shocks[name].law.curve.compression_speed
    assert damper.min() < -shocks[name].law.curve.rebound_speed
    assert set(outputs["beyond_fit"]) == {0.0, 1.0}
    travelled = np.concatenate([[0.0], np.cumsum((inputs["velocity"][1:] + inputs["velocity"][:-1]) / 2.0 * 1e-3)])
    np.testing.assert_allclose(inputs["displacement"], travelled, atol=1e-4)


def curve_by_numpy(curve: StaticCurve, velocity: np.ndarray) -> np.ndarray:
    """Eq 3.23 by arrays: everything everywhere, then the pieces chosen."""

    def fitted(v: np.ndarray) -> np.ndarray:
        s = v / curve.transition_speed
        outer = np.where(
            v > 0.0,
            polynomial.polyval(np.abs(s) - 1.0, curve.compression),
            polynomial.polyval(np.abs(s) - 1.0, curve.rebound),
        )
        share = np.clip((np.abs(v) - curve.transition_speed) / curve.transition_width + 0.5, 0.0, 1.0)
        return (1.0 - share) * polynomial.polyval(s, (0.0, *curve.inner)) + share * outer

    inside = np.clip(velocity, -curve.rebound_speed, curve.compression_speed)
    slope = np.where(velocity > 0.0, curve.compression_slope, curve.rebound_slope)
    return fitted(inside) + slope * (velocity - inside)


@pytest.mark.parametrize("name", LAWS)
def test_a_shocks_reference_is_its_equation_written_down_again(archives, shocks, name):
    law, (inputs, outputs) = shocks[name].law, reference_of(archives[name], name)
    port, velocity = law.port, np.concatenate([[0.0], inputs["velocity"][:-1]])  # held over the step that ends here
    displacement = np.concatenate([[0.0], inputs["displacement"][:-1]])
    damper = port.motion_ratio * velocity
    static = curve_by_numpy(law.curve, damper) * np.where(damper > 0.0, port.compression_scale, port.rebound_scale)
    lagged = static.copy()
    if name != "polylinear":
        for k in range(1, lagged.size):
            lagged[k] = static[k] + (lagged[k - 1] - static[k]) * np.exp(-1e-3 / law.time_constant)
    weight = {"polylinear": lambda: 0.0 * static, "lpf1": lambda: 0.0 * static + 1.0}.get(
        name, lambda: np.interp(np.abs(static), [law.lag_full_force, law.lag_zero_force], [1.0, 0.0])
    )()
    valves = weight * lagged + (1.0 - weight) * static
    drag = port.seal_friction * np.tanh(damper / port.friction_velocity)
    gas = port.gas_preload + port.gas_stiffness * port.motion_ratio * displacement
    assert_close(outputs["force"], port.motion_ratio * (valves + drag + gas))
    assert_close(outputs["static_force"], static)
    assert_close(outputs["lagged_force"], lagged)
    assert_close(outputs["lag_weight"], weight)
    assert_close(outputs["dissipated_power"], (valves + drag) * damper)


@pytest.mark.parametrize("name", CARS)
def test_a_vehicles_reference_is_scipys_zero_order_hold(archives, name):
    model, (inputs, outputs) = read_vehicle(shipped(name)).coupled(), reference_of(archives[name], name)
    Ad, Bd, *_ = cont2discrete((model.A, model.B, model.C, model.D), 1e-3)
    u = np.array([inputs[channel.name] for channel in model.inputs])
    x = np.zeros((len(model.A), u.shape[1]))
    for k in range(1, u.shape[1]):
        x[:, k] = Ad @ x[:, k - 1] + Bd @ u[:, k - 1]
    y = model.C @ x + model.D @ np.column_stack([u[:, :1], u[:, :-1]])
    for row, channel in zip(y, model.outputs, strict=True):
        assert_close(outputs[channel.name], row)


def test_static_values_are_part_of_a_vehicles_reference():
    vehicle = read_vehicle(shipped("quarter_car"))
    assert isinstance(vehicle, StructuralVehicle)
    moved = dataclasses.replace(vehicle, static={"tire_force": 3000.0})
    (_, plain), (_, shifted) = (reference_of(members_of(vehicle_product(v, "q")), "q") for v in (vehicle, moved))
    np.testing.assert_allclose(shifted["tire_force"] - plain["tire_force"], 3000.0, atol=1e-6)
    np.testing.assert_array_equal(shifted["velocity"], plain["velocity"])


def test_a_vehicle_without_an_equilibrium_ships_no_reference_and_says_nothing_of_one():
    model = StateSpace([[0.0]], [[1.0]], [[1.0]], [[0.0]], (Channel("force", "N"),), (Channel("velocity", "m/s"),))
    members = members_of(vehicle_product(IdentifiedVehicle("free mass", model), "free"))
    assert not [name for name in members if name.startswith(EXTRA)]
    assert "Reference results" not in page_of(members)


@pytest.mark.parametrize("name", ALL)
@pytest.mark.parametrize("target", ["python_fmus", "fmus"])
def test_fmpy_reads_the_reference_files_and_gets_these_results_from_the_fmu(request, tmp_path, target, name):
    fmu = request.getfixturevalue(target)[name]
    with zipfile.ZipFile(fmu) as archive:
        archive.extractall(tmp_path, [m for m in archive.namelist() if m.startswith(EXTRA)])
    folder = tmp_path / EXTRA
    options = read_ref_opt_file(str(folder / f"{name}_ref.opt"))
    expected = read_csv(str(folder / f"{name}_ref.csv"))
    result = fmpy.simulate_fmu(
        str(fmu),
        start_time=options["StartTime"],
        stop_time=options["StopTime"],
        output_interval=options["StepSize"],
        input=read_csv(str(folder / f"{name}_in.csv")),
        output=expected.dtype.names[1:],
    )
    for output in expected.dtype.names[1:]:
        assert_close(result[output], expected[output])
    assert options["RelTol"] == 1e-9


# Confidential archives


def spellings(value: float) -> set[str]:
    """How a coefficient may be written; with six digits and more, for the fitted range is told with four."""
    return {repr(value), *(f"{value:.{digits}g}" for digits in range(6, 17))}


def test_a_confidential_archive_holds_no_coefficient(fitted):
    everything = b"\n".join(members_of(fitted, Disclosure.CONFIDENTIAL).values()).decode("latin-1")
    curve = fitted.source.law.curve
    numbers = [n for field in curve.__slots__ for n in np.atleast_1d(getattr(curve, field)).tolist()]
    assert len(numbers) == 29
    assert not [text for number in numbers for text in spellings(number) if text in everything]
    assert "2605.74" in page_of(members_of(fitted))  # the same search finds it in an open one


def test_a_confidential_archive_names_no_source_file_build_or_digest(fitted):
    members = members_of(fitted, Disclosure.CONFIDENTIAL)
    everything = b"\n".join([*members.values(), *(name.encode() for name in members)]).decode("latin-1")
    for text in ("dyno_7", "run_7", "build 7", "84a0a12e", "14 from closed", "150 psi", "few samples"):
        assert text not in everything


def test_a_confidential_archive_has_an_icon_in_place_of_the_curve(fitted, products):
    for product in (fitted, products["seven_dof"]):
        members = members_of(product, Disclosure.CONFIDENTIAL)
        assert members[PICTURE] == members["terminalsAndIcons/icon.png"]
        assert members[PICTURE] != members_of(product)[PICTURE]


def test_a_confidential_page_still_tells_what_the_shock_may_be_used_for(fitted):
    page = page_of(members_of(fitted, Disclosure.CONFIDENTIAL))
    assert "-32.56 to 30.91 in/s" in page
    assert "1.35 %" in page
    shown = re.findall(r'<td class="name"><code>(.*?)</code>', page)
    assert set(shown) == {v.name for v in fitted.interface.variables if not v.name.startswith("curve.")}


def test_a_confidential_vehicle_tells_no_parameter_and_no_mode(products):
    page = page_of(members_of(products["seven_dof"], Disclosure.CONFIDENTIAL))
    for text in ("2550 lbm", "1280 lbf/in", "damping ratio", "Boggs"):
        assert text in page_of(members_of(products["seven_dof"]))
        assert text not in page


def test_confidential_reference_results_are_those_of_the_force_alone(fitted):
    _, outputs = reference_of(members_of(fitted, Disclosure.CONFIDENTIAL), "front_shock")
    assert list(outputs) == ["time", "force"]
