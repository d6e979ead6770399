"""Tests of the plots of a fit: all data are in them, and nothing of an output that was plotted before."""

from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from eightpost.ident.vehicle import plots, variants
from eightpost.ident.vehicle.plots import plot_fits
from eightpost.vehicle import read_vehicle, shipped
from tests.drawn import drawn as described

from .conftest import truth_fit
from .test_page_parts import TRUST

OUTPUTS = ("velocity", "tire_force", "ride_height")


@pytest.fixture(scope="module")
def fit():
    return truth_fit("quarter_car")


def drawn(fit, folder, *outputs):
    folder.mkdir()
    paths = plot_fits(fit.response.select(outputs=outputs), fit.vehicle.state_space.select(outputs=outputs), "", folder)
    return [Image.open(path).convert("RGB") for path in paths]


def test_panels_have_their_size_in_inches_below_the_title(fit, tmp_path, monkeypatch):
    figures = []
    monkeypatch.setattr(plots, "save", lambda figure, *_, **__: figures.append(figure))
    drawn_ones = fit.response.select(outputs=["velocity"]), fit.vehicle.state_space.select(outputs=["velocity"])
    plot_fits(*drawn_ones, "", tmp_path)
    wide, high = figures[0].get_size_inches()
    panel, strip = (figures[0].axes[k].get_position() for k in (0, -1))
    assert (wide * panel.width, high * panel.height) == pytest.approx((3.05, 2.05))
    assert strip.y1 < panel.y0 < panel.y1 < figures[0]._suptitle.get_position()[1] < 1.0


def test_the_plots_of_a_fit(fit, tmp_path, monkeypatch, unchanged):
    shown = {}
    monkeypatch.setattr(plots, "save", lambda figure, path, **_: shown.update({path.stem: described(figure)}))
    partial = replace(fit.response, partial_coherence=np.full(fit.response.H.shape, 0.7))
    plot_fits(
        partial.select(outputs=OUTPUTS[:2]), fit.vehicle.state_space.select(outputs=OUTPUTS[:2]), "mine", tmp_path
    )
    plots.plot_stabilisation(TRUST.orders, tmp_path / "orders.png")
    unchanged(shown)


def test_the_magnitudes_of_responses_of_varied_cars(unchanged):
    car, frequency = read_vehicle(shipped("quarter_car")), variants.frequencies_to(20.0)
    found = variants.variants_of(car, "tire_stiffness", (0.5, 1.0, 2.0), frequency)
    figure = plots.magnitudes({label: one.response for label, one in found.items()}, "spring_force")
    figure.draw_without_rendering()
    unchanged({"picture": described(figure), "modes": {label: one.modes for label, one in found.items()}})
