"""Study files: content and error messages with line numbers."""

from math import inf
from pathlib import Path
from zipfile import ZipFile

import pytest

from cosim.study import Setup, Term
from cosim.study.study_file import read_study, source_files
from eightpost.corners import CORNERS
from eightpost.errors import InputError

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


def test_the_entries_of_a_file_are_read(write):
    study = read_study(write())
    assert study.space.radices == (2, 2, 1, 1) and len(study.space) == 2
    assert study.baseline_setup == Setup(3, dict.fromkeys(CORNERS, "B"))
    assert (study.settling, study.record_step, study.drives[0].stop) == (1.5, 0.002, 4.0)
    assert study.bank["B"].parameters == {
        "gas_preload": pytest.approx(50.0 * 4.4482216152605),
        "compression_scale": 0.8,
    }
    assert study.objective == (Term("grip number", 2.0, "lbf"),)
    (limits,) = study.constraints
    assert (limits.measure, limits.at_least, limits.at_most) == ("aero number", -inf, pytest.approx(0.0127))


def test_values_with_units_become_si_and_families_their_measures(write):
    study = read_study(write())
    own = study.measure("slow rebound")
    assert own.options == {"from": pytest.approx(-0.0508), "to": 0.0}
    assert (own.band, own.section) == ((0.5, 20.0), (2.0, 3.0))
    assert [m.name for m in study.measures][:4] == [
        "grip number", "aero number", "lf suspension travel, RMS", "lf suspension travel, range",
    ]  # fmt: skip


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


@pytest.mark.parametrize("percent", ["95.0", '"95 %"'])
def test_the_percent_of_a_percentile_is_a_number_of_percent(write, percent):
    study = read_study(
        write('"share"\noptions = { from = "-2 in/s", to = 0.0 }', f'"percentile"\noptions = {{ percent = {percent} }}')
    )
    assert next(m for m in study.measures if m.name == "slow rebound").options == {"percent": 95.0}


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("settling =", "setling =", r"lists the entries\); did you mean settling\?$"),
        ("settling =", "xyz =", "line 5: xyz: is not an entry of a study file"),
        ('name = "slow rebound"', "", r"measure.0.name: is missing"),
        ("band = [", "bands = [", "line 33: measure.0.bands: is not an entry"),
        ("[vehicle]", "[vehicle", "line 10"),
        ('lr = ["B"]', 'lr = ["C"]', "line 21: corners: lr allows 'C', which is not a build of the bank"),
        ('lr = ["B"]', "lr = []", "lr has no shock"),
        ('"numbers"', '"nombers"', "line 4: there is no family of measures 'nombers'"),
        ('"share"', '"sharp"', "line 31: .*no statistic 'sharp'"),
        ('"-2 in/s"', '"-2 blorps"', "unknown unit"),
        (
            'measure = "grip number"',
            'measure = "grip numbr"',
            "line 37: there is no measure 'grip numbr'; did you mean 'grip number'",
        ),
        ("compression_scale =", "compresion_scale =", "has no variable 'compresion_scale'"),
        ('baseline = "B"', 'baseline = "C"', "lf cannot have the build 'C'"),
        ('settling = "1500 ms"', "settling = 5.0", "settling is 5 s; it must be shorter"),
        ("schema = 1", "schema = 2", "this version reads schema 1"),
        ('settling = "1500 ms"', 'settling = "2 lbf"', "line 5: settling: cannot convert 'lbf' to 's': the dimensions"),
        (
            "weight = 2.0",
            "weight = nan",
            "line 37: objective: the weight of 'grip number' is nan; give a finite number",
        ),
        ('at_most = "0.5 in"', "at_most = nan", "constraint of 'aero number': at_least is -inf and at_most nan"),
        ('at_most = "0.5 in"', "at_most = 1.0\nat_least = 2.0", "so no setup can meet it"),
        ('"-2 in/s"', '"-2 in"', "measure 'slow rebound', from: cannot convert 'in' to 'm/s'"),
        ('at_most = "0.5 in"', 'at_most = "0.5 g"', "constraint 'aero number': cannot convert 'g' to 'm'"),
    ],
)
def test_error_messages_state_the_line(write, old, new, message):
    with pytest.raises(InputError, match=message):
        read_study(write(old, new))


@pytest.mark.parametrize(("old", "new", "message"), [
    ('A = "{shock}"', 'A = "{car}"', "study.toml, line 15: bank: 'A', .*is no shock: it has no velocity; name a shock"),
    ('A = "{shock}"', 'A = "quarter_car"', "line 15: bank: 'A', .*is no shock: its velocity is of causality output"),
    ('A = "{shock}"', 'A = {{ fmu = "{shock}", parameters = {{ lag_zero_force = -1.0 }} }}',
     "line 15: bank: 'A', .*cannot be coupled with .*seven_dof.fmu: .*lag_zero_force = -1.*outside its range"),
    ('fmu = "{car}"', 'fmu = "{shock}"', "vehicle.fmu: .*has no port for a shock.*; name a vehicle file"),
])  # fmt: skip
def test_a_bank_that_does_not_fit_the_car_is_refused_when_the_file_is_read(write, fmus, old, new, message):
    text = TEXT[: TEXT.index("[corners]")] + TEXT[TEXT.index("[[drive]]") :]
    assert text.count(old) == 1
    with pytest.raises(InputError, match=message):
        read_study(write(text=text.replace(old, new.replace("quarter_car", str(fmus["quarter_car"])))))


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


@pytest.mark.parametrize(("old", "new", "message"), [
    ("seven_dof", "quarter_car", "corners: the vehicle has no port 'lf'; .*quarter_car.fmu has the port 'corner' only"),
    ('rr = ["B"]', "", "corners: rr has no shock; .*has ports at lf, rf, lr, rr. Name the builds allowed at rr"),
    ('rr = ["B"]', 'rr = ["B"]\nmiddle = ["B"]', "line 23: corners: the vehicle has no port 'middle'; .*lf, rf, lr"),
])  # fmt: skip
def test_corners_that_are_not_those_of_the_car_are_refused_when_the_file_is_read(write, old, new, message):
    with pytest.raises(InputError, match=message):
        read_study(write(old, new))


def test_a_missing_file_is_reported(tmp_path):
    with pytest.raises(InputError, match="no such file"):
        read_study(tmp_path / "none.toml")


def test_the_shipped_study_is_read_with_all_its_files_and_has_2401_setups(fmus):
    path = EXAMPLES / "study.toml"
    assert len(source_files(path)) == 8 and all(source.is_file() for source in source_files(path))
    study = read_study(path, lambda source: fmus["seven_dof" if source.suffix == ".toml" else "lpnl2"])
    assert len(study.space) == 2401 and study.vehicle.means_trusted
    assert study.baseline_setup.builds == dict.fromkeys(CORNERS, "B/B")
