"""Commands from a study to the rig day and back; the rig is the virtual one, with the study's shocks."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from cosim.study.choice.assess import Knowledge, certainty_of
from cosim.study.choice.certainty import Effect, read_certainty, write_certainty
from cosim.study.choice.compare import read_run_to_run
from cosim.study.choice.rig_day import read_run_list, select, write_selection
from cosim.study.running.sweep import run_study
from cosim.study.table import StudyResult
from eightpost.__main__ import main
from eightpost.api.study_folder import StudyFolder
from eightpost.corners import CORNERS
from eightpost.errors import FileFormatError
from eightpost.progress import Listener
from eightpost.rig import RigTest, read_rig_test
from eightpost.signals import Drivefile
from eightpost.uncertainty import TOTAL, MeasureUncertainty
from eightpost.validity import ModelUncertainty, Validity
from eightpost.verdict import Verdict
from eightpost.virtual import NO_DRIFT, Actuators, RigSensors, run_test, seven_dof_truth

from .coupled import SCALES, TRACK, InProcess, study

#: Outputs of the tire forces.
TIRES = tuple(f"{corner}.tire_force" for corner in CORNERS)


def eightpost(*words: object):
    return CliRunner(env={"COLUMNS": "200"}).invoke(main, [str(word) for word in words])


@pytest.fixture(scope="module")
def folder(fmus, tmp_path_factory):
    """Folder of a study of 25 setups, with a selection of four."""
    path = tmp_path_factory.mktemp("studied")
    result = run_study(study(fmus), path, InProcess())
    write_selection(select(result, ["total tire force"], total=4), result, path / "selection.csv")
    return path


@pytest.fixture(scope="module")
def measured(folder, shocks):
    """Records of the selected setups and two runs of the baseline on the virtual rig with the same laws."""
    result = StudyResult.load(folder / "results.parquet")
    listed = read_run_list(folder / "selection.csv", result.study)
    runs = (*listed[:4], *listed[-2:])
    track = Drivefile.read(TRACK).series.window(0.0, 5.0)
    law = shocks["lpnl2"].law
    bank = {}
    for build, (compression, rebound) in SCALES.items():
        bank[build] = replace(law, port=replace(law.port, compression_scale=compression, rebound_scale=rebound))
    for seed, run in enumerate(runs):
        builds = result.study.space.setup(run.setup).builds.values()
        sensors = RigSensors.perfect(relative=0.01)
        test = run_test(
            seven_dof_truth(),
            Drivefile(track),
            [bank[b] for b in builds],
            seed=seed,
            sensors=sensors,
            drift=NO_DRIFT,
            actuators=Actuators(wheelloader=600.0, aeroloader=600.0),
        )
        test.write(run.file)
    return runs


def test_the_table_of_terms_never_replaces_the_results_that_it_is_made_from(folder):
    before = (folder / "results.parquet").read_bytes()
    shown = eightpost("study", "sensitivity", folder, "-o", folder / "results.parquet")
    assert shown.exit_code == 2 and "results.parquet is an input of this command" in " ".join(shown.stderr.split())
    assert (folder / "results.parquet").read_bytes() == before


@pytest.mark.nightly
def test_measured_levels_agree_with_predicted_ones(folder, measured):
    shown = eightpost("-v", "study", "compare", folder, "--measured", folder, "--level", 2)
    assert shown.exit_code == 0, shown.output
    text = " ".join(shown.output.split())
    assert "6 runs of 5 setups" in text
    assert "Usable: the study ranks setups as the rig does" in text
    assert "run_05.parquet" in text  # not measured yet
    document = json.loads((folder / "compared" / "comparison.json").read_text())
    assert document["verdict"]["grade"] == "usable"
    found = document["measures"]
    assert {one["measure"] for one in found} == {"total tire force", "front ride height"}
    for one in found:
        assert one["spearman"] == pytest.approx(1.0)
        assert abs(one["bias_percent"]) < 1.0
        assert one["judged"] == 0  # the study has no certainty
    assert (folder / "compared" / "comparison.png").stat().st_size > 10_000


@pytest.fixture
def tires_only(folder, measured, tmp_path) -> Path:
    """Return a list of the records, which have tire forces only."""
    for run in measured:
        series = read_rig_test(run.file).series
        RigTest(series.select(list(TIRES))).write(tmp_path / run.file.name)
    path = tmp_path / "tires.csv"
    path.write_text("file,setup\n" + "".join(f"{run.file.name},{run.setup}\n" for run in measured))
    return path


@pytest.mark.nightly
def test_records_need_only_the_channels_of_the_measures(folder, sure, tires_only, pages):
    compared = eightpost("study", "compare", sure, "--measured", tires_only)
    confirmed = eightpost("study", "confirm", sure, tires_only)
    for shown in (compared, confirmed):
        text = " ".join(shown.output.split())
        assert shown.exit_code == 0, text
        assert "without front ride height, because the records lack front.ride_height" in text
        assert "sign and corner of lf.tire_force, rf.tire_force" in text and text.count("were not checked") == 1
    found = json.loads((sure / "compared" / "comparison.json").read_text())["measures"]
    assert [one["measure"] for one in found] == ["total tire force"]
    assert all(set(run.values) == {"total tire force"} for run in read_certainty(sure / "certainty.parquet").runs)


@pytest.fixture
def pages(monkeypatch) -> list[tuple]:
    """Return the list of calls that write a page, which takes long and is tested elsewhere."""
    calls: list[tuple] = []
    monkeypatch.setattr(StudyFolder, "write_page", lambda *given, **_options: calls.append(given))
    return calls


@pytest.mark.nightly
def test_robust_takes_the_entries_of_the_file_and_checks_the_linear_effects(folder, tmp_path, pages):
    path = tmp_path / "uncertain.toml"
    path.write_text(
        """schema = 1
run_to_run = { "total tire force" = "0.1 lbf" }
[[uncertain]]
part = "stiff"
parameters = { compression_scale = { value = 2.0, deviation = 0.02 } }
"""
    )
    shown = eightpost("-v", "study", "robust", folder, path, "--top", 4, "--draws", 8, "--workers", 1)
    assert shown.exit_code == 0, shown.output
    text = " ".join(shown.output.split())
    assert "stiff: compression_scale 2 ± 0.02" in text
    assert "linear effects against 8 simulated draws" in text
    assert "how sure this is, is not known" in text  # the car states no uncertainty
    found = read_certainty(folder / "certainty.parquet")
    assert {(one.part, one.parameter) for one in found.effects} == {("stiff", "compression_scale")}
    assert found.levels["total tire force"].run_to_run == pytest.approx(0.1 * 4.4482216)
    assert (folder / "robust.parquet").is_file() and len(pages) == 1


@pytest.fixture
def sure(folder, tmp_path) -> Path:
    """Return a copy of the study's folder, whose car states its uncertainty, with a certainty."""
    result = StudyResult.load(folder / "results.parquet")
    stated = {name: MeasureUncertainty(0.02, 0.2) for name in (TOTAL, "front.ride_height", *TIRES)}
    validity = Validity(Verdict([]), (), ModelUncertainty(measures=stated)).to_json()
    models = {**result.provenance.models, str(result.study.vehicle.fmu): validity}
    result = replace(result, provenance=replace(result.provenance, models=models))
    result.save(tmp_path / "results.parquet")
    exact = tuple(Effect(build, "lag", 1.0, 0.0, {}, {corner: {build: {}} for corner in CORNERS}) for build in SCALES)
    write_certainty(certainty_of(result, Knowledge(exact)), tmp_path / "certainty.parquet")
    return tmp_path


@pytest.mark.nightly
def test_compare_counts_the_levels_in_the_intervals_that_the_study_states(folder, measured, sure, pages):
    """Setups whose runs the intervals already contain are not counted."""
    judged = []
    for words in ((), ("confirm", sure, f"{measured[0].setup}={measured[0].file}")):
        assert not words or eightpost(*words).exit_code == 0
        shown = eightpost("-v", "study", "compare", sure, "--measured", folder / "selection.csv")
        assert shown.exit_code == 0, shown.output
        found = json.loads((sure / "compared" / "comparison.json").read_text())["measures"]
        assert all(one["within_interval"] == one["judged"] for one in found)
        judged.append({one["judged"] for one in found})
    assert judged == [{5}, {4}]
    assert "4 of 4" in shown.output


@pytest.mark.nightly
def test_confirm_takes_the_run_to_run_deviation_of_a_comparison(folder, measured, sure, pages):
    assert eightpost("study", "compare", sure, "--measured", folder / "selection.csv").exit_code == 0
    path = sure / "compared" / "comparison.json"
    assert all(StudyFolder(sure)._measured_noise().values())
    path.write_text(json.dumps(json.loads(path.read_text()) | {"measures": []}))  # edited: nothing is known from it
    assert StudyFolder(sure)._measured_noise() == {}
    with pytest.raises(FileFormatError, match="was edited after the comparison"):
        read_run_to_run(path)
    assert eightpost("study", "compare", sure, "--measured", folder / "selection.csv").exit_code == 0
    assert eightpost("study", "confirm", sure, f"{measured[0].setup}={measured[0].file}").exit_code == 0
    assert read_certainty(sure / "certainty.parquet").is_known


@pytest.mark.slow
def test_confirm_updates_the_certainty_with_records_of_the_virtual_rig(folder, measured, sure, pages):
    before = read_certainty(sure / "certainty.parquet")
    assert before.is_known
    shown = eightpost("study", "confirm", sure, folder / "selection.csv")
    assert shown.exit_code == 0, shown.output
    after = read_certainty(sure / "certainty.parquet")
    assert "6 new runs of 5 setups; 6 in all" in " ".join(shown.output.split())
    assert after.contradictions == () and len(after.runs) == 6 and len(pages) == 1
    for name in ("total tire force", "front ride height"):
        assert np.all(after.levels[name].half_widths[2] < before.levels[name].half_widths[2])
        assert after.levels[name].run_to_run > 0.0  # from the two runs of the baseline
    kept = read_certainty(sure / "certainty.previous.parquet")
    np.testing.assert_array_equal(kept.best, before.best)
    again = eightpost("study", "confirm", sure, f"{measured[0].setup}={measured[0].file}")
    assert f"taken into account already: {measured[0].file.name}" in again.output
    assert len(read_certainty(sure / "certainty.parquet").runs) == 6


def test_a_damaged_certainty_is_refused_and_kept_when_it_is_replaced(sure, measured, pages):
    damaged = (sure / "certainty.parquet").read_bytes()[:500]
    (sure / "certainty.parquet").write_bytes(damaged)
    shown = eightpost("study", "confirm", sure, f"{measured[0].setup}={measured[0].file}")
    text = " ".join(shown.stderr.split())
    assert shown.exit_code == 2 and "certainty.parquet: not a readable Parquet file" in text
    assert "or run `eightpost study` again and confirm the rig runs again" in text
    assert "certainty.previous.parquet" not in text  # no rig run was confirmed before
    assert (sure / "certainty.parquet").read_bytes() == damaged
    notes, listener = [], Listener()
    listener.note = notes.append
    assert StudyFolder(sure, listener=listener)._with_runs(Knowledge()) == Knowledge()
    assert "rig runs are not taken over: confirm them again" in notes[0]
    assert (sure / "certainty.replaced.parquet").read_bytes() == damaged


def test_a_damaged_certainty_can_be_replaced_by_the_previous_one_where_there_is_one(sure, measured):
    (sure / "certainty.parquet").rename(sure / "certainty.previous.parquet")
    (sure / "certainty.parquet").write_bytes(b"PAR1")
    shown = eightpost("study", "confirm", sure, f"{measured[0].setup}={measured[0].file}")
    assert "take certainty.previous.parquet instead, or run" in " ".join(shown.stderr.split())


@pytest.mark.slow
def test_wrong_rig_runs_and_lists_are_refused_with_what_to_write(
    folder, measured, sure, tires_only, tmp_path, unchanged
):
    def said(*words):
        shown = eightpost(*words)
        assert shown.exit_code == 2, shown.output
        return " ".join(shown.stderr.split())

    lists = {"absent": "file,setup\nnone.parquet,0\n", "semicolons": "file;setup\na.parquet;3\n",
             "no setup": "file,setup\na.parquet,\n"}  # fmt: skip
    for name, text in lists.items():
        (tmp_path / f"{name}.csv").write_text(text)
    (tmp_path / "uncertain.toml").write_text("schema = 1\n")
    first, lacking = f"{measured[0].setup}={measured[0].file}", ("--measure", "front ride height")
    found = {" ".join(words): said("study", "confirm", sure, *words) for words in (
        ("none.csv",), ("a.csv", "b.csv"), ("3=none.csv",), ("x=none.csv",))}  # fmt: skip
    found |= {name: said("study", "confirm", sure, tmp_path / f"{name}.csv") for name in lists if name != "absent"}
    found |= {
        "absent": said("study", "compare", folder, "--measured", tmp_path / "absent.csv"),
        "two studies": said("study", "compare", folder, folder, "--measured", folder),
        "compare tires": said("study", "compare", sure, "--measured", tires_only, *lacking),
        "confirm tires": said("study", "confirm", sure, tires_only, *lacking),
        "nothing uncertain": said("study", "robust", folder, tmp_path / "uncertain.toml"),
    }  # fmt: skip
    (sure / "certainty.parquet").unlink()
    unchanged(found | {"no certainty": said("study", "confirm", sure, first)})
