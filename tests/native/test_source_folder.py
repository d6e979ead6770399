"""The folder sources/ of an archive compiles without any other file, for libraries and for programs of several FMUs."""

import ctypes
import os
import re
import shutil
import subprocess
import xml.etree.ElementTree as ET
from pathlib import Path

import lief
import pytest
from fmpy import read_model_description
from fmpy.model_description import read_build_description

from builder.build import build
from builder.toolchain import PLATFORMS, Zig, find_toolchain, fmi_headers, headers_of, this_platform
from eightpost.archive import read_archive
from eightpost.shock import LAWS
from eightpost.vehicle import shipped

HERE = Path(__file__).parent
ALL = (*LAWS, "seven_dof", "quarter_car", "assembly")
SANITIZERS = ("-g", "-O1", "-fsanitize=address,undefined,float-cast-overflow", "-fno-sanitize-recover=all")

#: FMUs of every day by version: the law with the most sources, and the vehicle; compilation takes most of the time.
DAILY = ((2, "hysteresis"), (2, "seven_dof"))
EACH = [
    pytest.param(fmi, name, marks=() if (fmi, name) in DAILY else pytest.mark.nightly) for fmi in (2, 3) for name in ALL
]


def functions(fmi):
    """Return the functions of an FMI version from its header file."""
    return set(re.findall(rf"\bfmi{fmi}\w+(?=\s+fmi3FullName)|(?<=#define )fmi{fmi}\w+(?=\s+fmi2FullName)",
                          (fmi_headers() / f"fmi{fmi}Functions.h").read_text()))  # fmt: skip


@pytest.fixture
def folder_of(folders, folders_3):
    """Return the unpacked FMU of a version and name."""
    return lambda fmi, name: (folders, folders_3)[fmi - 2][name]


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


def sources(folder):
    return sorted((folder / "sources").glob("*.c"))


def symbols(path, kinds):
    if shutil.which("nm") is None:
        pytest.skip("no nm on this machine")
    ran = subprocess.run(["nm", str(path)], capture_output=True, text=True, check=True)
    return {line.split()[-1] for line in ran.stdout.splitlines() if line.split()[-2] in kinds}


# ---- The code that FMI 3.0 adds -------------------------------------------------------------------------------------


@pytest.fixture(scope="session")
def objects_3(source_folders_3, compiler, tmp_path_factory):
    """Compile the sources of FMI 3.0 with all warnings; return the objects by name."""
    folder, output = source_folders_3["lpnl2"], tmp_path_factory.mktemp("objects")
    return {
        source.name: compiler(folder, ["-O1", "-fno-pie", "-c", str(source)], output / f"{source.stem}.o")
        for source in sorted(folder.glob("fmi3_*.c"))
    }


def test_the_sources_compile_without_warnings_and_define_all_functions(objects_3):
    defined = set().union(*(symbols(path, "T") for path in objects_3.values()))
    assert {name for name in defined if name.startswith("fmi3")} == functions(3)
    assert len(functions(3)) == 75


def test_there_is_no_writable_global_and_only_instantiation_allocates_memory(objects_3):
    pure = {"memcpy", "memset", "memcmp", "strcmp", "strncmp", "strlen"}
    assert "fmi3_lifecycle.c" in objects_3 and any(symbols(path, "T") for path in objects_3.values())
    for name, path in objects_3.items():
        assert not symbols(path, "BbCDdGgSs"), name
        own = {s for s in symbols(path, "U") if not s.startswith(("fmi", "_GLOBAL", "__stack_chk"))}
        known = {"say", "refused", "entered", "all_known", "derivable", "core_of", "refused3", "has_all_values",
                 "accepts_no_other", "is_next_step", "out_of_phase", "variables", "variable_of_reference"}  # fmt: skip
        assert own - known <= pure | ({"calloc", "free"} if name == "fmi3_lifecycle.c" else set()), name


@pytest.mark.nightly
@pytest.mark.parametrize("model", (*ALL, "car_with_friction"))
def test_random_call_sequences_cause_no_sanitizer_finding(model, source_folders_3, compiler, tmp_path):
    """A short run; `make nightly` makes a million calls per FMU."""
    folder = source_folders_3[model]
    options = ["-DLONGEST_STEP=1.0"] if model == "assembly" else []
    options += [*SANITIZERS, "-Wno-conversion", *map(str, folder.glob("*.c")), str(HERE / "call_sequences_3.c")]
    program = compiler(folder, options, tmp_path / "call_sequences")
    calls = os.environ.get("EIGHTPOST_CALLS", "100000")
    ran = subprocess.run([program, calls, "1"], capture_output=True, text=True, check=False)
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
    assert counted["foreign state"][0] > 500 and counted["foreign state"][1] == 0
    nested = {name: calls for name, calls in counted.items() if name.startswith("nested")}
    assert len(nested) == 8 and all(calls[0] > 20 and calls[1] == 0 for calls in nested.values())


@pytest.mark.parametrize("name", ALL)
def test_the_library_exports_the_functions_of_fmi_3_and_nothing_else(name, folders_3):
    library = lief.parse(str(folders_3[name] / this_platform().member(name, 3)))
    assert {symbol.name for symbol in library.exported_symbols} == functions(3)


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
            assert exported == functions(3), name


@pytest.mark.repeated
@pytest.mark.parametrize(("fmi", "name"), EACH)
def test_a_compiler_without_options_makes_a_library_with_the_functions_of_the_shipped_one(
    fmi, name, folder_of, cc, tmp_path
):
    cc("-shared", "-fPIC", *sources(folder_of(fmi, name)), "-o", tmp_path / "bare.so")
    library = ctypes.CDLL(str(tmp_path / "bare.so"))
    assert len(functions(fmi)) >= 34 and all(hasattr(library, function) for function in functions(fmi))
    assert hasattr(library, "fmi2DoStep") == (fmi == 2)


def words(text):
    return " ".join(re.sub(r"[^\w.,;:()/@\"-]", " ", text).split())


@pytest.mark.parametrize("fmi", [2, 3])
@pytest.mark.parametrize("name", ["hysteresis", "seven_dof", "assembly"])
def test_the_build_description_lists_the_c_files_and_the_headers_come_with_their_licence(fmi, name, folder_of):
    folder = folder_of(fmi, name)
    (configuration,) = read_build_description(str(folder))  # checks the schema of FMI 3.0
    (file_set,) = configuration.sourceFileSets
    assert configuration.modelIdentifier == name and file_set.language == "C99"
    assert file_set.sourceFiles == [path.name for path in sources(folder)]
    root = ET.parse(folder / "modelDescription.xml").getroot()
    for kind in ("ModelExchange", "CoSimulation") if fmi == 2 else ():
        assert file_set.sourceFiles == [f.get("name") for f in root.iterfind(f"{kind}/SourceFiles/File")]
    licence = (folder / "documentation" / "licenses" / "fmi_headers.txt").read_text()
    for header in headers_of(fmi):
        text = (folder / "sources" / header).read_text()
        assert text == (fmi_headers() / header).read_text()
        assert header in licence
        assert words(text[text.index("Redistribution and use") : text.index("OF SUCH DAMAGE")]) in words(licence)
        assert re.search(r"\d+-(\d+) Modelica Association", text)[1] in licence


# ---- Programs of several FMUs ---------------------------------------------------------------------------------------


def prefixed(cc, folder, output, *options):
    """Compile an FMU's sources for a program; return the objects."""
    output.mkdir()
    for source in sources(folder):
        cc("-c", "-fno-pie", *options, source, "-o", output / f"{source.stem}.o")
    return sorted(output.glob("*.o"))


def output_of(cc, path, program, folder, objects, **definitions):
    """Return the lines that a program of this folder prints."""
    given = [f"-D{key}={value}" for key, value in definitions.items()]
    cc("-std=c99", "-Wall", "-Wextra", "-Werror", "-no-pie", *given, "-I", folder / "sources", HERE / program,
       *objects, "-o", path)  # fmt: skip
    return subprocess.run([path], capture_output=True, text=True, check=True).stdout.split()


@pytest.mark.nightly
def test_two_fmus_link_into_one_program_without_options_and_with_prefixes_of_the_host(folders, cc, tmp_path):
    described = {name: read_model_description(str(folders[name])) for name in ("quarter_car", "lpnl2")}
    of = {name: {v.name: v.valueReference for v in found.modelVariables} for name, found in described.items()}
    car, shock = of["quarter_car"], of["lpnl2"]
    numbers = {"CAR_ROAD": car["road"], "CAR_FORCE": car["force"], "CAR_VELOCITY": car["velocity"]}
    numbers |= {"SHOCK_VELOCITY": shock["velocity"], "SHOCK_FORCE": shock["force"]}
    numbers |= {"CAR_GUID": f'"{described["quarter_car"].guid}"', "SHOCK_GUID": f'"{described["lpnl2"].guid}"'}
    found = []
    for prefixes in (("quarter_car_", "lpnl2_"), ("a_", "b_")):
        objects = []
        for prefix, name in zip(prefixes, ("quarter_car", "lpnl2"), strict=True):
            options = () if prefix == f"{name}_" else (f"-DFMI2_FUNCTION_PREFIX={prefix}",)
            objects += prefixed(cc, folders[name], tmp_path / prefix, *options)
        path, names = tmp_path / f"program_{prefixes[0]}", {"CAR": prefixes[0], "SHOCK": prefixes[1]}
        found.append(output_of(cc, path, "two_fmus.c", folders["lpnl2"], objects, **names, **numbers))
    force, velocity = map(float.fromhex, found[0])
    assert abs(force) > 1.0 and abs(velocity) > 1e-3
    assert found[0] == found[1]


@pytest.mark.nightly
def test_fmus_of_both_versions_link_into_one_program_also_twice_the_same_with_other_prefixes(
    folders, folders_3, cc, tmp_path
):
    old, new, other = (
        read_model_description(str(f)) for f in (folders["lpnl2"], folders_3["lpnl2"], folders_3["lpf1"])
    )
    keys = {"OLD_GUID": f'"{old.guid}"', "FIRST_TOKEN": f'"{new.instantiationToken}"'}
    keys["SECOND_TOKEN"] = f'"{other.instantiationToken}"'

    def program(path, objects, first, second):
        return output_of(cc, path, "three_fmus.c", folders_3["lpnl2"], objects, FIRST=first, SECOND=second, **keys)

    first = prefixed(cc, folders["lpnl2"], tmp_path / "old")
    own = [o for name in ("lpnl2", "lpf1") for o in prefixed(cc, folders_3[name], tmp_path / name)]
    found = program(tmp_path / "first", [*first, *own], "lpnl2_", "lpf1_")
    assert found[0] == found[1] != found[2]
    assert abs(float.fromhex(found[0])) > 1.0 and abs(float.fromhex(found[2])) > 1.0
    # Two FMUs of one name: their cores differ because the prefixes of the host do.
    text = (folders_3["lpf1"] / "sources" / "prefix.h").read_text()
    shutil.copytree(folders_3["lpf1"] / "sources", tmp_path / "twin" / "sources")
    (tmp_path / "twin" / "sources" / "prefix.h").write_text(text.replace("lpf1", "lpnl2"))
    renamed = prefixed(cc, folders_3["lpnl2"], tmp_path / "a", "-DFMI3_FUNCTION_PREFIX=a_")
    renamed += prefixed(cc, tmp_path / "twin", tmp_path / "b", "-DFMI3_OVERRIDE_FUNCTION_PREFIX",
                        "-DFMI3_ACTUAL_FUNCTION_PREFIX=b_")  # fmt: skip
    assert program(tmp_path / "second", [*first, *renamed], "a_", "b_") == found


@pytest.mark.repeated(2)
@pytest.mark.parametrize("fmi", [3, 2])
@pytest.mark.parametrize(
    ("options", "prefix"),
    [
        ((), "lpf1_"),
        (("-DFMI{0}_FUNCTION_PREFIX=",), ""),
        (("-DFMI{0}_FUNCTION_PREFIX=my_",), "my_"),
        (("-DFMI{0}_OVERRIDE_FUNCTION_PREFIX",), ""),
        (("-DFMI{0}_OVERRIDE_FUNCTION_PREFIX", "-DFMI{0}_ACTUAL_FUNCTION_PREFIX=my_"), "my_"),
        (("-Dlpf1_EXPORTS",), ""),
        (("-D_WINDLL",), ""),
        (("-fPIE",), "lpf1_"),
        (("-fPIC",), ""),
    ],
)
def test_the_prefix_is_the_model_identifier_in_programs_nothing_in_libraries_and_what_a_host_defines(
    options, prefix, fmi, folder_of, cc, tmp_path
):
    source = folder_of(fmi, "lpf1") / "sources" / ("step.c" if fmi == 2 else "fmi3_step.c")
    cc("-c", "-fno-pie", *(option.format(fmi) for option in options), source, "-o", tmp_path / "step.o")
    assert f"{prefix}fmi{fmi}DoStep" in symbols(tmp_path / "step.o", "T")
    if fmi == 3:  # the core is not the host's: its prefix is that of the FMU unless the host defines one
        stated = any("FUNCTION_PREFIX=" in option for option in options)
        assert f"{prefix if stated else 'lpf1_'}core_fmi2DoStep" in symbols(tmp_path / "step.o", "U")
