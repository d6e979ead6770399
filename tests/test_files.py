"""Invalid files with settings are refused with their name and a reason; write errors name the file."""

import json
import subprocess
import sys

import pytest

from eightpost.errors import FileFormatError, InputError, OutputError
from eightpost.files import atomic_path, json_content, read_text, toml_content

JSON = {
    "huge integer": ('{"a": ' + "9" * 5000 + "}", "99999999999999999999... is outside 64 bits"),
    "integer beyond 64 bits": ('{"a": 9223372036854775808}', "9223372036854775808 is outside 64 bits"),
    "NaN": ('{"a": NaN}', "NaN is not a finite number"),
    "overflow": ('{"a": 1e999}', "1e999 is not a finite number"),
    "deep": ("[" * 100_000, "nested more than 64 levels"),
    "deep but whole": ("[" * 100 + "]" * 100, "nested more than 64 levels"),
    "half a character": (r'{"a": "\ud800"}', "half of a character pair"),
    "not JSON": ('{"a": 1,\n "b"}', "run.json, line 2"),
}


@pytest.mark.parametrize(("text", "said"), JSON.values(), ids=JSON)
def test_json_that_cannot_be_used_is_refused_by_name(tmp_path, text, said):
    (tmp_path / "run.json").write_text(text)
    with pytest.raises(FileFormatError, match=r"run\.json") as caught:
        json_content(tmp_path / "run.json")
    assert said in str(caught.value) and len(str(caught.value)) < 400


TOML = {
    "huge integer": ("a = " + "9" * 5000, "4300"),
    "integer beyond 64 bits": ("a = 9223372036854775808", "outside 64 bits"),
    "deep": ("a = " + "[" * 5000 + "]" * 5000, "nested more than 64 levels"),
    "deep keys": (".".join("a" * 300) + " = 1", "nested more than 64 levels"),
    "not TOML": ("a = \nb = 2", "line 1"),
}


@pytest.mark.parametrize(("text", "said"), TOML.values(), ids=TOML)
def test_toml_that_cannot_be_used_is_refused_by_name(tmp_path, text, said):
    (tmp_path / "car.toml").write_text(text)
    with pytest.raises(FileFormatError, match=r"car\.toml") as caught:
        toml_content(tmp_path / "car.toml")
    assert said in str(caught.value)


def test_settings_keep_their_values(tmp_path):
    document = {"a": [1, -(2**63), 2**63 - 1, 1.5], "b": {"c": "é"}, "d": None}
    (tmp_path / "a.json").write_bytes(b"\xef\xbb\xbf" + json.dumps(document).encode())
    assert json_content(tmp_path / "a.json") == document
    (tmp_path / "b.json").write_text('{"a": Infinity}')
    assert json_content(tmp_path / "b.json", finite=False) == {"a": float("inf")}


def test_a_path_without_a_text_file_is_refused_by_name(tmp_path):
    (tmp_path / "folder.toml").mkdir()
    (tmp_path / "loop.toml").symlink_to("loop.toml")
    (tmp_path / "latin.toml").write_bytes(b"a = 1\nb = '\xe9'\n")
    for name, said in {
        "gone.toml": "there is no such file",
        "folder.toml": "is a folder, not a file",
        "loop.toml": "symbolic links",
        "latin.toml": "line 2: the byte 0xe9 is not UTF-8",
        "a\0b.toml": "there is no such file",
    }.items():
        with pytest.raises(FileFormatError) as caught:
            read_text(tmp_path / name)
        assert name in str(caught.value) and said in str(caught.value)


FULL = """
import resource, sys
from pathlib import Path
import numpy as np
from eightpost.signals import TimeSeries, write_series
from eightpost.vehicle import read_vehicle, shipped, write_vehicle
from eightpost.archive import write_archive
from eightpost.errors import OutputError
import scipy.io, pyarrow.parquet

folder = Path(sys.argv[1])
series = TimeSeries.from_channels(np.arange(5000) / 100.0, {"x": ("m", np.random.default_rng(1).normal(size=5000))})
writers = {
    "run.csv": lambda path: write_series(series, path),
    "run.parquet": lambda path: write_series(series, path),
    "run.mat": lambda path: write_series(series, path),
    "a.fmu": lambda path: write_archive(path, {"a": np.random.default_rng(1).bytes(50_000)}),
}
resource.setrlimit(resource.RLIMIT_FSIZE, (10_000, 10_000))  # writing beyond it fails as on a full disk
for name, write in writers.items():
    (folder / name).write_bytes(b"old")
    try:
        write(folder / name)
    except OutputError as error:
        assert str(folder / name) in str(error) and "free space there" in str(error), error
    else:
        raise SystemExit(f"{name} was written")
    assert (folder / name).read_bytes() == b"old"
assert sorted(path.name for path in folder.iterdir()) == sorted(writers)
"""


@pytest.mark.nightly
@pytest.mark.skipif(sys.platform == "win32", reason="limits of files are POSIX's")
def test_a_full_disk_is_reported_with_the_file_name_and_keeps_the_old_file(tmp_path):
    ran = subprocess.run([sys.executable, "-c", FULL, str(tmp_path)], capture_output=True, text=True, check=False)
    assert ran.returncode == 0, ran.stderr


def test_a_folder_that_cannot_be_created_is_named(tmp_path):
    with pytest.raises(InputError, match=r"plain is a file, not a folder"):
        (tmp_path / "plain").write_text("")
        with atomic_path(tmp_path / "plain" / "out.csv"):
            pass
    with pytest.raises(OutputError, match=r"File name too long"), atomic_path(tmp_path / ("x" * 300)) as temporary:
        temporary.write_text("")
