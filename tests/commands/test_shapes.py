"""`eightpost shapes` and `eightpost whatif`: files, claims on the console, and exit codes."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from click.testing import CliRunner

from cosim.components.component import Variable
from cosim.study import Build, StudyResult
from eightpost.__main__ import main
from eightpost.api.shapes import change_of
from eightpost.errors import InputError
from eightpost.shock import read_shock

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"

TEXT = """
schema = 1
families = ["numbers"]
settling = "1 s"
baseline = "B/B"
alike = [["lf", "rf", "lr", "rr"]]

[vehicle]
fmu = "{car}"
means = "trusted"

[bank]
"B/B" = "{bank}/B_B.json"
"C/C" = "{bank}/C_C.json"

[[drive]]
file = "{track}"
stop = "2.5 s"

[[objective]]
measure = "grip number"
"""


@pytest.mark.parametrize(("arguments", "message"), [
    (["--vary", "rebound.kne"], "a shape has no number 'rebound.kne'; its numbers are compression.bleed"),
    (["--limit", "rebound.knee=6 in/s,1 in/s"], "the lower one, 0.1524 m/s, must be below 0.0254 m/s"),
    (["--limit", "lag=1 ms,2 ms"], "limits of lag, which does not vary"),
    (["--limit", "rebound.knee=6 in/s"], "write NUMBER=LOW,HIGH"),
])  # fmt: skip
def test_wrong_numbers_and_limits_are_refused_before_anything_is_built(arguments, message, tmp_path):
    done = CliRunner().invoke(main, ["study", "shapes", str(EXAMPLES / "study.toml"), "-o", str(tmp_path), *arguments])
    assert done.exit_code == 2 and message in done.output.replace("\n", " ")
    assert not list(tmp_path.iterdir())


def test_ctrl_c_ends_the_search_with_what_is_kept_and_exit_code_1(fmus, tmp_path, monkeypatch):
    def interrupted(*_args):
        raise KeyboardInterrupt

    monkeypatch.setattr("eightpost.api.study_folder.StudyFolder.shapes", interrupted)
    text = TEXT.format(car=fmus["seven_dof"], bank=EXAMPLES / "bank", track=EXAMPLES / "data" / "track.parquet")
    for shock in ("B_B", "C_C"):
        text = text.replace(f"{EXAMPLES / 'bank'}/{shock}.json", str(fmus["lpnl2"]))
    (tmp_path / "study.toml").write_text(text)
    done = CliRunner().invoke(main, ["study", "shapes", str(tmp_path / "study.toml"), "-o", str(tmp_path / "out")])
    assert done.exit_code == 1 and "Traceback" not in done.output
    assert "completed runs of the bank are kept, those of the search are not; run the command again" in " ".join(
        done.output.split()
    )
    assert not (tmp_path / "out" / "shapes.html").exists()


@pytest.mark.nightly
def test_target_curves_are_found_verified_and_written_and_a_click_changes_the_measures(fmus, tmp_path):
    path, out = tmp_path / "study.toml", tmp_path / "out"
    track = EXAMPLES / "data" / "track.parquet"
    path.write_text(TEXT.format(car=fmus["seven_dof"], bank=EXAMPLES / "bank", track=track))
    options = ["shapes", str(path), "-o", str(out), "--workers", "1", "--draws", "2", "--starts", "1",
               "--vary", "rebound.low", "--limit", "rebound.low=10 lbf.s/in,60 lbf.s/in"]  # fmt: skip
    done = CliRunner().invoke(main, ["-v", *options])
    assert done.exit_code in (0, 1), done.output
    content = json.loads((out / "shapes.json").read_text())
    objective, (target,) = content["objective"], content["targets"]
    # The FMU of its own: the machine solves the ports around the damping of the bank, which has the targets in it now.
    assert objective["targets"] == pytest.approx(objective["targets_in_search"], rel=1e-6)
    assert (done.exit_code == 0) == (objective["targets"] < objective["best_of_bank"])
    low, high = content["ranges"]["rebound.low"]
    assert low <= target["numbers"]["rebound.low"] <= high == pytest.approx(60.0 * 175.1268, rel=1e-4)
    assert {one["build"] for one in target["builds"]} == {"B/B", "C/C"}
    assert target["valving"]["relative"] < 0.1
    own = read_shock(out / "shapes" / "lf+rf+lr+rr.json").law.curve
    forces = [own.force(v) for v in target["velocity [m/s]"]]
    bands = zip(target["lowest_force [N]"], forces, target["highest_force [N]"], strict=True)
    assert all(least - 1e-9 <= force <= most + 1e-9 for least, force, most in bands)
    shown = " ".join(done.output.split())
    for expected in ("Target at lf+rf+lr+rr", "virtual damper", "shapes.html"):
        assert expected in shown
    gain = content["gain"]
    assert gain["assured"] <= gain["predicted"] + 1e-9 and not gain["includes_car"]  # stated masses: no uncertainty
    assert "The vehicle states no uncertainty" in shown and "stated for no measure" in shown
    study, aim = (out / name for name in ("report.html", "shapes.html"))
    assert 'href="shapes.html"' in study.read_text() and 'href="report.html"' in aim.read_text()

    assert StudyResult.load(out / "results.parquet").done.all()  # of the bank, for the other commands
    asked = CliRunner().invoke(main, ["-v", "study", "whatif", str(out), "--at", "lr", "--rebound", "+1"])
    assert asked.exit_code == 0 and "lr: rebound slope at low speeds +5 %" in asked.output
    assert "grip number" in asked.output
    for arguments, message in ((["--at", "lr"], "nothing changes"), (["--at", "front", "--rebound", "1"], "no corner")):
        wrong = CliRunner().invoke(main, ["study", "whatif", str(out), *arguments])
        assert wrong.exit_code == 2 and message in wrong.output


def test_a_shock_with_an_adjuster_is_turned_by_its_clicks_within_its_stops():
    build = Build(Path("shock.fmu"), {"clicks.rebound": 12.0})
    variables = {"clicks.rebound": Variable("clicks.rebound", "parameter", start=10.0, minimum=0.0, maximum=14.0)}
    before, after, words = change_of(build, variables, {"rebound": 2.0}, share=0.05, speeds="low")
    assert (before, after) == ({}, {"clicks.rebound": 14.0}) and words == "clicks.rebound from 12 to 14"
    with pytest.raises(InputError, match=r"would be 15, beyond its stops 0 to 14"):
        change_of(build, variables, {"rebound": 3.0}, share=0.05, speeds="low")
    with pytest.raises(InputError, match="neither an adjuster"):
        change_of(build, variables, {"compression": 1.0}, share=0.05, speeds="low")
