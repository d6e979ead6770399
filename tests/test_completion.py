"""The mark of an unfinished command in its output folder: when it stands, when it goes, and what a reader says."""

from __future__ import annotations

import logging
import mmap
from pathlib import Path

import pytest
from click.exceptions import Exit

from eightpost import completion
from eightpost.completion import MARK, abandon, begin, marks_removed, warn_of_earlier_results
from eightpost.errors import InputError, StepError
from eightpost.workers import supervision


@pytest.fixture
def out(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An output folder, relative, that does not exist yet."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(completion, "tell", None)
    monkeypatch.setattr("sys.argv", ["/bin/eightpost", "run", "a case.toml"])
    return Path("deep", "out")


def test_a_folder_is_marked_from_the_first_computation_until_the_command_ends(
    out: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with marks_removed():
        assert not out.exists()
        begin(out)
        text = (out / MARK).read_text()
        assert text.startswith("eightpost run 'a case.toml'\n\nbegan at 20") and "earlier run" in text
        (out / "result.json").touch()
        monkeypatch.chdir("/")  # an FMU may do so
    assert [path.name for path in (tmp_path / out).iterdir()] == ["result.json"]


def test_an_exit_with_a_code_is_an_end(out: Path) -> None:
    with pytest.raises(Exit), marks_removed(Exit):
        begin(out)
        (out / "result.json").touch()
        raise Exit(1)
    assert [path.name for path in out.iterdir()] == ["result.json"]


def test_an_error_leaves_the_mark_beside_earlier_results_and_says_what_they_are(out: Path) -> None:
    out.mkdir(parents=True)
    (out / "result.json").write_text("earlier")
    with pytest.raises(StepError) as caught, marks_removed(Exit):
        begin(out)
        raise StepError("the FMU failed")
    assert caught.value.__notes__ == [f"The results in {out} are of an earlier run"]
    assert (out / MARK).is_file() and (out / "result.json").read_text() == "earlier"
    with marks_removed():
        begin(out)
    assert not (out / MARK).exists()


@pytest.mark.parametrize("exists", [False, True])
def test_an_error_leaves_nothing_where_there_was_nothing(out: Path, exists: bool) -> None:
    if exists:
        out.mkdir(parents=True)
    with pytest.raises(StepError) as caught, marks_removed():
        begin(out)
        raise StepError("the FMU failed")
    assert not hasattr(caught.value, "__notes__")
    assert out.exists() == exists and not [*out.glob("*")]


def test_marks_are_those_of_the_command_only(out: Path) -> None:
    out.mkdir(parents=True)
    (out / MARK).write_text("of another command")
    with pytest.raises(InputError), marks_removed():
        raise InputError("wrong before it began")
    with marks_removed():
        pass
    assert (out / MARK).read_text() == "of another command" and abandon() == []


def test_a_reader_says_once_that_results_are_of_an_earlier_run(out: Path, caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.WARNING, completion.__name__)
    out.mkdir(parents=True)
    warn_of_earlier_results(out)
    begin(out)
    warn_of_earlier_results(out)  # what the command itself has written so far
    assert not caplog.messages
    abandon()
    out.mkdir(exist_ok=True)
    (out / MARK).touch()
    warn_of_earlier_results(out)
    (message,) = caplog.messages
    assert message == f"results in {out} are of an earlier run: the last one did not finish (see {MARK})"


@pytest.mark.parametrize("holds", [True, False])
def test_the_supervising_process_knows_what_remains_if_this_process_ends(
    out: Path, holds: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    record = supervision.Record(mmap.mmap(-1, supervision.SIZE))
    monkeypatch.setattr(supervision, "record", record)
    monkeypatch.setattr(completion, "tell", supervision.tell)
    if holds:
        out.mkdir(parents=True)
        (out / "result.json").touch()
    with marks_removed():
        begin(out)
        assert record.remains == (f"The results in {out} are of an earlier run" if holds else "")


def test_a_file_is_no_output_folder(out: Path) -> None:
    out.parent.mkdir()
    out.touch()
    with pytest.raises(InputError, match="not a folder"), marks_removed():
        begin(out)
    assert out.is_file()
