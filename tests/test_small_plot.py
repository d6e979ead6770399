"""Small plots: curves at their place, round numbers on the axes, both in the units that are shown."""

import re

import numpy as np
import pytest

from eightpost.report.numbers import Display
from eightpost.report.small_plot import HEIGHT, WIDTH, small_plot

INCH, POUND = 0.0254, 4.4482216152605
VELOCITY = ("velocity", Display.us("m/s"))
FORCE = ("force", Display.us("N"))


def _plot(x, y):
    return small_plot([(np.array(x) * INCH, np.array(y) * POUND, "chosen")], VELOCITY, FORCE, "force & <velocity>")


def _points(svg):
    (text,) = re.findall(r'points="([^"]*)"', svg)
    return np.array([[float(part) for part in pair.split(",")] for pair in text.split()])


def test_a_curve_fills_the_plot_and_upwards_is_more():
    points = _points(_plot([-10.0, 0.0, 10.0], [-100.0, 0.0, 300.0]))
    assert points[0] == pytest.approx([42.0, HEIGHT - 32.0]) and points[2] == pytest.approx([WIDTH - 6.0, 8.0])
    assert points[1, 0] == pytest.approx(0.5 * (42.0 + WIDTH - 6.0))
    assert points[1, 1] == pytest.approx(HEIGHT - 32.0 - 0.25 * (HEIGHT - 40.0), abs=0.06)


def test_the_axes_have_round_numbers_in_the_unit_that_is_shown():
    svg = _plot([-38.0, 38.0], [-520.0, 640.0])
    numbers = re.findall(r">([−0-9.]+)</text>", svg)
    assert numbers == ["−20", "0", "20", "−500", "0", "500"]
    assert svg.count('class="axis"') == 2 and "velocity [in/s]" in svg and "force [lbf]" in svg


def test_a_number_is_at_the_place_of_its_value():
    svg = _plot([0.0, 10.0], [0.0, 100.0])
    place = float(re.search(r'x="([0-9.]+)" y="[0-9.]+">4</text>', svg)[1])
    assert place == pytest.approx(42.0 + 0.4 * (WIDTH - 48.0), abs=0.1)


def test_a_constant_curve_is_drawn_in_the_middle_and_the_label_is_escaped():
    svg = _plot([0.0, 1.0], [5.0, 5.0])
    assert np.ptp(_points(svg)[:, 1]) == 0.0
    assert 'aria-label="force &amp; &lt;velocity&gt;"' in svg
