"""Every kind of bad input ends a command with exit code 2, a message that names the place, and no output."""

import zipfile

import fmpy
import numpy as np
import pytest
from click.testing import CliRunner

from eightpost.__main__ import main
from eightpost.archive import read_archive, write_archive

HEADER = "Time [s],Position [in],Velocity [in/s],Force [lbf]"


def samples():
    """Two seconds of a 3 Hz sine on a damper of 20 lbf/(in/s), at 500 Hz."""
    time = np.arange(0.0, 2.0, 0.002)
    velocity = 10.0 * np.sin(2 * np.pi * 3 * time)
    position = -10.0 / (2 * np.pi * 3) * np.cos(2 * np.pi * 3 * time)
    return np.stack([time, position, velocity, 20.0 * velocity], axis=1)


def csv(rows, header=HEADER):
    return "\n".join([header, *(",".join(f"{value:.6g}" for value in row) for row in rows)]) + "\n"


def with_cell(row, column, text):
    lines = csv(samples()).splitlines()
    cells = lines[row].split(",")
    cells[column] = text
    lines[row] = ",".join(cells)
    return "\n".join(lines) + "\n"


def changed(column, change):
    rows = samples()
    rows[:, column] = change(rows[:, column])
    return csv(rows)


#: One fault of each kind; tests/rig/test_dyno_faults.py and tests/signals/test_faults.py have the others.
FAULTS = {
    "missing unit": csv(samples(), HEADER.replace(" [lbf]", "")), "text in a cell": with_cell(100, 3, "oops"),
    "wrong sign": changed(3, lambda force: -force), "not a table": "hello\nworld\n",
}  # fmt: skip


@pytest.fixture
def refused(tmp_path, monkeypatch):
    """Run a command, which must exit with 2 and write no file; return what it prints."""
    monkeypatch.chdir(tmp_path)

    def run(*words):
        before = {path for path in tmp_path.rglob("*") if path.is_file()}
        shown = CliRunner().invoke(main, [str(word) for word in words])
        assert shown.exit_code == 2, shown.output
        assert {path for path in tmp_path.rglob("*") if path.is_file()} == before
        return " ".join(shown.output.split())

    return run


def test_a_faulty_record_is_refused(refused, tmp_path, unchanged):
    found = {}
    for fault, text in FAULTS.items():
        (tmp_path / "bad.csv").write_text(text)
        found[fault] = refused("fit", "bad.csv", "-o", "shock.json")
    (tmp_path / "good.csv").write_text(csv(samples()))
    unchanged(found | {"another unit": refused("fit", "good.csv", "--units", "force=N")})


def test_the_record_without_a_fault_is_accepted(tmp_path):
    """Without this, the test above could pass for any reason."""
    (tmp_path / "good.csv").write_text(csv(samples()))
    shown = CliRunner().invoke(
        main, ["fit", str(tmp_path / "good.csv"), "--law", "lpf1", "-o", str(tmp_path / "s.json")]
    )
    assert shown.exit_code in (0, 1), shown.output
    assert "held out" in shown.output
    assert (tmp_path / "s.json").is_file()


def zip_with(path, *names):
    with zipfile.ZipFile(path, "w") as archive:
        for name in names:
            archive.writestr(name, "x")


def foreign(source, path):
    kept = {n: data for n, data in read_archive(source).items() if not n.startswith(f"binaries/{fmpy.platform}/")}
    write_archive(path, kept)


BAD_FMUS = {
    "broken zip": (lambda path, source: path.write_bytes(source.read_bytes()[:5000]), "not a readable zip"),
    "no FMU": (lambda path, _: zip_with(path, "readme.txt"), "modelDescription.xml"),
    "another platform": (lambda path, source: foreign(source, path), "no binary for this platform"),
}


@pytest.mark.parametrize("kind", BAD_FMUS)
def test_a_bad_fmu_in_a_system_is_refused(refused, tmp_path, fmus, kind):
    make, expected = BAD_FMUS[kind]
    make(tmp_path / "shock.fmu", fmus["lpnl2"])
    values = {"car": fmus["quarter_car"], "shock": "shock.fmu", "inputs": INPUTS, "more": "", "scenario": ""}
    (tmp_path / "case.toml").write_text(SYSTEM.format(**values))
    found = refused("run", "case.toml", "-o", "out")
    assert "shock.fmu" in found and expected in found


SYSTEM = """
[components.car]
fmu = "{car}"
{inputs}
[components.shock]
fmu = "{shock}"
{more}
[[bond]]
between = ["car", "shock"]
[scenario]
stop = 0.1
{scenario}
"""
INPUTS = "inputs = { road = 0, aero_force = 0 }"

BAD_SYSTEMS = {
    "unknown variable": {"more": "parameters = { stiffnes = 1 }"}, "unknown entry": {"scenario": "stopp = 1"},
    "incompatible units": {"scenario": '[[connection]]\nfrom = "shock.force"\nto = "car.road"',
                           "inputs": "inputs = { aero_force = 0 }"},
    "missing drivefile": {"scenario": 'drivefile = "none.csv"'},
    "steps that no memory holds": {"scenario": "record_step = 1e-12"},
    "a Boolean for a number": {"inputs": "inputs = { road = true, aero_force = 0 }"},
    "a drivefile with a hole": {"inputs": "inputs = { aero_force = 0 }", "scenario": 'drivefile = "road.csv"'},
}  # fmt: skip


def test_a_system_that_does_not_fit_is_refused(refused, tmp_path, fmus, unchanged):
    time = np.delete(np.arange(0.0, 2.0, 0.01), slice(50, 60))
    (tmp_path / "road.csv").write_text("t [s],road [mm]\n" + "\n".join(f"{t:.2f},0" for t in time) + "\n")
    values = {"car": fmus["quarter_car"], "shock": fmus["lpf1"], "inputs": INPUTS, "more": "", "scenario": ""}
    found = {}
    for kind, change in BAD_SYSTEMS.items():
        (tmp_path / "case.toml").write_text(SYSTEM.format(**(values | change)))
        found[kind] = refused("run", "case.toml", "-o", "out")
    unchanged(found)
