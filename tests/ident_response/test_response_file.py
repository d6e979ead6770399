"""Frequency responses, their files, their errors, and their residual fits and smoothing."""

import json
import zipfile
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from eightpost.drivefile import Settings
from eightpost.errors import FileFormatError, InputError, MissingChannelError, ParameterError, TooShortError
from eightpost.ident.grey_box.output_error import Parameter
from eightpost.ident.linearity import Thresholds
from eightpost.ident.vehicle.common_pole_fit import CommonPoleFit
from eightpost.ident.vehicle.estimators import H1, LocalPolynomial, SameDrive, estimate_response
from eightpost.ident.vehicle.experiment import Blocks, CoherentBand, Ranges
from eightpost.ident.vehicle.frequency_response import (
    FrequencyResponse,
    HighResidual,
    Preconditioning,
    ZeroPhaseSmoothing,
    contribution_error,
    read_response,
    write_response,
)
from eightpost.ident.vehicle.siso_models import BandWeights, RationalFit, TransferFunction
from eightpost.ident.vehicle.variants import frequencies_to
from eightpost.signals import TimeSeries
from eightpost.vehicle import Channel


def _response():
    generator = np.random.default_rng(1)
    H = generator.normal(size=(2, 3, 5)) + 1j * generator.normal(size=(2, 3, 5))
    variance = np.abs(H)
    variance[0, 0, 0] = np.inf
    inputs = (Channel("lf.road", "m"), Channel("heave_force", "N"), Channel("lf.force", "N"))
    outputs = (Channel("lf.velocity", "m/s"), Channel("lf.tire_force", "N"))
    return FrequencyResponse(np.arange(1.0, 6.0), H, inputs, outputs, np.full((2, 5), 0.5), None, variance)


def _record(samples=1000, rate=100.0):
    values = np.random.default_rng(2).normal(size=(3, samples))
    return TimeSeries(np.arange(samples) / rate, values, ("u", "v", "y"), ("m", "m", "N"))


def test_a_response_that_is_read_back_is_bitwise_equal(tmp_path):
    response = _response()
    write_response(tmp_path / "h.npz", response, sources={"a.csv": "0" * 64})
    again = read_response(tmp_path / "h.npz")
    assert again.inputs == response.inputs
    assert again.outputs == response.outputs
    assert again.partial_coherence is None
    for name in ("frequency", "H", "coherence", "variance"):
        np.testing.assert_array_equal(getattr(again, name), getattr(response, name))


def test_a_file_of_a_newer_schema_is_rejected(tmp_path):
    write_response(tmp_path / "h.npz", _response())
    with np.load(tmp_path / "h.npz") as content:
        members = {name: content[name] for name in content.files}
    header = json.loads(str(members["header"])) | {"schema": 99}
    np.savez(tmp_path / "h.npz", **(members | {"header": np.array(json.dumps(header))}))
    with pytest.raises(FileFormatError, match="schema 99"):
        read_response(tmp_path / "h.npz")


def test_an_array_whose_header_numpy_writes_in_another_format_is_rejected(tmp_path):
    with zipfile.ZipFile(tmp_path / "h.npz", "w") as archive, archive.open("H.npy", "w") as member:
        np.lib.format.write_array(member, np.zeros(3), version=(2, 0))
    with pytest.raises(FileFormatError, match=r"an array has another format than 1\.0"):
        read_response(tmp_path / "h.npz")


@pytest.mark.parametrize("content", [b"", b"no zip at all", b"PK\x03\x04broken"])
def test_another_file_is_rejected_with_its_name(tmp_path, content):
    (tmp_path / "h.npz").write_bytes(content)
    with pytest.raises(FileFormatError, match=r"h\.npz"):
        read_response(tmp_path / "h.npz")


def test_channels_are_selected_by_name_in_the_given_order():
    chosen = _response().select(inputs=["lf.force", "lf.road"], outputs=["lf.tire_force"])
    assert chosen.input_names == ("lf.force", "lf.road")
    np.testing.assert_array_equal(chosen.between("lf.tire_force", "lf.road"), _response().H[1, 0])
    with pytest.raises(ParameterError, match=r"unknown input 'rf\.road'; the inputs are"):
        _response().select(inputs=["rf.road"])


def test_unusable_records_are_rejected_with_the_reason():
    blocks, both = Blocks(1.0), {"inputs": ["u", "v"], "outputs": ["y"]}
    with pytest.raises(MissingChannelError, match="w"):
        estimate_response([_record()], inputs=["w"], outputs=["y"], recipe=H1(blocks))
    with pytest.raises(InputError, match="resample to one rate"):
        estimate_response([_record(), _record(rate=50.0)], recipe=H1(blocks), **both)
    with pytest.raises(TooShortError, match="use shorter blocks"):
        estimate_response([_record(50)], recipe=H1(blocks), **both)
    with pytest.raises(InputError, match="too few for 2 inputs"):
        estimate_response([_record(150)], recipe=H1(blocks), **both)
    with pytest.raises(TooShortError, match="longer records"):
        estimate_response([_record(20)], recipe=LocalPolynomial(), **both)
    with pytest.raises(InputError, match="1 forces need 2"):
        estimate_response([_record()], recipe=SameDrive(H1(blocks), ("v",)), **both)


# ---- Residual fits and smoothing -------------------------------------------------------------------------------------

F = np.arange(0.05, 40.0, 0.05)


def test_the_high_residual_continues_slope_and_phase_of_its_control_points():
    law = 7.0 * np.exp(0.5j) / F**2
    spoiled = np.where(F > 20.001, law * (1.0 + 0.5 * np.sin(20.0 * F)), law)
    spoiled[np.argmin(np.abs(F - 30.0))] = law[np.argmin(np.abs(F - 30.0))]
    treated = HighResidual(20.0, 30.0).apply(F, spoiled)
    np.testing.assert_allclose(treated, law, rtol=1e-9)


def test_smoothing_removes_narrow_ripple_without_a_shift_in_frequency():
    smooth = np.exp(-((F - 10.0) ** 2) / 50.0) * np.exp(-0.1j * F)
    ripple = 1.0 + 0.05 * np.sin(2.0 * np.pi * F / 0.2)
    treated = ZeroPhaseSmoothing().apply(F, smooth * ripple)
    inside = (F > 2.0) & (F < 38.0)
    assert np.abs(treated / smooth - 1.0)[inside].max() < 0.002


@pytest.mark.parametrize("width", [1.0, 0.0])
def test_a_preconditioned_response_is_the_kept_one(width, unchanged):
    """Two outputs, the second of which is lost from 9 Hz on, and again in a band before that."""
    generator = np.random.default_rng(1)
    H = np.stack([100.0 / (2.0 + 2j * np.pi * F) ** 2, np.exp(-0.1j * F) / (1.0 + F)])[:, None]
    lost = (F > 9.0) | ((F > 3.0) & (F < 3.4))
    partial = np.stack([np.full(F.size, 0.99), np.where(lost, 0.02, 0.9)])[:, None]
    H[1, 0, lost] *= 2.0 * np.exp(2j * np.pi * generator.random(lost.sum()))
    channels = (Channel("u", "N"),), (Channel("y", "m"), Channel("z", "m"))
    found, notes = Preconditioning(width=width).apply(FrequencyResponse(F, H, *channels, None, partial))
    unchanged({"y": found.H[0], "z": found.H[1], "at": found.H[:, 0, ::100], "notes": notes})
    unchanged(contribution_error(found, FrequencyResponse(F, H, *channels), np.ones((1, F.size))), "errors")


@pytest.mark.parametrize(("coherence", "partial"), [(0.5, False), (0.0, True)])
def test_a_path_of_unknown_coherence_or_without_a_threshold_is_not_extrapolated(coherence, partial):
    path = np.exp(-0.1j * F) / (1.0 + F)
    known = np.full((1, 1, F.size), 0.01) if partial else None
    response = FrequencyResponse(F, path[None, None], (Channel("u", "N"),), (Channel("y", "m"),), None, known)
    found, notes = Preconditioning(coherence=coherence, width=0.0).apply(response)
    np.testing.assert_array_equal(found.H[0, 0], path)
    assert notes == ()


def test_the_residual_and_the_smoothing_of_a_path_are_the_kept_ones(unchanged):
    path = 7.0 * np.exp(0.5j * F) / (1.0 + F**2) * (1.0 + 0.2 * np.sin(5.0 * F))
    unchanged({"residual": HighResidual(20.0, 30.0).apply(F, path), "smooth": ZeroPhaseSmoothing().apply(F, path)})


def test_control_points_outside_the_response_are_rejected():
    with pytest.raises(ParameterError, match="control points"):
        HighResidual(20.0, 50.0).apply(F, np.ones(F.size, dtype=complex))


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
