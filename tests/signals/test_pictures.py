"""A picture of a time series shows what can be drawn, and an error says why nothing can."""

import numpy as np
import pytest

from eightpost.errors import InputError
from eightpost.report.pictures import Cloud, cloud
from eightpost.signals import TimeSeries

pytestmark = pytest.mark.usefixtures("placed_panels")

TIME = np.arange(100) / 100.0
LARGEST = np.finfo(np.float64).max


def is_drawn(picture) -> bool:
    return picture._repr_png_().startswith(b"\x89PNG")


def one_channel(values, unit="N", name="force") -> TimeSeries:
    return TimeSeries.from_channels(TIME, {name: (unit, values)})


@pytest.mark.repeated
@pytest.mark.parametrize("unit", ["1", "m", "K"])
@pytest.mark.parametrize("largest", [9e307, LARGEST])
def test_a_run_that_diverged_is_drawn_as_far_as_an_axis_reaches(unit, largest):
    growing = np.where(TIME < 0.5, np.sin(20.0 * TIME), largest * np.sign(np.sin(20.0 * TIME)))
    picture = one_channel(growing, unit).plot()
    assert is_drawn(picture)
    assert np.isfinite(picture.figure.axes[0].lines[0].get_ydata()).sum() == 50
    assert is_drawn(cloud(Cloud((growing, TIME), ("x", "y"), np.ones(100, bool))))


def test_a_constant_channel_and_one_of_zeros_are_drawn():
    assert is_drawn(one_channel(np.full(100, LARGEST)).plot()) and is_drawn(one_channel(np.zeros(100)).plot())


def test_a_long_series_of_few_samples_is_drawn_as_a_whole():
    few = TimeSeries.from_channels([0.0, 50.0, 100.0], {"force": ("N", [0.0, 1.0, 2.0])})
    assert is_drawn(few.plot()) and few.plot().figure.axes[0].lines[0].get_xdata().size == 3


def test_dollar_signs_in_a_name_are_no_mathematics():
    assert is_drawn(one_channel(TIME, name="a$b^^$").plot(title="$x^^$"))


def test_a_channel_named_twice_is_drawn_once():
    assert len(one_channel(TIME).plot(["force", "force"]).figure.axes) == 1


def test_a_panel_is_as_high_alone_as_among_four():
    """Title and time axis have their own space, which no panel loses."""
    heights = []
    for count in (1, 4):
        figure = MANY.plot(MANY.names[:count]).figure
        heights += [axes.get_position().height * figure.get_figheight() for axes in figure.axes]
    assert heights == pytest.approx([1.7] * 5, rel=0.05)  # inches


MANY = TimeSeries.from_channels(TIME, {f"c{k}": ("N", TIME) for k in range(301)})


@pytest.mark.parametrize(("series", "options", "message"), [
    (TimeSeries.from_channels(TIME, {}), {}, "these are 100 samples of 0 channels"),
    (one_channel(TIME).window(0.0, 0.0), {}, "needs two samples and 1 to 300 channels; these are 1 samples"),
    (MANY, {"channels": MANY.names}, "301 channels"),
    (one_channel(TIME), {"start": 0.511, "stop": 0.519}, "no sample between 0.511 and 0.519 s"),
])  # fmt: skip
def test_what_cannot_be_drawn_is_an_input_error(series, options, message):
    with pytest.raises(InputError, match=message):
        series.plot(**options)
