"""System and study files that the window writes are those that the commands read."""

import tomllib
from pathlib import Path

import pytest

pytest.importorskip("nicegui")

from cosim.study.study_file import source_files
from eightpost.corners import CORNERS
from eightpost.window.channels import write_map
from eightpost.window.study import OBJECTIVES, _write_study
from eightpost.window.system import _write_system


def test_a_run_couples_the_chosen_shock_at_every_corner(tmp_path):
    chosen = {"name": 'a "b"', "car": "car.toml", "drive": "tracks/lap 1.csv", "stop": 3}
    chosen |= {corner: f"shocks/{corner[1]}.json" for corner in CORNERS}
    _write_system(tmp_path / "runs" / "x" / "system.toml", chosen, tmp_path)
    written = tomllib.loads((tmp_path / "runs" / "x" / "system.toml").read_text())
    assert {name: Path(entry["fmu"]).relative_to(tmp_path / "fmus").as_posix()
            for name, entry in written["components"].items()} == {
        "car": "car.fmu", "lf": "f.fmu", "rf": "f.fmu", "lr": "r.fmu", "rr": "r.fmu",
    }  # fmt: skip
    assert [bond["between"] for bond in written["bond"]] == [[f"car.{corner}", corner] for corner in CORNERS]
    assert Path(written["scenario"]["drivefile"]) == tmp_path / "tracks" / "lap 1.csv"
    assert (written["name"], written["scenario"]["stop"]) == ('a "b"', 3.0)
    assert {"car.lr.tire_force", "rr.force", "car.front.ride_height"} <= {*written["scenario"]["record"]}


def test_a_study_names_the_files_that_were_chosen(tmp_path):
    chosen = {
        "name": "s", "car": "car.toml", "drive": "tracks/track.parquet", "baseline": "shocks/A.json", "alike": True,
        "bank": ["shocks/A.json", "shocks/B.json"], "objective": next(iter(OBJECTIVES)), "stop": 5,
    }  # fmt: skip
    _write_study(tmp_path / "studies" / "s" / "study.toml", chosen, tmp_path)
    names = {path.relative_to(tmp_path).as_posix() for path in source_files(tmp_path / "studies" / "s" / "study.toml")}
    assert names == {"car.toml", "shocks/A.json", "shocks/B.json"}


def test_a_rig_record_drives_the_car_by_its_roads_and_loads(tmp_path):
    (tmp_path / "rig").mkdir()
    columns = {"lf.road": "WL FL Pos", "lf.aero": "AL FL", "lf.force": "Damper FL", "lf.tire_force": "WL FL Load"}
    write_map(tmp_path / "rig" / "rig_map.toml", columns, {"lf.force"})
    chosen = {"name": "lap", "car": "car.json", "drive": "rig/lap.csv", "stop": 3} | dict.fromkeys(CORNERS, "a.json")
    _write_system(tmp_path / "system.toml", chosen, tmp_path)
    scenario = tomllib.loads((tmp_path / "system.toml").read_text())["scenario"]
    assert scenario["targets"] == {"lf.road": "car.lf.road", "lf.aero": "car.lf.aero"}
    assert Path(scenario["channel_map"]) == tmp_path / "rig" / "rig_map.toml"
