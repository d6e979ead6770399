"""`eightpost optimise`: output, files and exit codes."""

from __future__ import annotations

import pytest
from click.testing import CliRunner

from cosim.study.table import StudyResult
from eightpost.__main__ import main
from eightpost.api.study_folder import StudyFolder

from .coupled import TRACK

TEXT = """
schema = 1
name = "three builds, front and rear alike"
families = ["numbers"]
settling = "0.5 s"
baseline = "middle"
alike = [["lf", "rf"], ["lr", "rr"]]

[vehicle]
fmu = "{car}"
means = "trusted"

[bank]
soft = {{ fmu = "{shock}", parameters = {{ compression_scale = 0.5, rebound_scale = 0.5 }} }}
middle = "{shock}"
stiff = {{ fmu = "{shock}", parameters = {{ compression_scale = 2.0, rebound_scale = 2.0 }} }}

[[drive]]
file = "{track}"
stop = "2 s"

[[objective]]
measure = "grip number"
weight = 1.0
unit = "N"

[[constraint]]
measure = "aero number"
at_most = {limit}
"""


def optimise(fmus, folder, *words: str, limit: float = 1.0):
    file = folder / "study.toml"
    file.write_text(TEXT.format(car=fmus["seven_dof"], shock=fmus["lpnl2"], track=TRACK, limit=limit))
    options = ["optimise", str(file), "-o", str(folder / "out"), "--workers", "1", *words]
    return CliRunner(env={"COLUMNS": "160"}).invoke(main, options)


@pytest.mark.nightly
def test_a_search_writes_its_results_and_resumes_with_more_evaluations(fmus, tmp_path, monkeypatch):
    pages = []  # the page takes longer than the search, and is tested elsewhere
    monkeypatch.setattr(StudyFolder, "write_page", lambda *given, **_options: pages.append(given))
    shown = optimise(fmus, tmp_path, "--evaluations", "4")
    assert shown.exit_code == 0, shown.output
    for text in ("minimised: 1 x grip number", "4 setups were evaluated; the study has 9 setups", "results.parquet"):
        assert text in shown.output
    first = StudyResult.load(tmp_path / "out" / "results.parquet")
    assert len(first) == 4
    assert first.partial
    more = optimise(fmus, tmp_path, "--evaluations", "9", "--for", "grip number", "--for", "aero number", limit=1e-9)
    assert more.exit_code == 1, more.output  # no setup keeps the constraint
    assert "every setup was evaluated" in more.output
    whole = StudyResult.load(tmp_path / "out" / "results.parquet")
    assert len(whole) == 9
    assert not whole.partial
    assert len(pages) == 2


def test_an_unknown_measure_is_reported_before_anything_runs(fmus, tmp_path):
    shown = optimise(fmus, tmp_path, "--for", "grip nummber")
    assert shown.exit_code == 2
    assert "did you mean 'grip number'" in " ".join(shown.stderr.split())
