"""A shock file of a law of earlier versions is refused: which file, which law, and the command that fits it again."""

import json
from pathlib import Path

import pytest
from click.testing import CliRunner

from eightpost.__main__ import main
from eightpost.errors import ParameterError
from eightpost.shock import LAWS, read_shock
from eightpost.shock.laws import FORMER

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
    [
        ({}, "fit slow.csv fast.csv"),
        ({"inputs": []}, "fit RECORD"),
        ({"inputs": [{"sha256": "0"}]}, "fit RECORD"),
        ({"settings": {"axes": []}}, "settings TABLE"),
    ],
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
    "words",
    [
        ("build", "old.json"),
        ("export", "old.json", "-o", "table.csv"),
        ("report", "old.json", "-o", "report.html"),
        ("rig", "--shock", "old.json", "-o", "rig.csv"),
        ("study", "study.toml", "-o", "out"),
        ("validate", "old.json", "record.csv"),
    ],
    ids=lambda words: words[0],
)
def test_verbs_that_read_the_file_end_with_the_message_and_code_2(old, words):
    (old.parent / "study.toml").write_text(STUDY)
    (old.parent / "record.csv").write_text("time [s],velocity [m/s],force [N]\n0,0,0\n")
    found = CliRunner().invoke(main, list(words))
    assert found.exit_code == 2
    assert "old.json: the law Maxwell is no longer supported; fit the record again" in " ".join(found.output.split())


@pytest.mark.parametrize("file", ["dyno.csv", "table.toml"])
def test_the_option_says_so_too_and_lists_the_laws(old, file):
    (old.parent / file).write_text("")
    found = CliRunner().invoke(main, ["fit", file, "--law", "maxwell"])
    assert found.exit_code == 2
    assert "'--law': the law Maxwell is no longer supported; choose from " in found.output
    assert found.output.rstrip().endswith(", ".join(LAWS))
    other = CliRunner().invoke(main, ["fit", file, "--law", "magic"])
    assert other.exit_code == 2 and "no longer" not in other.output and "hysteresis" in other.output
