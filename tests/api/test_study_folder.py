"""A study opened with its folder: what its verbs give, keep and load."""

from __future__ import annotations

from contextlib import contextmanager
from dataclasses import replace
from types import SimpleNamespace

import pytest

import eightpost as ep
from cosim.study.choice.certainty import read_certainty
from cosim.study.running import evaluator as evaluators
from eightpost.api.study_folder import CERTAINTY, RESULTS, StudyFolder
from eightpost.errors import FileFormatError, InputError
from eightpost.progress import Listener
from tests.cosim.study.constructed import cells
from tests.cosim.study.coupled import COUPLING, InProcess, study


@pytest.fixture
def few(fmus):
    """Return a study of four setups."""
    whole = study(fmus)
    builds = ("middle", "stiff")
    return replace(
        whole, bank={name: whole.bank[name] for name in builds}, corners=dict.fromkeys(whole.corners, builds)
    )


@pytest.fixture
def here(monkeypatch):
    """Run setups in this process; return the numbers of those that ran."""
    workers = InProcess()

    @contextmanager
    def pool(_self, _count=None):
        yield workers

    monkeypatch.setattr(StudyFolder, "workers", pool)
    return workers.ran


@pytest.fixture
def told():
    """Return a listener that keeps its notes."""
    listener = Listener()
    listener.notes = []
    listener.note = listener.notes.append
    return listener


def test_a_study_states_how_sure_its_choice_is_and_keeps_it(few, here, tmp_path):
    shares = []
    result = ep.study(few, tmp_path, progress=lambda done, _all: shares.append(done))
    assert result.certainty.setups.tolist() == result.setups.tolist() and len(here) == 4
    assert result.verdict.reasons[0].about == "choice"
    assert shares == sorted(shares) and shares[-1] == 1.0
    opened = StudyFolder(tmp_path)
    assert opened.certainty().ties == result.certainty.ties == read_certainty(tmp_path / CERTAINTY).ties
    assert cells(opened.result.table) == cells(result.table)
    again = ep.study(few, tmp_path, certainty=False)
    assert again.certainty is None and len(here) == 4


def test_a_certainty_of_setups_that_the_table_lacks_is_refused(few, here, tmp_path):
    result = ep.study(few, tmp_path)
    opened, digest, best = StudyFolder(tmp_path), result.provenance.digest, result.certainty.ties[0]
    assert opened._certainty_of(digest).ties == result.certainty.ties
    opened.result = SimpleNamespace(setups=result.setups[result.setups != best])
    with pytest.raises(FileFormatError, match=r"certainty.parquet: its best setups are not in results.parquet"):
        opened._certainty_of(digest)


def test_ctrl_c_while_the_certainty_is_computed_keeps_the_table(few, here, told, tmp_path, monkeypatch):
    def interrupted(*_given):
        raise KeyboardInterrupt

    monkeypatch.setattr(StudyFolder, "assess", interrupted)
    result = StudyFolder(tmp_path, few, listener=told).run()
    assert result.certainty is None and result.done.all() and not result.partial
    assert "the table is complete" in told.notes[0]


def test_a_coupling_error_above_the_accuracy_is_noted(few, here, told, tmp_path, monkeypatch):
    coupling = replace(COUPLING, stated_error=0.25)
    monkeypatch.setattr(InProcess, "choose", lambda _self, _study: coupling)
    StudyFolder(tmp_path, few, listener=told).run(certainty=False)
    assert told.notes == ["the coupling error of 0.25 % exceeds the requested accuracy of 0.2 %"]


def test_effects_of_shocks_and_of_the_vehicle_load_no_fmu_again(few, here, tmp_path, monkeypatch):
    loaded = []
    component = evaluators.FmuComponent
    monkeypatch.setattr(evaluators, "FmuComponent", lambda *given: loaded.append(given[1]) or component(*given))
    folder = StudyFolder(tmp_path, few)
    folder.run(certainty=False)
    path = tmp_path / "uncertain.toml"
    path.write_text("""schema = 1
[[uncertain]]
part = "stiff"
parameters = { compression_scale = { value = 2.0, deviation = 0.02 } }
[[uncertain]]
part = "car"
parameters = { "lf.friction_force" = { value = 0.0, deviation = 20.0, lowest = 0.0 } }
""")
    before = len(here)
    certainty, check = folder.robust(path, top=2, draws=2)
    assert loaded == ["car", *few.corners]
    assert [one.part for one in certainty.effects] == ["stiff", "car"] and check.draws == 2
    assert len(here) > before and StudyFolder(tmp_path).certainty().effects == certainty.effects


def test_code_of_the_user_is_named_before_it_runs(few, told, tmp_path):
    code = tmp_path / "mine.py"
    code.write_text("raise RuntimeError('it ran')\n")
    told.say = told.note
    own = replace(few.measures[0], name="own", function=f"{code}:crest")
    with pytest.raises(InputError, match="it ran"):
        _ = StudyFolder(tmp_path, replace(few, measures=(*few.measures, own)), listener=told).sweep
    assert told.notes == [f"running the Python code of this study's measures: {code}"]


def test_a_folder_without_results_or_without_a_file_says_what_is_missing(tmp_path):
    with pytest.raises(FileFormatError, match=RESULTS):
        StudyFolder(tmp_path)
    (tmp_path / "study.toml").write_text(
        'schema = 1\n[vehicle]\nfmu = "car.toml"\n[bank]\nA = "A.json"\n[[drive]]\nfile = "lap.parquet"\n'
    )
    with pytest.raises(InputError, match=r"the file .*car\.toml does not exist; correct its name there"):
        StudyFolder(tmp_path / "out", tmp_path / "study.toml")


def test_built_fmus_take_the_place_of_their_sources(fmus, told, tmp_path, monkeypatch):
    made = {"car.toml": fmus["seven_dof"], "A.json": fmus["lpnl2"]}
    for name in made:
        (tmp_path / name).write_text("")
    track = ep.examples() / "data" / "track.parquet"
    (tmp_path / "study.toml").write_text(
        'schema = 1\nfamilies = ["numbers"]\n[vehicle]\nfmu = "car.toml"\n[bank]\nA = "A.json"\n'
        f'[[drive]]\nfile = "{track}"\nstop = 3.0\n'
    )
    sentences = []
    told.say = sentences.append
    folder = StudyFolder(
        tmp_path / "out",
        tmp_path / "study.toml",
        listener=told,
        build=lambda sources, _to: [SimpleNamespace(source=one, path=made[one.name]) for one in sources],
    )
    assert folder.study.vehicle.fmu == fmus["seven_dof"] and folder.study.bank["A"].fmu == fmus["lpnl2"]
    assert sentences == [f"built 2 FMUs in {tmp_path / 'out' / 'fmus'}/"]
