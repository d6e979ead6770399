"""Damaged, unsafe or too large archives are refused; the message names the archive, the entry and the limit."""

import io
import stat
import sys
import time
import warnings
import zipfile

import pytest

from eightpost import archive
from eightpost.archive import extract_archive, open_archive, read_archive, write_archive
from eightpost.errors import FileFormatError, FmuError, OutputError
from eightpost.files import sha256_of


def packed(path, *entries, method=zipfile.ZIP_DEFLATED):
    with warnings.catch_warnings(), zipfile.ZipFile(path, "w", method) as made:
        warnings.simplefilter("ignore")  # two of one name
        for name, content in entries:
            made.writestr(name, content)
    return path


def link(name):
    entry = zipfile.ZipInfo(name)
    entry.external_attr = (stat.S_IFLNK | 0o777) << 16
    return entry


STRANGE = {
    "absolute": ([("/etc/evil", b"")], "'/etc/evil' is absolute"),
    "leaves": ([("a/../../evil", b"")], "'a/../../evil' leaves the archive"),
    "backslash": ([("a\\b", b"")], "has a backslash"),
    "drive": ([("C:/evil", b"")], "is absolute"),
    "link": ([(link("binaries"), b"/etc")], "'binaries' is a symbolic link"),
    "twice": ([("a", b"1"), ("a", b"2")], "has two entries at 'a'"),
    "file and folder": ([("a", b"1"), ("a/b", b"2")], "has two entries at 'a'"),
    "no name": ([(".", b"1")], "has no name"),
}


@pytest.mark.parametrize(("entries", "said"), STRANGE.values(), ids=STRANGE)
@pytest.mark.parametrize("read", [read_archive, lambda path: extract_archive(path, path.parent / "out")])
def test_unsafe_entries_are_refused_before_anything_is_written(tmp_path, entries, said, read):
    path = packed(tmp_path / "odd.fmu", ("modelDescription.xml", b"<a/>"), *entries)
    with pytest.raises(FmuError, match=r"odd\.fmu") as caught:
        read(path)
    assert said in str(caught.value)
    assert not (tmp_path / "out").exists()


@pytest.mark.filterwarnings("ignore:Duplicate name")
def test_of_entries_in_extra_with_the_same_path_the_last_one_counts(tmp_path):
    path = packed(tmp_path / "odd.fmu", ("a", b""), ("extra/tool/b", b"first"), ("c", b""), ("extra/tool/b", b"last"))
    notes = extract_archive(path, tmp_path / "out")
    assert notes == ("the archive has several entries at extra/tool/b; the last one counts",)
    assert (tmp_path / "out/extra/tool/b").read_bytes() == read_archive(path)["extra/tool/b"] == b"last"
    assert extract_archive(packed(tmp_path / "plain.fmu", ("extra/b", b"")), tmp_path / "plain") == ()


@pytest.mark.nightly
def test_a_bomb_is_refused_at_once_with_its_size_and_the_limit(tmp_path):
    packed(tmp_path / "bomb.fmu", ("resources/zeros", bytes(100_000_000)))
    begun = time.process_time()
    with pytest.raises(
        FmuError, match=r"bomb\.fmu: the entry 'resources/zeros' has an unpacked size of 95 MiB .* ratio of 200"
    ):
        extract_archive(tmp_path / "bomb.fmu", tmp_path / "out")
    assert time.process_time() - begun < 0.5


def test_sizes_and_counts_have_limits(tmp_path, monkeypatch):
    path = packed(tmp_path / "large.fmu", ("a", b"x" * 2_000_000), ("b", b"x" * 2_000_000))
    assert len(read_archive(path)["a"]) == 2_000_000  # a small entry may be as compressible as it is
    monkeypatch.setattr(archive, "LARGEST_TOTAL", 3 * 2**20)
    with pytest.raises(
        FmuError, match=r"large\.fmu: the whole archive has an unpacked size of 4 MiB, the limit is 3 MiB"
    ):
        read_archive(path)
    monkeypatch.setattr(archive, "LARGEST_ENTRY", 2**20)
    with pytest.raises(FmuError, match=r"large\.fmu: the entry 'a' has an unpacked size of 2 MiB, the limit is 1 MiB"):
        read_archive(path)
    monkeypatch.setattr(archive, "MOST_ENTRIES", 1)
    with pytest.raises(FmuError, match=r"large\.fmu: has 2 entries, the limit is 1"):
        read_archive(path)


def test_a_wrong_size_is_reported_as_damage(tmp_path):
    content = packed(tmp_path / "a.fmu", ("a", b"x" * 1000)).read_bytes()
    at = content.index(b"PK\x01\x02") + 24
    for lie in (0, 10, 999):
        (tmp_path / "a.fmu").write_bytes(content[:at] + lie.to_bytes(4, "little") + content[at + 4 :])
        with pytest.raises(FmuError, match=r"a\.fmu: the file is not a readable zip archive"):
            read_archive(tmp_path / "a.fmu")


def test_an_encrypted_entry_is_refused(tmp_path):
    content = bytearray(packed(tmp_path / "a.fmu", ("a", b"x" * 1000)).read_bytes())
    content[6] |= 1
    content[content.index(b"PK\x01\x02") + 8] |= 1
    (tmp_path / "a.fmu").write_bytes(content)
    with pytest.raises(FmuError, match=r"a\.fmu: the file is not a readable zip archive .*encrypted"):
        read_archive(tmp_path / "a.fmu")


def test_a_file_that_cannot_be_unpacked_is_named(tmp_path):
    path = packed(tmp_path / "long.fmu", ("x" * 300, b"1"))
    with pytest.raises(OutputError, match=r"long\.fmu: cannot be unpacked: .*out/xxx.*File name too long"):
        extract_archive(path, tmp_path / "out")


@pytest.mark.skipif(sys.platform == "win32", reason="devices are POSIX's")
def test_a_device_is_refused_before_it_is_read():
    with pytest.raises(FmuError, match="/dev/zero: is a device"), open_archive("/dev/zero"):
        pass
    with pytest.raises(FileFormatError, match="/dev/zero: is a device"):
        sha256_of("/dev/zero")


def test_unpacking_returns_the_packed_files(tmp_path):
    members = {"modelDescription.xml": b"<a/>", "binaries/linux64/a.so": bytes(range(256)) * 10_000, "empty": b""}
    write_archive(tmp_path / "a.fmu", members)
    extract_archive(tmp_path / "a.fmu", tmp_path / "out")
    assert read_archive(tmp_path / "a.fmu") == members
    assert {
        p.relative_to(tmp_path / "out").as_posix(): p.read_bytes() for p in (tmp_path / "out").rglob("*") if p.is_file()
    } == members
    assert zipfile.is_zipfile(io.BytesIO((tmp_path / "a.fmu").read_bytes()))


def test_an_archive_is_compressed_once(tmp_path, monkeypatch):
    monkeypatch.setenv("EIGHTPOST_CACHE", str(tmp_path / "cache"))
    members = {"b": b"2" * 1000, "a": b"1"}
    write_archive(tmp_path / "first.zip", members)
    monkeypatch.setattr(archive, "_packed", None)
    write_archive(tmp_path / "second.zip", dict(reversed(members.items())))
    assert (tmp_path / "second.zip").read_bytes() == (tmp_path / "first.zip").read_bytes()
    with pytest.raises(TypeError):
        write_archive(tmp_path / "other.zip", members | {"a": b"2"})


def test_entries_that_are_not_needed_are_not_unpacked_but_are_checked(tmp_path):
    write_archive(tmp_path / "a.zip", {"a/b": b"1", "c": b"2"})
    extract_archive(tmp_path / "a.zip", tmp_path / "out", lambda name: name == "c")
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["c"]
    packed(tmp_path / "bad.zip", ("../evil", b""), ("c", b""))
    with pytest.raises(FmuError, match="leaves the archive"):
        extract_archive(tmp_path / "bad.zip", tmp_path / "out", lambda name: name == "c")
