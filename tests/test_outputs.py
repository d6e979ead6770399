"""Every file is written by one rule: it replaces no input of the running command, no other kind of file, no folder."""

import json
import os
import sys
from pathlib import Path

import numpy as np
import pytest

from eightpost.archive import open_archive, write_archive
from eightpost.errors import InputError, OutputError
from eightpost.files import atomic_path, json_content, read_text, reading, sha256_of
from eightpost.outputs import (
    EXPORT,
    FMU,
    PICTURE,
    RECORD,
    SHOCK,
    TABLE,
    _content_of,
    check_file,
    check_folder,
    recorded,
    replacing,
)
from eightpost.report.pictures import new_figure, save
from eightpost.signals import TimeSeries, write_series

CONTENTS = {
    b"\x89PNG\r\n\x1a\n...": "a PNG picture",
    b"%PDF-1.7": "a PDF file",
    b"PK\x03\x04...": "a zip archive",
    b"PAR1...": "a Parquet file",
    b"MATLAB 5.0 MAT-file": "a MATLAB file",
    b"\n<!DOCTYPE html>\n<HTML lang='en'>": "an HTML page",
    b"<?xml version='1.0'?>\n<svg>": "an SVG picture",
    b"<?xml version='1.0'?>\n<root/>": "an XML file",
    b'\xef\xbb\xbf {"kind": "shock", "inner": [1]}': "a JSON file of the kind 'shock'",
    b'{"a": 1}': "a JSON file",
    b"[1, 2]": "a JSON file",
    b'{"a": ': "a text file",
    b"[table]\na = 1": "a text file",
    b"[" * 100_000: "a text file",
    b"time [s],force [N]\n0,1": "a text file",
    b"caf\xe9": "a text file",
    b"<html>\0": "a binary file",
    b"": "",
}


@pytest.mark.parametrize(("content", "found"), CONTENTS.items(), ids=[str(one[:20]) for one in CONTENTS])
def test_a_content_is_recognised_by_its_bytes(tmp_path, content, found):
    (tmp_path / "any").write_bytes(content)
    assert _content_of(tmp_path / "any") == found


def write(path, text="new"):
    with atomic_path(path) as temporary:
        temporary.write_text(text)


def test_a_file_is_replaced_only_by_its_own_kind(tmp_path):
    for name, old, new in (
        ("a.png", "text", "\x89"),
        ("a.csv", '{"a": 1}', "time,force"),
        ("a.json", '{"kind": "vehicle"}', '{"kind": "shock"}'),
        ("a.json", '{"name": "package"}', '{"kind": "shock"}'),
        ("a.info", "<html>", "Damp_Push = 1"),
        ("a.txt", "kept", ""),
    ):
        (tmp_path / name).write_text(old)
        if name == "a.png":
            (tmp_path / name).write_bytes(b"PAR1")
        before = (tmp_path / name).read_bytes()
        with pytest.raises(InputError, match=rf"{name} is an? .*, and an? .* would replace it; choose another output"):
            write(tmp_path / name, new)
        assert (tmp_path / name).read_bytes() == before
        with replacing(tmp_path / name):
            write(tmp_path / name, new)
        assert (tmp_path / name).read_text(encoding="utf-8") == new
    assert not list(tmp_path.glob(".*"))


def test_an_empty_file_and_one_of_the_same_kind_are_replaced(tmp_path):
    for old in ("", '{"kind": "shock", "a": 1}'):
        (tmp_path / "a.json").write_text(old)
        write(tmp_path / "a.json", '{"kind": "shock"}')
        assert json.loads((tmp_path / "a.json").read_text()) == {"kind": "shock"}


def opened(path):
    with reading(path), path.open():
        pass


@pytest.mark.parametrize("read", [read_text, sha256_of, json_content, opened])
def test_a_command_never_replaces_a_file_that_it_read(tmp_path, read):
    (tmp_path / "a.json").write_text("{}")
    (tmp_path / "link.json").symlink_to("a.json")
    (tmp_path / "second.json").hardlink_to(tmp_path / "a.json")
    with recorded([]):
        read(tmp_path / "link.json")
        for name in ("a.json", "link.json", "second.json"):
            with pytest.raises(InputError, match=f"{name} is an input of this command and would be replaced"):
                write(tmp_path / name, "{}")
        write(tmp_path / "other.json", "{}")
    write(tmp_path / "a.json", "[1]")  # no command runs


def test_an_archive_that_was_read_and_a_file_that_was_named_are_inputs(tmp_path):
    write_archive(tmp_path / "a.fmu", {"a": b"1"})
    (tmp_path / "b.csv").write_text("a")
    with recorded([tmp_path / "b.csv", tmp_path / "missing.csv", Path("a\0b")]):
        with open_archive(tmp_path / "a.fmu"):
            pass
        with pytest.raises(InputError, match=r"a\.fmu is an input"):
            write_archive(tmp_path / "a.fmu", {"a": b"2"})
        with pytest.raises(InputError, match=r"b\.csv is an input"):
            write(tmp_path / "b.csv")
        write(tmp_path / "missing.csv")


def test_a_command_rewrites_its_own_output_and_what_it_updates(tmp_path):
    (tmp_path / "a.json").write_text("{}")
    with recorded([]):
        for _ in range(2):
            write(tmp_path / "own.json", "{}")
            read_text(tmp_path / "own.json")
        read_text(tmp_path / "a.json")
        with replacing(tmp_path / "b.json", tmp_path / "a.json"):
            write(tmp_path / "a.json", "{}")
        write(tmp_path / "a.json", "[]")
        with recorded([]):  # another command
            read_text(tmp_path / "a.json")
        write(tmp_path / "a.json", "{}")


def test_a_refusal_names_the_file_the_reason_and_the_remedy(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("old.json").write_text("a,b")
    Path("out").mkdir()
    for name, kind, said in (
        ("old.json", SHOCK, "old.json is a text file, and a JSON file of the kind 'shock' would replace it; choose "
         "another output, or delete that file first"),
        ("out", SHOCK, "out is a folder; name a file in it, such as out/shock.json"),
        ("a.toml", SHOCK, "a.toml: a shock file ends in .json; write -o a.json"),
        ("1 s", PICTURE, "1 s: a picture ends in .png, .pdf or .svg; write -o 1 s.png"),
        ("old.json/a.parquet", TABLE, "old.json is a file, not a folder; choose another output folder"),
    ):  # fmt: skip
        with pytest.raises(InputError) as caught:
            check_file(Path(name), kind, "-o")
        assert str(caught.value).replace(os.sep, "/") == said
    for name, kind in (("A.SVG", PICTURE), ("a.info", EXPORT), ("new/a.parquet", TABLE)):
        check_file(Path(name), kind)
    assert not Path("new").exists()


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no such files")
def test_a_pipe_is_refused_without_waiting_for_it(tmp_path):
    os.mkfifo(tmp_path / "pipe.json")
    with pytest.raises(InputError, match=r"pipe\.json is a device or a pipe; choose another output"):
        check_file(tmp_path / "pipe.json", SHOCK)


def test_files_of_an_output_folder_are_checked(tmp_path):
    (tmp_path / "old.json").mkdir()
    with pytest.raises(InputError, match=r"old\.json is a folder"):
        check_folder(tmp_path, {"new.parquet": TABLE, "old.json": SHOCK})
    check_folder(tmp_path, {"new.parquet": TABLE})
    with recorded([]):
        (tmp_path / "drive.parquet").write_bytes(b"PAR1")
        check_folder(tmp_path, {"drive.parquet": TABLE})
        sha256_of(tmp_path / "drive.parquet")
        with pytest.raises(InputError, match=r"drive\.parquet is an input"):
            check_folder(tmp_path, {"drive.parquet": TABLE})


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() == 0, reason="root may write to every folder")
def test_a_read_only_folder_is_refused_before_any_computation(tmp_path):
    (tmp_path / "kept").mkdir(mode=0o555)
    for path in (tmp_path / "kept", tmp_path / "kept" / "new" / "out"):
        with pytest.raises(OutputError, match=r"kept is read-only; change its permissions"):
            check_folder(path)


def test_the_folder_that_is_asked_for_permission_is_the_nearest_that_exists(tmp_path, monkeypatch):
    asked = []
    monkeypatch.setattr("os.access", lambda path, mode: asked.append(path) or False)
    with pytest.raises(OutputError, match=r"is read-only"):
        check_folder(tmp_path / "new" / "out")
    assert asked == [tmp_path]


def test_what_is_written_has_the_content_of_its_kind_so_that_it_can_be_written_again(tmp_path):
    series = TimeSeries.from_channels(np.arange(5) / 100.0, {"x": ("m", np.arange(5.0))})
    figure = new_figure(1.0, 1.0)
    for kind, write_one in (
        (RECORD, lambda path: write_series(series, path)),
        (PICTURE, lambda path: save(figure, path)),
        (FMU, lambda path: write_archive(path, {"a": b""})),
    ):
        for suffix in kind.suffixes:
            write_one(tmp_path / f"a{suffix}")
            check_file(tmp_path / f"a{suffix}", kind)


def test_a_picture_of_another_suffix_is_refused_by_the_library_too(tmp_path):
    with pytest.raises(InputError, match=r"a\.csv: a picture ends in \.png, \.pdf or \.svg; write .*a\.png$"):
        save(new_figure(1.0, 1.0), tmp_path / "a.csv")
    with pytest.raises(InputError, match="is a folder"):
        save(new_figure(1.0, 1.0), tmp_path)
