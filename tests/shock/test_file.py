"""Shock files: round trips, and errors of bad files."""

import json
import tomllib
from pathlib import Path

import pytest
from click.testing import CliRunner
from hypothesis import given
from hypothesis import strategies as st

from eightpost.__main__ import main
from eightpost.errors import FileFormatError, ParameterError
from eightpost.shock import (
    LAWS,
    Lpf1,
    Lpnl2,
    Polylinear,
    Port,
    Shock,
    StaticCurve,
    own_parameters,
    parameter_units,
    read_shock,
    write_shock,
)
from eightpost.shock.file import fitted_parameters, shock_uncertainty
from eightpost.shock.laws import FORMER

numbers = st.floats(-1e6, 1e6)
positive = st.floats(1e-6, 1e3)
curves = st.builds(
    StaticCurve,
    inner=st.tuples(*[numbers] * 15),
    compression=st.tuples(*[numbers] * 4),
    rebound=st.tuples(*[numbers] * 4),
    **{n: st.floats(1.0, 1e3) for n in ("transition_speed", "compression_speed", "rebound_speed")},
    transition_width=st.floats(1e-6, 1.0),
    compression_slope=st.floats(0.0, 1e6),
    rebound_slope=st.floats(0.0, 1e6),
)
ports = st.builds(Port, motion_ratio=positive, gas_preload=numbers, gas_stiffness=st.floats(0.0, 1e6))
laws = st.one_of(
    st.builds(Polylinear, curves, port=ports),
    st.builds(Lpf1, curves, positive, port=ports),
    st.builds(Lpnl2, curves, positive, st.floats(0.0, 1e3), st.floats(1.1e3, 1e4), port=ports),
)


@given(law=laws)
def test_a_shock_survives_its_file_to_the_last_bit(law, tmp_path_factory):
    path = tmp_path_factory.mktemp("shock") / "s.json"
    shock = Shock("build 1, 50 psi", law, {"clicks": 14}, {"rms_N": 1.0}, ({"file": "a.csv", "sha256": "0"},))
    write_shock(shock, path)
    assert read_shock(path) == shock


BAND = {"level": 0.9, "velocity [m/s]": [-1.0, 1.0], "force [N]": [-1.0, 1.0], "half_width [N]": [0.1, 0.1]}


@pytest.fixture
def document(tmp_path):
    curve = StaticCurve((1.0,) * 15, (1.0,) * 4, (1.0,) * 4, 0.4, 0.01, 1.0, 1.0, 0.0, 0.0)
    write_shock(Shock("s", Lpf1(curve, 1e-3)), tmp_path / "good.json")
    return json.loads((tmp_path / "good.json").read_text())


@pytest.mark.parametrize(
    ("change", "error", "named"),
    [
        ({"kind": "vehicle"}, FileFormatError, "not a shock file"),
        ({"schema": 99}, FileFormatError, "schema 99"),
        ({"law": "magic"}, ParameterError, "magic"),
        ({"parameters": {}}, ParameterError, "time_constant: is missing"),
        ({"parameters": {"time_constant": "fast"}}, ParameterError, "time_constant: must be a number, not 'fast'"),
        ({"parameters": {"time_constant": 1e-3, "spin": 1.0}}, ParameterError, "spin: is not an entry"),
        ({"parameters": {"time_constant": -1.0}}, ParameterError, "time_constant must be positive"),
        ({"port": {"motion_ratio": -1.0}}, ParameterError, "motion_ratio"),
        ({"curve": {}}, ParameterError, "curve.inner: is missing; .*; and 6 more$"),
        ({"port": []}, ParameterError, r"port: must be an object, not \[\]"),
        ({"parameters": 1}, FileFormatError, "parameters: must be an object, not 1"),
        (
            {"conditions": {"gas_pressure [Pa]": "high"}},
            FileFormatError,
            r"conditions.gas_pressure \[Pa\]: must be a number",
        ),
        ({"fit": {"changes": "none"}}, FileFormatError, "fit.changes: must be a list, not 'none'"),
        (
            {"fit": {"parameters": {"tau": {"value": 1.0}}}},
            FileFormatError,
            "fit.parameters.tau.standard_error: is missing",
        ),
        ({"fit": {"curve_band": BAND | {"level": 1}}}, FileFormatError, "fit.curve_band.level"),
        ({"fit": {"curve_band": BAND | {"force [N]": [0.0]}}}, ParameterError, "its lists must have one length"),
        ({"fit": {"left_out_blocks": []}}, ParameterError, r"left_out_blocks: must be an object, not \[\]"),
        ({"inputs": [{"name": 1}]}, FileFormatError, "inputs.0.name: must be a text, not 1"),
    ],
)
def test_a_bad_shock_file_is_refused_with_the_reason(document, tmp_path, change, error, named):
    path = tmp_path / "bad.json"
    path.write_text(json.dumps(document | change))
    with pytest.raises(error, match=named) as caught:
        read_shock(path)
    assert str(path) in str(caught.value)


def test_a_file_that_is_missing_or_not_json_is_refused(tmp_path):
    with pytest.raises(FileFormatError, match="no such file"):
        read_shock(tmp_path / "none.json")
    (tmp_path / "broken.json").write_text('{\n "a": 1,\n')
    with pytest.raises(FileFormatError, match="line 3"):
        read_shock(tmp_path / "broken.json")


@pytest.mark.parametrize("law", LAWS)
def test_the_units_of_a_law_are_those_of_its_fmu(law):
    path = Path(__file__).parents[2] / "fmus" / f"shock_{law}" / "interface.toml"
    variables = tomllib.loads(path.read_text(encoding="utf-8")).get("variable", [])
    expected = {v["start"]: v["unit"] for v in variables if v["causality"] == "parameter"}
    assert parameter_units(LAWS[law]) == expected
    assert set(expected) == set(own_parameters(LAWS[law]))


def test_every_law_has_a_name():
    assert list(LAWS) == ["polylinear", "lpf1", "lpnl2", "hysteresis"]


EXAMPLES = Path(__file__).parents[2] / "examples"

#: A file as version 0.2.0 wrote it.
OLD = """{
  "schema": 1, "kind": "shock", "tool": "eightpost 0.2.0", "name": "Old", "law": "maxwell",
  "parameters": {"series_stiffness": 3500000.0},
  "curve": {
    "inner": [1800.0, 60.0, -400.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 30.0],
    "compression": [1490.0, 900.0, 40.0, 5.0], "rebound": [-1400.0, -1100.0, -20.0, 3.0],
    "transition_speed": 0.381, "transition_width": 0.0127, "compression_speed": 1.2, "rebound_speed": 1.1,
    "compression_slope": 3000.0, "rebound_slope": 3500.0
  },
  "port": {"motion_ratio": 1.0, "compression_scale": 1.0, "rebound_scale": 1.0, "gas_stiffness": 0.0,
           "gas_preload": 0.0, "seal_friction": 0.0, "friction_velocity": 0.005},
  "conditions": {}, "fit": {}, "inputs": [{"name": "slow.csv", "sha256": "0"}, {"name": "fast.csv", "sha256": "1"}]
}"""
STUDY = f"""schema = 1
name = "old"
[vehicle]
fmu = "{EXAMPLES / "car.toml"}"
[bank]
old = "old.json"
[[drive]]
file = "{EXAMPLES / "data" / "track.parquet"}"
"""


@pytest.fixture
def old(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "old.json").write_text(OLD)
    return tmp_path / "old.json"


@pytest.mark.parametrize(
    ("changes", "command"),
    [({}, "fit slow.csv fast.csv"), ({"inputs": []}, "fit RECORD"), ({"settings": {"axes": []}}, "fit TABLE")],
)
def test_the_message_names_the_file_the_law_and_the_command(old, changes, command):
    old.write_text(json.dumps(json.loads(OLD) | changes))
    with pytest.raises(ParameterError) as caught:
        read_shock(old)
    assert str(caught.value) == (
        f"{old}: the law Maxwell is no longer supported; fit the record again: eightpost {command} -o {old}"
    )


def test_no_law_is_a_former_one():
    assert not set(FORMER) & set(LAWS)


@pytest.mark.parametrize(
    "words", [("build", "old.json"), ("study", "study.toml", "-o", "out")], ids=lambda words: words[0]
)
def test_verbs_that_read_the_file_end_with_the_message_and_code_2(old, words):
    (old.parent / "study.toml").write_text(STUDY)
    found = CliRunner().invoke(main, list(words))
    assert found.exit_code == 2
    assert "old.json: the law Maxwell is no longer supported; fit the record again" in " ".join(found.output.split())


def test_the_option_says_so_too_and_lists_the_laws(old):
    (old.parent / "dyno.csv").write_text("")
    found = CliRunner().invoke(main, ["fit", "dyno.csv", "--law", "maxwell"])
    assert found.exit_code == 2
    assert "'--law': the law Maxwell is no longer supported; choose from " in found.output
    assert found.output.rstrip().endswith(", ".join(LAWS))
    other = CliRunner().invoke(main, ["fit", "dyno.csv", "--law", "magic"])
    assert other.exit_code == 2 and "no longer" not in other.output and "hysteresis" in other.output


def test_what_a_shipped_shock_states(tmp_path, unchanged):
    shipped = sorted(EXAMPLES.glob("bank/*.json"))[1]
    shock = read_shock(shipped)
    uncertain, fitted = shock_uncertainty(shock), fitted_parameters(shock)
    assert uncertain is not None and fitted is not None
    write_shock(shock, tmp_path / "shock.json")
    unchanged({"summary": str(shock), "numbers": " ".join(shock.numbers), "values": fitted.values,
               "covariance": fitted.covariance, "lowest": fitted.lowest, "highest": fitted.highest,
               "held": fitted.held, "uncertainty": uncertain.parameters})  # fmt: skip
    assert (tmp_path / "shock.json").read_text() == shipped.read_text()
