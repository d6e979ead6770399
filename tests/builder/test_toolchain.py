"""Binaries for six platforms: the right machines, the oldest systems, no names but FMI's, the same bytes each time."""

import ctypes
import os
import re
import shutil
import struct
from pathlib import Path

import lief
import pytest

from builder.native import cache
from builder.native.compiler import Library, compile_libraries
from builder.native.platforms import PLATFORMS, this_platform
from builder.native.toolchain import SystemCompiler, Zig, find_toolchain
from builder.native.universal import universal
from eightpost.errors import FmuError

SOURCE = """
#include <stdlib.h>
#include <string.h>
#include "fmi2Functions.h"
static double kept[3];
const char *fmi2GetVersion(void) { return fmi2Version; }
void fmi2FreeInstance(fmi2Component c) { free(c); }
double hidden(double x);
double hidden(double x) { return kept[0] + x * 3.0 + 1.0; }
fmi2Status fmi2Reset(fmi2Component c) { double *p = calloc(900, sizeof *p); memcpy(p, c, 7200); free(p);
                                        return hidden(2.0) == 7.0 ? fmi2OK : fmi2Error; }
fmi2Status fmi2Terminate(fmi2Component c) { char large[40000]; memset(large, c == NULL, sizeof large);
                                            return large[39999] ? fmi2OK : fmi2Error; }
"""

#: Marks that zig's linker puts into a Mach-O file; there is no code behind them.
LINKER_MARKS = {"___dso_handle", "__mh_dylib_header"}
EXPORTS = {"fmi2GetVersion", "fmi2FreeInstance", "fmi2Reset", "fmi2Terminate"}
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


def test_one_library_goes_to_each_platforms_folder(binaries):
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
def test_linux_libraries_run_with_glibc_2_17_and_need_nothing_else(binaries, platform, machine):
    library = parsed(binaries[f"binaries/{platform}/little.so"])
    assert library.header.machine_type == machine
    assert set(library.libraries) <= {"libc.so.6", "libm.so.6"}
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
def test_windows_libraries_import_windows_own_run_time_only(binaries, platform, machine):
    library = parsed(binaries[f"binaries/{platform}/little.dll"])
    assert library.header.machine == machine
    assert all(i.name.lower().startswith("api-ms-win-crt-") for i in library.imports)
    assert {e.name for e in library.get_export().entries} == EXPORTS


def test_the_mac_library_holds_both_processors_and_each_asks_for_macos_11(binaries):
    fat = lief.MachO.parse(list(binaries["binaries/darwin64/little.dylib"]))
    thin = lief.MachO.parse(list(binaries["binaries/aarch64-darwin/little.dylib"]))
    assert [s.header.cpu_type for s in fat] == [lief.MachO.Header.CPU_TYPE.X86_64, lief.MachO.Header.CPU_TYPE.ARM64]
    assert [s.header.cpu_type for s in thin] == [lief.MachO.Header.CPU_TYPE.ARM64]
    for piece in (*fat, *thin):
        assert list(piece.build_version.minos)[:2] == [11, 0]
        assert {s.name for s in piece.exported_symbols} == {f"_{name}" for name in EXPORTS} | LINKER_MARKS
        assert [library.name for library in piece.libraries][1:] == ["/usr/lib/libSystem.B.dylib"]
    assert all(piece.has_code_signature for piece in (fat.at(1), thin.at(0)))


def test_the_same_sources_give_the_same_bytes_in_another_folder_without_the_cache(binaries, zig, tmp_path, monkeypatch):
    zig_cache = cache.cache_folder() / "zig"
    monkeypatch.setenv("EIGHTPOST_CACHE", str(tmp_path / "other"))
    (tmp_path / "other").mkdir()
    if zig_cache.is_dir():  # what zig made of the C libraries; our own entries are not there
        (tmp_path / "other" / "zig").symlink_to(zig_cache, target_is_directory=True)
    (again,) = compile_libraries([LIBRARY], toolchain=zig)
    assert again == binaries


def test_no_library_tells_where_it_was_built(binaries):
    for name, content in binaries.items():
        for place in (b"/tmp/", b"/home/", b"/root/", b"/Users/", os.fsencode(Path.cwd())):
            assert place not in content, name


def test_a_damaged_cache_entry_is_compiled_again(zig, binaries, tmp_path, monkeypatch):
    (tmp_path / "zig").symlink_to(cache.cache_folder() / "zig", target_is_directory=True)
    monkeypatch.setenv("EIGHTPOST_CACHE", str(tmp_path))
    system = SystemCompiler(shutil.which("cc") or pytest.skip("no system compiler"))
    (first,) = compile_libraries([LIBRARY], toolchain=system)
    for entry in (tmp_path / "binaries").iterdir():
        content = bytearray(entry.read_bytes())
        content[-5] ^= 1
        entry.write_bytes(content)
    (second,) = compile_libraries([LIBRARY], toolchain=system)
    assert first == second


def test_the_systems_compiler_builds_for_this_platform_and_says_so(tmp_path):
    system = SystemCompiler(shutil.which("cc") or pytest.skip("no system compiler"))
    (members,) = compile_libraries([LIBRARY], toolchain=system)
    assert list(members) == [this_platform().member("little")]
    assert "pip install 'eightpost[build]'" in system.limits and this_platform().name in system.limits
    path = tmp_path / "little.so"
    path.write_bytes(next(iter(members.values())))
    assert ctypes.CDLL(str(path)).fmi2Terminate(None) == 0


def test_this_platforms_library_runs(binaries, tmp_path):
    platform = this_platform()
    if platform.name not in PLATFORMS:
        pytest.skip(f"{platform.name} is none of the six")
    path = tmp_path / f"little{platform.suffix}"
    path.write_bytes(binaries[platform.member("little")])
    library = ctypes.CDLL(str(path))
    assert library.fmi2Terminate(None) == 0
    assert library.fmi2Reset((ctypes.c_double * 900)()) == 0


def test_a_mistake_in_the_source_is_reported_with_the_platform_and_the_compilers_words(zig):
    wrong = Library("wrong", {"wrong.c": b"int f(void) { return undeclared; }\n"})
    with pytest.raises(FmuError, match=r"wrong: zig .* could not compile it for linux64: .*undeclared"):
        compile_libraries([wrong], toolchain=zig)


def test_without_any_compiler_the_error_says_what_to_install(monkeypatch):
    monkeypatch.setattr("builder.native.toolchain._zig", lambda: None)
    monkeypatch.setenv("PATH", "")
    monkeypatch.delenv("CC", raising=False)
    with pytest.raises(FmuError, match=r"pip install 'eightpost\[build\]'.*--target python"):
        find_toolchain()


def test_a_universal_file_takes_mach_o_slices_only():
    with pytest.raises(ValueError, match="no 64-bit Mach-O"):
        universal([struct.pack("<Iii", 0x7F454C46, 0, 0)])
