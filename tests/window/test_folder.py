"""The window's folder: where dropped files go, how they are read, and what is served."""

import json

import pytest

from eightpost.errors import InputError
from eightpost.signals import ChannelMap
from eightpost.window.folder import Folder


@pytest.fixture
def folder(tmp_path):
    return Folder.opened(tmp_path / "work")


def test_a_dropped_file_keeps_its_name_and_never_replaces_another(folder):
    first = folder.place("dyno", "run 7.csv")
    first.write_text("a")
    assert first == folder.path / "dyno" / "run 7.csv"
    assert folder.place("dyno", "run 7.csv").name == "run 7 2.csv"


@pytest.mark.parametrize("name", ["../../etc/passwd.csv", "..\\x.csv", "/x.csv", "a/b.csv", "...", "", "a\0b.csv"])
def test_a_dropped_file_stays_in_its_folder(folder, name):
    path = folder.place("rig", name)
    assert path.parent == folder.path / "rig"
    path.write_text("")


def test_only_files_of_the_folder_are_served(folder):
    (folder.path / "car.json").write_text("{}")
    (folder.path.parent / "secret.txt").write_text("no")
    (folder.path / "link").symlink_to(folder.path.parent / "secret.txt")
    assert folder.served("car.json") == folder.path / "car.json"
    for name in ("../secret.txt", "link", "dyno", "missing", str(folder.path.parent / "secret.txt")):
        assert folder.served(name) is None


def test_the_reading_of_a_record_is_kept_for_the_next_window(folder):
    record = folder.place("dyno", "a.csv")
    record.write_text("")
    assert (folder.reading(record), folder.words([record])) == ({}, [])
    folder.read_as(record, flip=["force"])
    assert folder.words([record]) == ["--channel", "force=-"]
    folder.read_as(record, map="dyno/a.map.toml")
    again = Folder.opened(folder.path)
    assert again.reading(record) == {"flip": ("force",), "channel_map": folder.path / "dyno/a.map.toml"}
    assert again.words([record]) == ["--channel", "force=-", "--channel", "dyno/a.map.toml"]


@pytest.mark.parametrize(("content", "message"), [
    ("[]", r"window.json: it must be an object, not \[\]"),
    ('{"readings": {"a.csv": {"map": ["x"]}}}', "a.csv.map: must be"),
    ('{"readings": {"a.csv": {"flip": "force"}}}', "readings.a.csv.flip: must be a list, not 'force'"),
])  # fmt: skip
def test_a_damaged_state_of_the_window_is_refused(folder, content, message):
    (folder.path / "window.json").write_text(content)
    with pytest.raises(InputError, match=message):
        Folder.opened(folder.path)


def test_records_that_are_read_in_different_ways_are_not_given_to_one_command(folder):
    records = [folder.path / "dyno" / name for name in ("a.csv", "b.csv")]
    folder.read_as(records[0], flip=["force"])
    with pytest.raises(InputError, match="one after the other"):
        folder.words(records)


def test_records_and_models_are_listed_by_their_content(folder):
    (folder.path / "dyno" / "a.csv").write_text("")
    (folder.path / "dyno" / "a.map.toml").write_text("")
    (folder.path / "shocks").mkdir()
    (folder.path / "shocks" / "a.json").write_text(json.dumps({"kind": "shock"}))
    (folder.path / "car.json").write_text(json.dumps({"kind": "vehicle"}))
    (folder.path / "broken.json").write_text("{")
    (folder.path / "my_car.toml").write_text('model = "seven_dof"')
    (folder.path / "system.toml").write_text("[components.car]")
    assert [path.name for path in folder.records("dyno")] == ["a.csv"]
    assert [path.name for path in folder.documents("shock")] == ["a.json"]
    assert [path.name for path in folder.documents("vehicle")] == ["car.json", "my_car.toml"]


def test_a_file_instead_of_a_folder_is_refused(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="name a folder"):
        Folder.opened(tmp_path / "file")


def test_the_map_that_the_window_writes_is_read_by_the_terminal(tmp_path):
    channels = pytest.importorskip("eightpost.window.channels")
    path = tmp_path / "rig_map.toml"
    channels.write_map(path, {"lf.force": 'Damper "FL" µ', "lf.road": "WL FL Pos"}, {"lf.force"})
    assert {name: (pick.source, pick.gain) for name, pick in ChannelMap.read(path).channels.items()} == {
        "lf.force": ('Damper "FL" µ', -1.0), "lf.road": ("WL FL Pos", 1.0),
    }  # fmt: skip
