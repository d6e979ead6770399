"""The picture and the icon."""

import io
from dataclasses import replace

import matplotlib
import numpy as np
import pytest
from PIL import Image

from builder import page
from builder.product import shock_product, vehicle_product
from eightpost.vehicle import Channel, IdentifiedVehicle, StateSpace

from .members import ALL, PICTURE, members_of

pytestmark = pytest.mark.usefixtures("placed_panels")


@pytest.mark.repeated
@pytest.mark.parametrize("name", ALL)
def test_the_pictures_do_not_depend_on_the_users_matplotlib_style(archives, products, name):
    with matplotlib.rc_context({"lines.linewidth": 9.0, "font.size": 30.0, "axes.grid": True, "savefig.dpi": 30}):
        again = members_of(products[name])
    assert again == archives[name]


@pytest.mark.nightly
@pytest.mark.parametrize("name", ALL)
def test_picture_and_icon_have_the_right_size_many_colours_and_no_software_metadata(archives, name):
    for member, size in ((PICTURE, (900, 600)), ("terminalsAndIcons/icon.png", (256, 256))):
        image = Image.open(io.BytesIO(archives[name][member]))
        assert image.size == size
        assert set(image.info) <= {"dpi"}
        colours = np.unique(np.asarray(image.convert("RGB")).reshape(-1, 3), axis=0)
        assert len(colours) > 20


@pytest.mark.nightly
def test_the_picture_shows_the_shocks_own_curve(shocks):
    """The gas force is not drawn."""
    shock = shocks["polylinear"]
    own, stiffer, gassed = (
        members_of(shock_product(replace(shock, law=replace(shock.law, port=replace(shock.law.port, **port))), "x"))
        for port in ({}, {"compression_scale": 2.0}, {"gas_preload": 400.0})
    )
    assert own[PICTURE] == gassed[PICTURE] != stiffer[PICTURE]


def test_a_model_without_roads_and_tires_has_a_picture():
    model = StateSpace([[0.0, 1.0], [-100.0, -1.0]], [[0.0], [1.0]], [[0.0, 1.0]], [[0.0]],
                       (Channel("force", "N"),), (Channel("velocity", "m/s"),))  # fmt: skip
    product = vehicle_product(IdentifiedVehicle("bare", model), "bare")
    assert Image.open(io.BytesIO(members_of(product)[PICTURE])).size == (900, 600)


def test_a_response_is_drawn_in_displayed_units_from_below_the_body_modes_to_above_the_wheel_hop(monkeypatch):
    monkeypatch.setattr(page, "png", lambda figure: figure)
    mass = StateSpace([[0.0]], [[0.25]], [[1.0]], [[0.0]], (Channel("force", "N"),), (Channel("velocity", "m/s"),))
    (axes,) = page.vehicle_picture(IdentifiedVehicle("mass of 4 kg", mass)).axes
    frequency, gain = axes.lines[0].get_data()
    per_newton, inches = 4.4482216, 1.0 / 0.0254
    assert gain == pytest.approx(inches * per_newton / (4.0 * 2.0 * np.pi * frequency), rel=1e-6)
    low, high = axes.get_xlim()
    assert frequency.min() <= low < min(axes.get_xticks()) < max(axes.get_xticks()) < high <= frequency.max()
