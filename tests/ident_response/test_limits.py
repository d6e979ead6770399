"""Settings and responses of an identification are refused just outside their ranges, and accepted just inside."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from eightpost.drivefile import Settings
from eightpost.errors import ParameterError
from eightpost.ident.grey_box.output_error import Parameter
from eightpost.ident.linearity import Thresholds
from eightpost.ident.vehicle.common_pole_fit import CommonPoleFit
from eightpost.ident.vehicle.estimators import LocalPolynomial
from eightpost.ident.vehicle.experiment import Blocks, CoherentBand, Ranges
from eightpost.ident.vehicle.frequency_response import FrequencyResponse, ZeroPhaseSmoothing
from eightpost.ident.vehicle.siso_models import BandWeights, RationalFit, TransferFunction
from eightpost.ident.vehicle.variants import frequencies_to
from eightpost.signals import TimeSeries
from eightpost.vehicle import Channel

CHANNELS = (Channel("u", "N"),), (Channel("y", "m"),)


def response(frequency: tuple[float, ...] = (0.0, 1.0, 2.0), **changes: Any) -> FrequencyResponse:
    f = np.array(frequency)
    arrays: dict[str, Any] = {"H": np.ones((1, 1, 3)), "coherence": None, "variance": None} | changes
    return FrequencyResponse(f, arrays["H"], *CHANNELS, arrays["coherence"], None, arrays["variance"])


def parameter(start: float = 1.0, **changes: Any) -> Parameter:
    values: dict[str, Any] = {"low": 0.0, "high": 2.0, "size": 1.0, "prior": None} | changes
    return Parameter("k", "N/m", start, **values)


#: Function, arguments that it accepts, and those that it refuses.
RANGES: list[tuple[Callable[..., object], list[dict[str, Any]], list[dict[str, Any]]]] = [
    (CommonPoleFit,
     [{"order": 2}, {"order": 4}, {"low": 0.0}, {"max_states": 2}, {"low": 1.0, "high": 1.1}],
     [{"order": 0}, {"order": 3}, {"low": -0.1}, {"max_states": 1}, {"low": 1.0, "high": 1.0}, {"floor": 0.0}]),
    (LocalPolynomial,
     [{"degree": 0}, {"spare": 1.1}, {"spacing": 0.01}, {"high": 0.1}],
     [{"degree": -1}, {"spare": 1.0}, {"spacing": 0.0}, {"high": 0.0}]),
    (Blocks,
     [{"length": 0.1}, {"length": 1.0, "overlap": 0.0}, {"length": 1.0, "overlap": 0.99}],
     [{"length": 0.0}, {"length": 1.0, "overlap": -0.1}, {"length": 1.0, "overlap": 1.0},
      {"length": 1.0, "high": 0.0}]),
    (CoherentBand, [{"coherence": 0.01}, {"coherence": 0.99}, {"highest": 12.0}],
     [{"coherence": 0.0}, {"coherence": 1.0}, {"highest": 0.1}]),
    (Thresholds, [{"coherence": 0.01}, {"coherence": 0.99}, {"level": -0.1}],
     [{"coherence": 0.0}, {"coherence": 1.0}, {"level": 0.0}]),
    (BandWeights, [{"bands": ((0.0, 1.0, 0.0),)}],
     [{"bands": ((-1.0, 1.0, 1.0),)}, {"bands": ((1.0, 1.0, 1.0),)}, {"bands": ((0.0, 1.0, -0.5),)}]),
    (RationalFit, [{"denominator": 1, "numerator": 0}, {"denominator": 2, "numerator": 2}],
     [{"denominator": 0, "numerator": 0}, {"denominator": 2, "numerator": 3}, {"denominator": 2, "numerator": -1}]),
    (TransferFunction, [{"poles": -np.ones(2), "residues": np.ones(2), "direct": 0.0}],
     [{"poles": -np.ones(2), "residues": np.ones(1), "direct": 0.0},
      {"poles": -np.ones((1, 1)), "residues": np.ones((1, 1)), "direct": 0.0}]),
    (response, [{}, {"coherence": np.ones((1, 3))}, {"variance": np.full((1, 1, 3), np.inf)}],
     [{"frequency": ()}, {"frequency": (-0.1, 1.0, 2.0)}, {"frequency": (0.0, 1.0, 1.0)}, {"H": np.ones((1, 1, 2))},
      {"frequency": (0.0, 1.0, np.inf)}, {"H": np.full((1, 1, 3), np.nan)}, {"coherence": np.ones((1, 1, 3))}]),
    (parameter, [{"start": 0.0}, {"start": 2.0}, {"prior": 0.1}],
     [{"start": -0.1}, {"start": 2.1}, {"prior": 0.0}]),
    (Settings, [{"gain": 1.0}, {"gain": 0.01}, {"regularisation": 0.0}, {"regularisation": 0.99}],
     [{"gain": 0.0}, {"gain": 1.01}, {"regularisation": -0.1}, {"regularisation": 1.0}, {"width": 0.0},
      {"displacement": 0.0}, {"acceleration": 0.0}]),
]  # fmt: skip


@pytest.mark.parametrize(("make", "values"), [(make, values) for make, accepted, _ in RANGES for values in accepted])
def test_a_value_just_inside_its_range_is_accepted(make: Callable[..., object], values: dict[str, Any]) -> None:
    make(**values)


@pytest.mark.parametrize(("make", "values"), [(make, values) for make, _, refused in RANGES for values in refused])
def test_a_value_just_outside_its_range_is_refused(make: Callable[..., object], values: dict[str, Any]) -> None:
    with pytest.raises(ParameterError):
        make(**values)


@pytest.mark.parametrize(("high", "accepted"), [(0.0, False), (0.01, True), (9999.0, True), (1e4, False)])
def test_the_highest_frequency_of_a_picture_is_between_0_and_10_kilohertz(high: float, accepted: bool) -> None:
    if accepted:
        frequency = frequencies_to(high)
        assert (len(frequency), frequency[0], frequency[-1]) == (800, pytest.approx(high / 800), high)
    else:
        with pytest.raises(Exception, match="between 0 and 10000 Hz"):
            frequencies_to(high)


@pytest.mark.parametrize("frequency", [(1.0, 2.0), (1.0, 2.0, 4.0)])
def test_smoothing_needs_three_evenly_spaced_frequencies(frequency: tuple[float, ...]) -> None:
    with pytest.raises(ParameterError, match="three or more evenly spaced"):
        ZeroPhaseSmoothing().apply(np.array(frequency), np.ones(len(frequency), dtype=complex))


def test_a_band_without_frequencies_is_refused_and_one_of_a_single_frequency_is_not() -> None:
    assert response().band(0.9, 1.1).frequency.tolist() == [1.0]
    with pytest.raises(ParameterError, match=r"no frequency between 1\.1 and 1\.9 Hz; it has 0 to 2 Hz"):
        response().band(1.1, 1.9)


TIME = np.arange(0.0, 20.0, 0.01)
COVERED = Ranges((0.2, 10.0), {"velocity": (-0.4, 0.5), "tire_force": (-900.0, 1000.0)})


def moving(velocity: float, *, fast: float = 0.0, force: float = 100.0) -> TimeSeries:
    """Return a motion at 2 Hz with a share of its power at 20 Hz [1]."""
    slow, quick = np.sin(2.0 * np.pi * 2.0 * TIME), np.sin(2.0 * np.pi * 20.0 * TIME)
    wave = np.sqrt(1.0 - fast) * slow + np.sqrt(fast) * quick
    wave = wave / np.abs(wave).max()
    return TimeSeries.from_channels(TIME, {"velocity": ("m/s", velocity * wave), "tire_force": ("N", force * slow)})


def test_what_is_beyond_the_tests_is_said_with_its_limits(unchanged: Callable[..., None]) -> None:
    said: dict[str, object] = {}
    for velocity in (0.5, 0.54, 0.56, 0.59, 0.61):
        said[f"velocity {velocity}"] = COVERED.beyond(moving(velocity, force=2400.0 * velocity))
    for share in (0.045, 0.055, 0.095, 0.105, 0.3):
        said[f"share {share}"] = COVERED.beyond(moving(0.3, fast=share))
    for velocity in (0.02, 0.024, 0.026, 0.03):
        said[f"gentle {velocity}"] = COVERED.is_gentle(moving(velocity))
    said["no frequency"] = Ranges(None, COVERED.channels).beyond(moving(0.3, fast=0.5))
    unchanged(said)
