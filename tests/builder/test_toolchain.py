"""Binaries for six platforms: right processors, old systems, only FMI symbols, reproducible bytes."""

import ctypes
import hashlib
import os
import re
import shutil
import struct
import tempfile
from pathlib import Path

import lief
import numpy as np
import pytest

from builder import toolchain
from builder.interface import source_folder
from builder.tables import _BLOCKS, _blocks_of_rows
from builder.toolchain import (
    PLATFORMS,
    Library,
    SystemCompiler,
    Zig,
    compile_libraries,
    find_toolchain,
    fmi_headers,
    this_platform,
    universal,
)
from eightpost import cache
from eightpost.errors import FmuError

#: Sizes and contents are only known at run time, so that the calls are not optimized away. quick_exit is used because
#: glibc has two versions of it, 2.24 and an older one: a library for a newer glibc than 2.17 would need 2.24.
SOURCE = """
#include <stdlib.h>
#include <string.h>
#include "fmi2Functions.h"
double hidden(const double *x, size_t count);
double hidden(const double *x, size_t count) { double sum = 0.0; while (count--) sum += x[count] * 3.0; return sum; }
const char *fmi2GetVersion(void) { return fmi2Version; }
#ifdef __linux__
void quick_exit(int status);
#else
#define quick_exit(status) ((void)(status))
#endif
void fmi2FreeInstance(fmi2Component c) { if (c == NULL) quick_exit(1); free(c); }
fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, fmi2Real value[])
{ double *p = calloc(nvr + 1, sizeof *p); if (p == NULL) return fmi2Error; memcpy(p, c, nvr * sizeof *p);
  value[0] = hidden(p, nvr + 1) + vr[0]; free(p); return fmi2OK; }
fmi2Status fmi2GetBoolean(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, fmi2Boolean value[])
{ volatile char large[40000]; for (size_t i = 0; i < nvr; ++i) large[vr[i]] = (char)vr[i];
  value[0] = strcmp(c, "yes") == 0 && large[vr[nvr - 1]] == (char)vr[nvr - 1]; return fmi2OK; }
"""

#: Symbols without code that zig's linker adds to a Mach-O file.
LINKER_MARKS = {"___dso_handle", "__mh_dylib_header"}
EXPORTS = {"fmi2GetVersion", "fmi2FreeInstance", "fmi2GetReal", "fmi2GetBoolean"}
pytestmark = pytest.mark.usefixtures("all_platforms")

LIBRARY = Library("little", {"little.c": SOURCE.encode()})


@pytest.fixture(scope="module")
def zig():
    toolchain = find_toolchain()
    if not isinstance(toolchain, Zig):
        pytest.skip("zig's compiler is not installed (pip install 'eightpost[build]')")
    return toolchain


@pytest.fixture(scope="module")
def binaries(zig):
    (members,) = compile_libraries([LIBRARY], toolchain=zig)
    return members


def parsed(content):
    return lief.parse(list(content))


def assert_runs(path):
    """Call the functions of a library: 3 (1 + 2 + 3) + 7 from a copy, and a comparison with a large stack frame."""
    library = ctypes.CDLL(str(path))
    value, flag = ctypes.c_double(), ctypes.c_int()
    assert (
        library.fmi2GetReal((ctypes.c_double * 3)(1, 2, 3), ctypes.byref(ctypes.c_uint(7)), 3, ctypes.byref(value)) == 0
    )
    assert value.value == 25.0
    assert library.fmi2GetBoolean(b"yes", ctypes.byref(ctypes.c_uint(39999)), 1, ctypes.byref(flag)) == 0
    assert flag.value == 1


def zig_of(folder):
    """Return a cache folder with zig's compiled C libraries and without our entries."""
    (cache.cache_folder() / "zig").mkdir(parents=True, exist_ok=True)
    folder.mkdir(exist_ok=True)
    (folder / "zig").symlink_to(cache.cache_folder() / "zig", target_is_directory=True)
    return folder


def test_each_platforms_folder_contains_one_library(binaries):
    assert set(binaries) == {
        "binaries/linux64/little.so",
        "binaries/win64/little.dll",
        "binaries/win32/little.dll",
        "binaries/aarch64-linux/little.so",
        "binaries/darwin64/little.dylib",
        "binaries/aarch64-darwin/little.dylib",
    }


@pytest.mark.parametrize(
    ("platform", "machine"), [("linux64", lief.ELF.ARCH.X86_64), ("aarch64-linux", lief.ELF.ARCH.AARCH64)]
)
def test_linux_libraries_depend_only_on_glibc_2_17(binaries, platform, machine):
    library = parsed(binaries[f"binaries/{platform}/little.so"])
    assert library.header.machine_type == machine
    assert set(library.libraries) <= {"libc.so.6", "libm.so.6"}
    assert {s.name for s in library.imported_symbols} <= {"calloc", "free", "memcpy", "memset", "quick_exit", "strcmp"}
    versions = [
        tuple(map(int, v)) for v in re.findall(rb"GLIBC_(\d+)\.(\d+)", binaries[f"binaries/{platform}/little.so"])
    ]
    assert versions and max(versions) <= (2, 17)
    assert {s.name for s in library.exported_symbols} == EXPORTS
    assert not library.has(lief.ELF.DynamicEntry.TAG.RUNPATH)


@pytest.mark.parametrize(
    ("platform", "machine"),
    [("win64", lief.PE.Header.MACHINE_TYPES.AMD64), ("win32", lief.PE.Header.MACHINE_TYPES.I386)],
)
def test_windows_libraries_import_only_the_windows_runtime(binaries, platform, machine):
    library = parsed(binaries[f"binaries/{platform}/little.dll"])
    assert library.header.machine == machine
    assert all(i.name.lower().startswith("api-ms-win-crt-") for i in library.imports)
    assert {e.name for i in library.imports for e in i.entries} == {"calloc", "free", "strcmp"}
    assert {e.name for e in library.get_export().entries} == EXPORTS


def test_the_mac_library_supports_both_processors_and_each_slice_needs_macos_11(binaries):
    fat = lief.MachO.parse(list(binaries["binaries/darwin64/little.dylib"]))
    thin = lief.MachO.parse(list(binaries["binaries/aarch64-darwin/little.dylib"]))
    assert [s.header.cpu_type for s in fat] == [lief.MachO.Header.CPU_TYPE.X86_64, lief.MachO.Header.CPU_TYPE.ARM64]
    assert [s.header.cpu_type for s in thin] == [lief.MachO.Header.CPU_TYPE.ARM64]
    for piece in (*fat, *thin):
        assert list(piece.build_version.minos)[:2] == [11, 0]
        assert {s.name for s in piece.exported_symbols} == {f"_{name}" for name in EXPORTS} | LINKER_MARKS
        assert [library.name for library in piece.libraries][1:] == ["/usr/lib/libSystem.B.dylib"]


def code_directory(content):
    """Return the page hashes in a thin Mach-O file's signature, and those computed from its pages.

    Source: Apple, <mach-o/loader.h> (LC_CODE_SIGNATURE) and xnu's osfmk/kern/cs_blobs.h (CS_CodeDirectory).
    """
    (commands,) = struct.unpack_from("<I", content, 16)
    place = 32
    for _ in range(commands):
        kind, size = struct.unpack_from("<II", content, place)
        if kind == 0x1D:
            (start,) = struct.unpack_from("<I", content, place + 8)
            break
        place += size
    start += struct.unpack_from(">I", content, start + 16)[0]  # the first blob is the directory
    hashes, _, _, count, limit = struct.unpack_from(">5I", content, start + 16)
    length, kind, _, page = struct.unpack_from(">4B", content, start + 36)
    assert (length, kind) == (32, 2)  # SHA-256
    there = [content[start + hashes + 32 * k :][:32] for k in range(count)]
    pages = [content[k << page : min((k + 1) << page, limit)] for k in range(count)]
    return there, [hashlib.sha256(p).digest() for p in pages]


def test_the_signature_for_apple_processors_matches_every_page(binaries):
    fat = binaries["binaries/darwin64/little.dylib"]
    offset, size = struct.unpack_from(">II", fat, 8 + 20 + 8)
    thin = binaries["binaries/aarch64-darwin/little.dylib"]
    assert fat[offset : offset + size] == thin and offset % 16384 == 0
    there, computed = code_directory(thin)
    assert there == computed and there


@pytest.mark.nightly
def test_the_same_sources_give_the_same_bytes_in_another_folder_without_the_cache(binaries, zig, tmp_path, monkeypatch):
    monkeypatch.setenv("EIGHTPOST_CACHE", str(zig_of(tmp_path / "other")))
    (again,) = compile_libraries([LIBRARY], toolchain=zig)
    assert again == binaries


def test_a_slice_that_two_platforms_share_is_compiled_once(zig, tmp_path, monkeypatch):
    """The universal binary for macOS contains that for macOS on ARM."""
    monkeypatch.setenv("EIGHTPOST_CACHE", str(tmp_path))
    monkeypatch.setattr(toolchain, "recall", lambda *_: None)  # the cache must not hide a second compilation
    compiled, thin = [], struct.pack("<IiI", 0xFEEDFACF, 1, 1)

    def compile_slice(_toolchain, _library, _platform, command):
        compiled.append(command[command.index("-target") + 1])
        return thin

    monkeypatch.setattr(toolchain, "_compile", compile_slice)
    (members,) = compile_libraries([LIBRARY], toolchain=zig)
    assert len(members) == 6
    assert sorted(compiled) == sorted({target for p in PLATFORMS.values() for target in p.targets})


def test_no_library_contains_the_path_of_its_build(binaries):
    here = (f"{tempfile.gettempdir()}/", f"{Path.home()}/", Path.cwd())
    places = [b"/home/", b"/Users/", *map(os.fsencode, here)]
    assert len(binaries) == len(PLATFORMS)
    for name, content in binaries.items():
        assert not [place for place in places if place in content], name


@pytest.mark.nightly
def test_zig_keeps_no_library_in_its_permanent_cache(zig, binaries):
    name = f"only_here_{os.urandom(8).hex()}"
    only_here = Library(name, {f"{name}.c": SOURCE.encode()})
    compile_libraries([only_here], toolchain=zig)
    walk = os.walk(cache.cache_folder() / "zig")  # os.walk ignores folders that other processes delete meanwhile
    assert not [file for _, _, files in walk for file in files if name in file]


def system_compiler():
    return SystemCompiler(shutil.which("cc") or pytest.skip("no system compiler"))


def test_a_damaged_or_truncated_cache_entry_is_recompiled(tmp_path, monkeypatch):
    monkeypatch.setenv("EIGHTPOST_CACHE", str(tmp_path))
    (first,) = compile_libraries([LIBRARY], toolchain=system_compiler())
    (entry,) = (tmp_path / "binaries").iterdir()
    whole = entry.read_bytes()
    for damaged in (whole[:-5] + bytes([whole[-5] ^ 1]) + whole[-4:], whole[:100], b""):
        entry.write_bytes(damaged)
        (again,) = compile_libraries([LIBRARY], toolchain=system_compiler())
        assert again == first and entry.read_bytes() == whole


def test_the_cache_drops_the_least_recently_used_entry(tmp_path, monkeypatch):
    monkeypatch.setenv("EIGHTPOST_CACHE", str(tmp_path))
    monkeypatch.setattr(cache, "KEPT", 3)
    for age, key in enumerate("abc"):
        cache.keep("binaries", key, key.encode())
        os.utime(tmp_path / "binaries" / key, (1e9 + age, 1e9 + age))
    assert cache.recall("binaries", "a") == b"a"  # used now, so that b is dropped first
    cache.keep("binaries", "d", b"d")
    assert {path.name for path in (tmp_path / "binaries").iterdir()} == {"a", "c", "d"}


def key_of(zig, library, platform):
    target = platform.targets[0]
    command = zig.command(library.identifier, platform, target, ["little.c"])
    return toolchain._key(zig, library, target, command)


def test_the_cache_key_covers_everything_a_binary_depends_on_and_no_folder_name(zig, tmp_path, monkeypatch):
    windows = PLATFORMS["win64"]
    key = key_of(zig, LIBRARY, windows)
    assert key_of(zig, LIBRARY, PLATFORMS["win32"]) != key
    assert key_of(zig, Library("other", LIBRARY.sources), windows) != key
    assert key_of(zig, Library("little", {"little.c": b"int f;"}), windows) != key
    for folder in ("c-code", "fmus"):
        shutil.copytree(fmi_headers() if folder == "c-code" else source_folder(), tmp_path / folder)
    monkeypatch.setattr("builder.toolchain.source_folder", lambda: tmp_path / "fmus")
    monkeypatch.setattr("builder.toolchain.fmi_headers", lambda: tmp_path / "c-code")
    monkeypatch.setattr("builder.toolchain.fmi_headers", lambda: tmp_path / "c-code")
    assert key_of(zig, LIBRARY, windows) == key
    for name in ("fmus/common/windows_entry.c", "c-code/fmi2TypesPlatform.h"):
        old = (tmp_path / name).read_bytes()
        (tmp_path / name).write_bytes(old + b" ")
        assert key_of(zig, LIBRARY, windows) != key, name
        (tmp_path / name).write_bytes(old)


def test_machines_that_share_a_cache_folder_do_not_share_binaries_of_different_compilers():
    system = system_compiler()
    command = system.command("little", PLATFORMS["linux64"], "", ["little.c"])
    assert len({toolchain._key(system, LIBRARY, name, command) for name in ("linux64", "aarch64-linux")}) == 2


def test_libraries_with_the_same_name_have_separate_cache_entries(tmp_path, monkeypatch):
    monkeypatch.setenv("EIGHTPOST_CACHE", str(tmp_path))
    other = Library("little", {"little.c": SOURCE.replace("3.0", "5.0").encode()})
    first, second = compile_libraries([LIBRARY, other], toolchain=system_compiler())
    assert set(first) == set(second) and first != second


def test_progress_is_reported_up_to_the_number_of_binaries(binaries, zig):
    progress_calls = []
    compile_libraries([LIBRARY], toolchain=zig, progress=lambda done, of: progress_calls.append((done, of)))
    assert progress_calls == sorted(progress_calls)  # it is also reported while a binary is compiled
    assert {call for call in progress_calls if call[0]} == {(done, 6) for done in range(1, 7)}


def test_the_systems_compiler_builds_for_this_platform_and_reports_that(tmp_path):
    system = system_compiler()
    (members,) = compile_libraries([LIBRARY], toolchain=system)
    assert list(members) == [this_platform().member("little")]
    assert 'pip install "eightpost[build]"' in system.limits and this_platform().name in system.limits
    path = tmp_path / "little.so"
    path.write_bytes(next(iter(members.values())))
    assert_runs(path)


def test_this_platforms_library_runs(binaries, tmp_path):
    platform = this_platform()
    if platform.name not in PLATFORMS:
        pytest.skip(f"{platform.name} is not one of the six platforms")
    path = tmp_path / f"little{platform.suffix}"
    path.write_bytes(binaries[platform.member("little")])
    assert_runs(path)


def test_an_error_in_the_source_is_reported_with_the_platform_and_the_compilers_message(zig):
    wrong = Library("wrong", {"wrong.c": b"int f(void) { return undeclared; }\n"})
    with pytest.raises(FmuError, match=r"wrong: zig .* could not compile it for linux64: .*undeclared"):
        compile_libraries([wrong], toolchain=zig)


def test_without_any_compiler_the_error_message_names_the_package_to_install(monkeypatch):
    monkeypatch.setattr("builder.toolchain._zig", lambda: None)
    monkeypatch.setenv("PATH", "")
    monkeypatch.delenv("CC", raising=False)
    with pytest.raises(FmuError, match=r'pip install "eightpost\[build\]".*--target python'):
        find_toolchain()


def test_a_universal_file_accepts_only_mach_o_slices():
    with pytest.raises(ValueError, match="not a 64-bit Mach-O"):
        universal([struct.pack("<Iii", 0x7F454C46, 0, 0)])


@pytest.mark.parametrize("rows", _BLOCKS)
def test_a_matrix_whose_rows_fill_blocks_is_not_padded(rows):
    text = _blocks_of_rows(np.ones((rows, 2)))
    assert text.count("1.0") == 2 * rows and "0.0" not in text.replace("1.0", "")
