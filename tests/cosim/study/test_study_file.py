"""Study files: content and error messages with line numbers."""

import json
from pathlib import Path
from zipfile import ZipFile

import pytest

from cosim.study import Setup
from cosim.study.definition import read_drive
from cosim.study.study_file import read_study, source_files
from eightpost.corners import CORNERS
from eightpost.errors import InputError
from tests.unchanged import refusals

EXAMPLES = Path(__file__).resolve().parents[3] / "examples"

TEXT = """
schema = 1
name = "small"
families = ["numbers", "travel"]
settling = "1500 ms"
record_step = 0.002
baseline = "B"
alike = [["lf", "rf"]]

[vehicle]
fmu = "{car}"
means = "trusted"

[bank]
A = "{shock}"
B = {{ fmu = "{shock}", parameters = {{ gas_preload = "50 lbf", compression_scale = 0.8 }} }}

[corners]
lf = ["A", "B"]
rf = ["A", "B"]
lr = ["B"]
rr = ["B"]

[[drive]]
file = "{track}"
stop = "4 s"

[[measure]]
name = "slow rebound"
channels = ["car.lf.velocity"]
statistic = "share"
options = {{ from = "-2 in/s", to = 0.0 }}
band = ["0.5 Hz", "20 Hz"]
section = [2.0, "3 s"]

[[objective]]
measure = "grip number"
weight = 2.0

[[constraint]]
measure = "aero number"
at_most = "0.5 in"
"""


@pytest.fixture
def write(tmp_path, fmus):
    """Return a function write(old, new) that writes the study file with a text replaced."""

    def make(old: str = "", new: str = "", text: str = TEXT) -> Path:
        filled = text.format(car=fmus["seven_dof"], shock=fmus["lpnl2"], track=EXAMPLES / "data" / "track.parquet")
        assert old in filled
        path = tmp_path / "study.toml"
        path.write_text(filled.replace(old, new, 1) if old else filled)
        return path

    return make


def test_the_entries_of_a_file_are_read(write, unchanged):
    study = read_study(write())
    assert study.space.radices == (2, 2, 1, 1) and len(study.space) == 2
    assert study.baseline_setup == Setup(3, dict.fromkeys(CORNERS, "B"))
    content = json.loads(study.to_json())
    content["measures"] = [content["measures"][0], next(m for m in content["measures"] if m["name"] == "slow rebound")]
    unchanged({name: json.dumps(value) for name, value in content.items()})


def test_without_corners_every_build_is_allowed_at_every_port(write):
    text = TEXT[: TEXT.index("[corners]")] + TEXT[TEXT.index("[[drive]]") :]
    assert read_study(write(text=text)).corners == dict.fromkeys(CORNERS, ("A", "B"))


def test_a_quarter_car_has_one_corner(write):
    text = TEXT[: TEXT.index("[corners]")] + TEXT[TEXT.index("[[drive]]") : TEXT.index("[[objective]]")]
    for old, new in (('alike = [["lf", "rf"]]', ""), ('"numbers", ', ""), ("car.lf.", "car.")):
        text = text.replace(old, new)
    study = read_study(write("seven_dof", "quarter_car", text=text))
    assert study.corners == {"corner": ("A", "B")}
    assert study.measures[0].name == "corner suspension travel, RMS"


def test_families_are_evaluated_on_each_of_several_drives(write):
    second = '[[drive]]\nname = "again"\nfile = "{track}"\nstop = 3.0\nstart = 10.0\n\n[[measure]]'
    text = TEXT.replace("[[measure]]", second, 1)
    for drive, name in (("again", "grip number"), ("track", "aero number")):
        text = text.replace(f'"{name}"', f'"{drive}: {name}"')
    study = read_study(write(text=text))
    assert "again: grip number" in {m.name for m in study.measures_of(study.drives[1])}
    assert not any(m.name.startswith("again") for m in study.measures_of(study.drives[0]))


@pytest.fixture
def lap(tmp_path):
    """Return a function lap(*omitted) that writes a rig lap with own names for roads and tire forces, and its map."""

    def make(*omitted: str) -> Path:
        columns = {"Time (s)": "t", **{f"WL {corner} Pos (mm)": 2.0 for corner in CORNERS},
                   **{f"WL {corner} Load (kN)": 3.5 for corner in CORNERS}, "lf.force (N)": 0.0, "Lap (1)": 7,
                   "heave_force (N)": 5.0, "roll_moment (N.m)": 5.0, "pitch_moment (N.m)": 5.0}  # fmt: skip
        kept = [name for name in columns if not name.startswith(omitted or ("-",))]
        rows = [",".join(str(0.01 * i if columns[n] == "t" else columns[n]) for n in kept) for i in range(501)]
        (tmp_path / "lap.csv").write_text("\n".join([",".join(kept), *rows]))
        pairs = (("Pos", "road"), ("Load", "tire_force"))
        entries = [f'[channels."{c}.{q}"]\nsource = "WL {c} {s}"\ngain = 0.5' for c in CORNERS for s, q in pairs]
        (tmp_path / "own.toml").write_text("\n".join(entries))
        return tmp_path / "lap.csv"

    return make


def on_lap(entries: str = 'channel_map = "own.toml"', text: str = TEXT) -> str:
    """Return the study file with the lap as its drive, and further entries of the drive."""
    return text.replace('file = "{track}"\nstop = "4 s"', f'file = "lap.csv"\n{entries}')


def test_the_roads_and_loads_of_a_rig_lap_drive_and_its_measured_channels_do_not(write, lap):
    lap()
    path = write(text=on_lap())
    (drive,) = read_study(path).drives
    driving = [*(f"{corner}.road" for corner in CORNERS), "heave_force", "roll_moment", "pitch_moment"]
    assert drive.targets == {name: f"car.{name}" for name in driving}
    assert drive.stop == pytest.approx(5.0)
    read = read_drive(drive)
    assert read.names == tuple(drive.targets) and read.at(1.0) == pytest.approx([1e-3] * 4 + [5.0] * 3)


def test_the_map_beside_a_lap_is_that_of_its_study_unless_the_study_names_another(write, lap):
    map_file = lap().with_name("own.toml")
    path = write(text=on_lap(""))
    missing = "has no channel for lf.road, rf.road, lr.road, rr.road, inputs of the vehicle; name their columns in the"
    with pytest.raises(InputError, match=missing):
        read_study(path)
    beside = map_file.rename(map_file.with_name("rig_map.toml"))
    (drive,) = read_study(path).drives
    assert drive.channel_map == beside and len(drive.targets) == 7
    map_file.write_text(beside.read_text().replace("gain = 0.5", "gain = -1.0"))
    (drive,) = read_study(write(text=on_lap())).drives
    assert drive.channel_map == map_file and read_drive(drive).at(1.0)[0] == pytest.approx(-2e-3)


def test_a_lap_without_a_load_says_which_inputs_need_a_channel_or_a_constant(write, lap):
    lap("roll", "pitch")
    path = write(text=on_lap())
    with pytest.raises(InputError, match=r"lap.csv has no channel for roll_moment, pitch_moment, inputs .*constants in "
                       r"inputs of \[vehicle\]. The file has: Time, WL lf Pos"):  # fmt: skip
        read_study(path)
    constants = 'means = "trusted"\ninputs = {{ roll_moment = 0.0, pitch_moment = 0.0, heave_force = 1.0 }}'
    text = on_lap(text=TEXT.replace('means = "trusted"', constants))
    (drive,) = read_study(write(text=text)).drives
    assert list(drive.targets) == [f"{corner}.road" for corner in CORNERS]


def test_units_of_measured_columns_are_not_needed_for_the_drive(write, lap):
    file = lap()
    file.write_text(file.read_text().replace(" (mm)", "").replace(" (kN)", ""))
    units = ", ".join(f'"WL {c} Pos" = "mm", "{c}.tire_force" = "kN"' for c in CORNERS)
    entries = f'channel_map = "own.toml"\nunits = {{{{ {units} }}}}'
    (drive,) = read_study(write(text=on_lap(entries))).drives
    assert read_drive(drive).at(1.0)[0] == pytest.approx(1e-3)


def test_two_columns_of_one_driving_channel_are_refused(write, lap):
    file = lap()
    file.write_text(file.read_text().replace("Lap (1)", "heave_force (N)"))
    with pytest.raises(InputError, match="the column name 'heave_force' is not unique"):
        read_study(write(text=on_lap()))


@pytest.mark.parametrize("percent", ["95.0", '"95 %"'])
def test_the_percent_of_a_percentile_is_a_number_of_percent(write, percent):
    study = read_study(
        write('"share"\noptions = { from = "-2 in/s", to = 0.0 }', f'"percentile"\noptions = {{ percent = {percent} }}')
    )
    assert next(m for m in study.measures if m.name == "slow rebound").options == {"percent": 95.0}


#: Changes of the file that are errors.
WRONG = [
    ("settling =", "setling ="), ("settling =", "xyz ="), ('name = "slow rebound"', ""), ("band = [", "bands = ["),
    ("[vehicle]", "[vehicle"), ('lr = ["B"]', 'lr = ["C"]'), ('lr = ["B"]', "lr = []"), ('"numbers"', '"nombers"'),
    ('"share"', '"sharp"'), ('"-2 in/s"', '"-2 blorps"'), ('"-2 in/s"', '"-2 in"'), ("grip number", "grip numbr"),
    ("compression_scale =", "compresion_scale ="), ('baseline = "B"', 'baseline = "C"'), ("schema = 1", "schema = 2"),
    ('settling = "1500 ms"', "settling = 5.0"), ('settling = "1500 ms"', 'settling = "2 lbf"'),
    ("weight = 2.0", "weight = nan"), ('at_most = "0.5 in"', "at_most = nan"),
    ('at_most = "0.5 in"', 'at_most = "0.5 g"'),
    ('at_most = "0.5 in"', "at_most = 1.0\nat_least = 2.0"), ("seven_dof", "quarter_car"), ('rr = ["B"]', ""),
    ('rr = ["B"]', 'rr = ["B"]\nmiddle = ["B"]'),
]  # fmt: skip


@pytest.mark.slow
def test_error_messages_state_the_line(write, tmp_path, unchanged):
    calls = {f"{old} -> {new}": lambda old=old, new=new: read_study(write(old, new)) for old, new in WRONG}
    unchanged(refusals(calls | {"no file": lambda: read_study(tmp_path / "none.toml")}))


def test_a_bank_that_does_not_fit_the_car_is_refused_when_the_file_is_read(write, fmus, unchanged):
    text = TEXT[: TEXT.index("[corners]")] + TEXT[TEXT.index("[[drive]]") :]
    scaled = 'A = {{ fmu = "{shock}", parameters = {{ lag_zero_force = -1.0 }} }}'
    changes = {
        "a car as a shock": ('A = "{shock}"', 'A = "{car}"'),
        "a quarter car as a shock": ('A = "{shock}"', f'A = "{fmus["quarter_car"]}"'),
        "a value out of its range": ('A = "{shock}"', scaled),
        "a shock as the car": ('fmu = "{car}"', 'fmu = "{shock}"'),
    }  # fmt: skip
    assert all(text.count(old) == 1 for old, _ in changes.values())
    unchanged(refusals({name: lambda change=change: read_study(write(text=text.replace(*change)))
                        for name, change in changes.items()}))  # fmt: skip


def test_a_shock_need_only_fit_the_corners_where_it_is_allowed(write, fmus, tmp_path):
    """The front of this car has no displacement of a shock, so only a shock without that input fits there."""
    for name, old, new in (("seven_dof", '"lf.displacement"', '"lf.travel"'), ("lpnl2", '"displacement"', '"travel"')):
        with ZipFile(fmus[name]) as source, ZipFile(tmp_path / f"{name}.fmu", "w") as target:
            for entry in source.namelist():
                content = source.read(entry)
                assert entry != "modelDescription.xml" or old.encode() in content
                target.writestr(entry, content.replace(old.encode(), new.encode()))
    text = TEXT.replace('B = {{ fmu = "{shock}"', f'A = "{tmp_path / "lpnl2.fmu"}"\nB = {{{{ fmu = "{{shock}}"')
    text = text.replace('A = "{shock}"', 'unused = "{shock}"').replace('alike = [["lf", "rf"]]', "")
    text = text.replace('lf = ["A", "B"]', 'lf = ["A"]').replace('baseline = "B"', "")
    text = text.replace("{car}", str(tmp_path / "seven_dof.fmu"))
    assert read_study(write(text=text)).corners["rr"] == ("B",)
    with pytest.raises(InputError, match=r"'B', .*cannot be coupled with .*displacement"):
        read_study(write(text=text.replace('lf = ["A"]', 'lf = ["B"]')))


def test_the_shipped_study_is_read_with_all_its_files_and_has_2401_setups(fmus):
    path = EXAMPLES / "study.toml"
    assert len(source_files(path)) == 8 and all(source.is_file() for source in source_files(path))
    study = read_study(path, lambda source: fmus["seven_dof" if source.suffix == ".toml" else "lpnl2"])
    assert len(study.space) == 2401 and study.vehicle.means_trusted
    assert study.baseline_setup.builds == dict.fromkeys(CORNERS, "B/B")
