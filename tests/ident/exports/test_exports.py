"""Tests that exports have all content, to the precision of the format, as scipy and pyuff read them."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import control
import numpy as np
import pytest
import pyuff
from click.testing import CliRunner, Result
from scipy.io import loadmat
from scipy.signal import freqresp

from eightpost.__main__ import main
from eightpost.errors import FileFormatError, InputError
from eightpost.ident.export import to_frd, write_response_mat, write_response_uff, write_vehicle_mat
from eightpost.ident.vehicle.frequency_response import FrequencyResponse, response_of, write_response
from eightpost.vehicle import (
    Channel,
    Friction,
    IdentifiedVehicle,
    StateSpace,
    discretise,
    read_vehicle,
    shipped,
    write_vehicle,
)

DAMPING = {"": 3000.0}


def vehicle(dt: float | None = None) -> IdentifiedVehicle:
    model = read_vehicle(shipped("quarter_car")).with_damper()
    model = model if dt is None else discretise(model, dt, "zero")
    extra = {"static": {"tire_force": 3300.0}, "sources": {"a.parquet": "0" * 64}}
    return IdentifiedVehicle("post 7", model, DAMPING, friction={"": Friction(60.0, 0.01)}, **extra)


def response(frequency: np.ndarray | None = None) -> FrequencyResponse:
    generator = np.random.default_rng(1)
    grid = 0.05 * np.arange(1, 41) if frequency is None else frequency
    found = response_of(read_vehicle(shipped("seven_dof")).with_damper(), grid)
    found = found.select(
        inputs=["lf.road", "roll_moment", "lf.force"], outputs=["lf.velocity", "lf.tire_force", "roll"]
    )
    variance = np.abs(found.H)
    variance[0, 0, 0] = np.inf
    shape = found.H.shape
    coherence, partial = generator.uniform(size=(shape[0], shape[2])), generator.uniform(size=shape)
    return replace(found, coherence=coherence, partial_coherence=partial, variance=variance)


def vehicle_in(path: Path) -> IdentifiedVehicle:
    """Return the vehicle in a .mat file, as scipy reads it."""
    content = loadmat(path)
    matrices = {name: content[name].tolist() for name in "ABCD"}
    copy = path.with_suffix(".json")
    copy.write_text(json.dumps(json.loads(str(content["eightpost"][0])) | matrices), encoding="utf-8")
    vehicle = read_vehicle(copy)
    assert isinstance(vehicle, IdentifiedVehicle)
    return vehicle


def functions_in(path: Path, kind: int = 4) -> dict[str, dict[str, Any]]:
    """Return the datasets 58 of a kind in a universal file by their first line, as pyuff reads them."""
    sets = pyuff.UFF(str(path)).read_sets()
    return {one["id1"].strip(): one for one in sets if one["type"] == 58 and one["func_type"] == kind}


def assert_holds(path: Path, written: FrequencyResponse, *, frequency: float) -> None:
    """Check that a universal file has every path to 12 digits, and the frequencies to a relative difference."""
    functions = functions_in(path)
    for i, output in enumerate(written.outputs):
        for j, source in enumerate(written.inputs):
            function = functions.pop(f"{output.name} / {source.name}")
            np.testing.assert_allclose(function["data"], written.H[i, j], rtol=1e-11)
            np.testing.assert_allclose(function["x"], written.frequency, rtol=frequency)
            labels = [function[f"{kind}_axis_units_lab"].strip() for kind in ("ordinate", "orddenom")]
            assert labels == [output.unit, source.unit]
    assert not functions


def export(*words: object) -> Result:
    return CliRunner().invoke(main, ["export", *[str(word) for word in words]], env={"COLUMNS": "200"})


@pytest.mark.parametrize("dt", [None, 0.008])
def test_a_vehicle_in_a_mat_file_is_bitwise_equal(tmp_path: Path, dt: float | None) -> None:
    write_vehicle_mat(tmp_path / "car.mat", vehicle(dt))
    assert vehicle_in(tmp_path / "car.mat") == vehicle(dt)


def test_a_vehicle_without_states_is_written(tmp_path: Path) -> None:
    gain = StateSpace(np.zeros((0, 0)), np.zeros((0, 1)), np.zeros((1, 0)), [[2.0]], (Channel("u", "m"),),
                      (Channel("y", "N"),))  # fmt: skip
    write_vehicle_mat(tmp_path / "gain.mat", IdentifiedVehicle("gain", gain))
    content = loadmat(tmp_path / "gain.mat")
    assert [content[name].shape for name in "ABC"] == [(0, 0), (0, 1), (1, 0)]
    assert content["D"] == [[2.0]]


def test_the_mat_file_has_the_variables_for_a_matlab_model(tmp_path: Path) -> None:
    write_vehicle_mat(tmp_path / "car.mat", vehicle())
    content = loadmat(tmp_path / "car.mat", simplify_cells=True)
    assert content["Ts"] == 0.0
    assert list(content["InputName"]) == ["road", "aero_force", "force"]
    assert list(content["InputUnit"]) == ["m", "N", "N"]
    assert content["OutputUnit"][list(content["OutputName"]).index("velocity")] == "m/s"
    model = vehicle().state_space
    omega = np.array([1.0, 20.0, 90.0])
    column = content["OutputName"].tolist().index("tire_force")
    _, H = freqresp((content["A"], content["B"][:, :1], content["C"][[column]], content["D"][[column], :1]), omega)
    expected = model.select(inputs=["road"], outputs=["tire_force"]).frequency_response(omega / (2.0 * np.pi))
    np.testing.assert_allclose(H, expected[0, 0], rtol=1e-9)


@pytest.mark.parametrize("count", [40, 1])
def test_a_response_in_a_mat_file_is_bitwise_equal(tmp_path: Path, count: int) -> None:
    written = response(0.05 * np.arange(1, count + 1))
    write_response_mat(tmp_path / "h.mat", written)
    content = loadmat(tmp_path / "h.mat")
    assert [str(name[0]) for name in content["InputName"].ravel()] == list(written.input_names)
    assert [str(name[0]) for name in content["OutputName"].ravel()] == list(written.output_names)
    np.testing.assert_array_equal(content["Frequency"][:, 0], written.frequency)
    for name in ("H", "coherence", "partial_coherence", "variance"):
        values = getattr(written, name)
        np.testing.assert_array_equal(content[name].reshape(values.shape), values)


def test_a_response_in_a_universal_file_has_twelve_digits(tmp_path: Path) -> None:
    written = response()
    write_response_uff(tmp_path / "h.uff", written)
    assert_holds(tmp_path / "h.uff", written, frequency=1e-12)
    coherence = functions_in(tmp_path / "h.uff", 6)
    for row, output in zip(written.coherence, written.output_names, strict=True):
        np.testing.assert_allclose(coherence[f"multiple coherence of {output}"]["data"], row, rtol=1e-11)


@pytest.mark.parametrize("grid", [np.geomspace(0.1, 30.0, 7), np.arange(1, 9) / 7.0])
def test_unevenly_spaced_frequencies_have_six_digits(tmp_path: Path, grid: np.ndarray) -> None:
    write_response_uff(tmp_path / "h.unv", response(grid))
    assert_holds(tmp_path / "h.unv", response(grid), frequency=5e-6)


def test_the_universal_file_has_functions_units_and_nodes(tmp_path: Path) -> None:
    write_response_uff(tmp_path / "h.uff", response())
    sets = pyuff.UFF(str(tmp_path / "h.uff")).read_sets()
    assert [each["type"] for each in sets] == [164, *[58] * 12]
    assert (sets[0]["units_code"], sets[0]["length"], sets[0]["force"]) == (1, 1.0, 1.0)
    first = sets[1]
    assert first["id1"].strip() == "lf.velocity / lf.road"
    assert (first["func_type"], first["ordinate_spec_data_type"], first["orddenom_spec_data_type"]) == (4, 11, 8)
    assert (first["abscissa_spec_data_type"], first["abscissa_axis_units_lab"].strip()) == (18, "Hz")
    moment = sets[2]
    assert (moment["orddenom_len_unit_exp"], moment["orddenom_force_unit_exp"], moment["ref_dir"]) == (1, 1, 0)
    nodes = {(each["rsp_node"], each["ref_node"]) for each in sets[1:10]}
    assert nodes == {(i, j) for i in (1, 2, 3) for j in (4, 5, 6)}
    assert {each["func_type"] for each in sets[10:]} == {6}


def test_a_response_is_converted_to_python_control() -> None:
    written = response()
    data = to_frd(written)
    assert data.input_labels == ["lf:road", "roll_moment", "lf:force"]
    assert data.output_labels == ["lf:velocity", "lf:tire_force", "roll"]
    np.testing.assert_array_equal(data.frdata, written.H)
    np.testing.assert_allclose(data.omega, 2.0 * np.pi * written.frequency, rtol=1e-15)


def test_model_and_response_agree_in_python_control() -> None:
    model = read_vehicle(shipped("quarter_car")).with_damper()
    grid = np.array([0.5, 3.0, 12.0])
    data = to_frd(response_of(model, grid))
    expected = control.frequency_response(model.to_control(), 2.0 * np.pi * grid)
    np.testing.assert_allclose(data.frdata, expected.frdata, rtol=1e-9)


def test_a_vehicle_is_converted_to_python_control_and_back() -> None:
    model = vehicle().state_space
    units = ([c.unit for c in model.inputs], [c.unit for c in model.outputs])
    assert StateSpace.from_control(model.to_control(), input_units=units[0], output_units=units[1]) == model


def test_wrong_suffixes_and_a_single_frequency_are_rejected(tmp_path: Path) -> None:
    with pytest.raises(FileFormatError, match=r"must end in \.mat"):
        write_vehicle_mat(tmp_path / "car.m", vehicle())
    with pytest.raises(FileFormatError, match=r"must end in \.uff"):
        write_response_uff(tmp_path / "h.58", response())
    with pytest.raises(InputError, match="two or more"):
        write_response_uff(tmp_path / "h.uff", response(np.array([1.0])))


def test_without_pyuff_the_message_names_the_package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "pyuff", None)
    with pytest.raises(FileFormatError, match=r'pip install "eightpost\[uff\]"'):
        write_response_uff(tmp_path / "h.uff", response())
    assert not (tmp_path / "h.uff").exists()


def test_the_command_exports_models_and_responses(tmp_path: Path) -> None:
    write_vehicle(tmp_path / "car.json", vehicle())
    write_response(tmp_path / "h.npz", response())
    done = export(tmp_path / "car.json", "-o", tmp_path / "car.mat")
    assert done.exit_code == 0, done.output
    assert "post 7, continuous, 4 states, 3 inputs" in " ".join(done.output.split())
    assert vehicle_in(tmp_path / "car.mat") == vehicle()
    done = export(tmp_path / "car.json", "-o", tmp_path / "car.uff", "--high", "10 Hz", "--step", "0.5 Hz")
    assert "responses at 20 frequencies, 0.5 to 10 Hz" in " ".join(done.output.split())
    assert_holds(tmp_path / "car.uff", response_of(vehicle().state_space, 0.5 * np.arange(1, 21)), frequency=1e-9)
    assert export(tmp_path / "h.npz", "-o", tmp_path / "h.mat").exit_code == 0
    np.testing.assert_array_equal(loadmat(tmp_path / "h.mat")["H"], response().H)


def test_the_command_removes_the_baseline_damper_on_request(tmp_path: Path) -> None:
    write_vehicle(tmp_path / "car.json", vehicle())
    assert export(tmp_path / "car.json", "--ports", "whole", "-o", tmp_path / "car.mat").exit_code == 0
    whole = vehicle_in(tmp_path / "car.mat")
    assert whole.state_space == vehicle().coupled()
    assert whole.baseline_damping == {}


def test_a_linear_export_of_a_car_with_port_springs_is_the_car_about_its_tests(tmp_path: Path) -> None:
    sprung = replace(vehicle(), friction={"": Friction(spring=3e5, mean_travel=0.02)}, validity=None)
    write_vehicle(tmp_path / "car.json", sprung)
    assert export(tmp_path / "car.json", "--ports", "whole", "-o", tmp_path / "car.mat").exit_code == 0
    assert vehicle_in(tmp_path / "car.mat").state_space == vehicle().coupled()
    assert sprung.coupled() != vehicle().coupled()


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["-o", "car.csv"], "the output must be a .mat, .uff or .unv file"),
        (["-o", "car.uff", "--step", "0 Hz"], "give 0 < step < high"),
    ],
)
def test_the_command_rejects_what_it_cannot_write(tmp_path: Path, words: list[str], message: str) -> None:
    done = export(shipped("quarter_car"), *[tmp_path / w if w.startswith("car") else w for w in words])
    assert done.exit_code == 2
    assert message in done.output
