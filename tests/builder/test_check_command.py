"""The output of `eightpost check`, its JSON document and its exit codes."""

import io
import json

import pytest
from click.testing import CliRunner
from rich.console import Console

from builder.check import GROUPS, check, json_document
from eightpost.app.exchange import check as command
from eightpost.app.exchange import show_report
from eightpost.archive import read_archive, write_archive


def test_the_json_document_contains_everything_that_the_table_shows(universal_fmus, tmp_path):
    report = check(universal_fmus["lpnl2"], groups=("static", "reference"))
    document = json.loads(json.dumps(json_document([report])))
    assert (document["kind"], document["schema"], document["acceptable"]) == ("check", 1, True)
    (entry,) = document["reports"]
    assert entry["identity"]["modelName"] == "lpnl2" and len(entry["identity"]["sha256"]) == 64
    assert entry["counts"] == {"error": 0, "drop-in": 0, "hint": 0}
    assert entry["groups"] == ["static", "reference"]
    assert entry["done"] == [GROUPS["static"].title, GROUPS["reference"].title]


@pytest.fixture
def quickly(monkeypatch):
    """Run the command with the static rules only."""

    def run(*arguments):
        def static(path, *, scope):
            return check(path, scope=scope, groups=("static",))

        monkeypatch.setattr("builder.check.check", static)
        return CliRunner().invoke(command, [str(argument) for argument in arguments])

    return run


def test_hints_exit_0_and_drop_in_findings_exit_1_unless_the_scope_is_the_standard(
    quickly, universal_fmus, python_fmus, tmp_path
):
    hinted, members = tmp_path / "lpnl2.fmu", read_archive(universal_fmus["lpnl2"])
    del members["model.png"]
    write_archive(hinted, members)
    shown = quickly(hinted)
    assert shown.exit_code == 0 and "1 hint" in shown.output and "icon" in shown.output
    shown = quickly(hinted, python_fmus["lpnl2"])
    assert shown.exit_code == 1 and "drop-in" in shown.output
    shown = quickly("--standard", python_fmus["lpnl2"])
    assert shown.exit_code == 0 and "clean" in shown.output


def test_json_on_the_command_line_is_one_document_of_all_fmus(quickly, universal_fmus, python_fmus):
    shown = quickly("--json", universal_fmus["lpnl2"], python_fmus["lpnl2"])
    document = json.loads(shown.output)
    assert shown.exit_code == 1 and not document["acceptable"]
    assert [report["acceptable"] for report in document["reports"]] == [True, False]
    finding = document["reports"][1]["findings"][0]
    assert set(finding) == {"rule", "level", "title", "source", "message", "advice"}


@pytest.mark.parametrize("place", [0, 1], ids=["first", "last"])
def test_an_invalid_file_does_not_hide_the_reports_of_the_others(quickly, universal_fmus, tmp_path, place):
    given = [universal_fmus["lpnl2"]]
    given.insert(place, tmp_path / "missing.fmu")
    shown = quickly(*given)
    assert shown.exit_code == 2
    assert "lpnl2.fmu: clean" in shown.stdout and "missing.fmu" not in shown.stdout
    assert "there is no such file" in " ".join(shown.stderr.split())


def test_json_has_an_entry_for_a_bad_file_whose_error_is_also_printed_to_stderr(quickly, universal_fmus, tmp_path):
    (tmp_path / "text ä.fmu").write_text("no")
    shown = quickly("--json", universal_fmus["lpnl2"], tmp_path / "missing.fmu", tmp_path / "text ä.fmu")
    document = json.loads(shown.stdout)
    good, missing, text = document["reports"]
    assert shown.exit_code == 2 and not document["acceptable"]
    assert good["acceptable"] and "error" not in good
    assert missing.keys() == text.keys() == {"path", "acceptable", "error"}
    assert "no such file" in missing["error"] and text["path"].endswith("ä.fmu")
    assert "no such file" in " ".join(shown.stderr.split())


def test_the_command_warns_that_it_runs_foreign_code_and_is_not_a_sandbox(universal_fmus, monkeypatch):
    def called(path, *, scope):
        return check(path, scope=scope, groups=("simulation",))

    monkeypatch.setattr("builder.check.check", called)
    shown = CliRunner().invoke(command, ["--json", str(universal_fmus["lpnl2"])])
    assert "not a sandbox" in shown.stderr and json.loads(shown.stdout)["acceptable"]
    assert "not a sandbox" in " ".join(CliRunner().invoke(command, ["--help"]).output.split())


def test_a_folder_is_rejected(quickly, tmp_path):
    shown = quickly(tmp_path)
    assert shown.exit_code == 2
    assert "is a folder, not an .fmu file" in " ".join(shown.stderr.split())


@pytest.mark.nightly
def test_the_printed_report_names_the_groups_that_were_run_in_one_line(universal_fmus, monkeypatch):
    report = check(universal_fmus["lpnl2"], groups=("static", "footprint", "surroundings"))
    console = Console(file=io.StringIO(), width=80)
    monkeypatch.setattr("eightpost.app.show.is_detailed", lambda: True)
    show_report(console, report)
    assert "  performed static, footprint, surroundings\n" in console.file.getvalue()
