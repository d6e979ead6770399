"""The folder sources/ of an archive compiles without any other file, for libraries and for programs of several FMUs."""

import ctypes
import re
import shutil
import subprocess
import xml.etree.ElementTree as ET
from pathlib import Path

import pytest
from fmpy import read_model_description
from fmpy.model_description import read_build_description

from eightpost.archive import extract_archive, read_archive
from eightpost.shock import LAWS

HERE = Path(__file__).parent
ARCHIVES = (*LAWS, "seven_dof", "quarter_car")

#: FMUs of every day: the law with the most sources, and the vehicle.
DAILY = ("hysteresis", "seven_dof")
HEADERS = {"fmi2Functions.h", "fmi2FunctionTypes.h", "fmi2TypesPlatform.h"}


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


@pytest.fixture(scope="module")
def unpacked(fmus, tmp_path_factory):
    """Return unpacked FMUs by name."""
    found = {name: tmp_path_factory.mktemp(name) for name in ARCHIVES}
    for name, folder in found.items():
        extract_archive(fmus[name], folder)
    return found


def sources(folder):
    return sorted((folder / "sources").glob("*.c"))


def names(path, *options):
    ran = subprocess.run(["nm", *options, str(path)], capture_output=True, text=True, check=True)
    return {line.split()[-1] for line in ran.stdout.splitlines()}


@pytest.mark.repeated
@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=() if name in DAILY else pytest.mark.nightly) for name in ARCHIVES]
)
def test_a_compiler_without_options_makes_a_library_with_the_functions_of_the_shipped_one(name, unpacked, cc, tmp_path):
    cc("-shared", "-fPIC", *sources(unpacked[name]), "-o", tmp_path / "bare.so")
    library = ctypes.CDLL(str(tmp_path / "bare.so"))
    shipped = next((unpacked[name] / "binaries").glob("*/*.so"))
    functions = {n for n in names(shipped, "-D", "--defined-only") if n.startswith("fmi2")}
    assert len(functions) >= 34 and all(hasattr(library, function) for function in functions)


def prefixed(cc, folder, output, *options):
    """Compile an FMU's sources for a program; return the objects."""
    output.mkdir()
    for source in sources(folder):
        cc("-c", "-fno-pie", *options, source, "-o", output / f"{source.stem}.o")
    return sorted(output.glob("*.o"))


def coupled(cc, unpacked, program, objects, car, shock):
    """Return the output of two_fmus.c with prefixes of the quarter car and of lpnl2."""
    described = {name: read_model_description(str(unpacked[name])) for name in ("quarter_car", "lpnl2")}
    of = {name: {v.name: v.valueReference for v in found.modelVariables} for name, found in described.items()}
    numbers = {
        "CAR_ROAD": of["quarter_car"]["road"],
        "CAR_FORCE": of["quarter_car"]["force"],
        "CAR_VELOCITY": of["quarter_car"]["velocity"],
        "SHOCK_VELOCITY": of["lpnl2"]["velocity"],
        "SHOCK_FORCE": of["lpnl2"]["force"],
    }
    texts = {"CAR_GUID": described["quarter_car"].guid, "SHOCK_GUID": described["lpnl2"].guid}
    given = [f"-D{key}={value}" for key, value in {"CAR": car, "SHOCK": shock, **numbers}.items()]
    given += [f'-D{key}="{value}"' for key, value in texts.items()]
    source = HERE / "two_fmus.c"
    cc("-std=c99", "-Wall", "-Wextra", "-Werror", "-no-pie", *given, "-I", unpacked["lpnl2"] / "sources", source,
       *objects, "-o", program)  # fmt: skip
    return subprocess.run([program], capture_output=True, text=True, check=True).stdout


@pytest.mark.nightly
def test_two_fmus_link_into_one_program_without_options_and_with_prefixes_of_the_host(unpacked, cc, tmp_path):
    own = [o for n in ("quarter_car", "lpnl2") for o in prefixed(cc, unpacked[n], tmp_path / n)]
    first = coupled(cc, unpacked, tmp_path / "first", own, "quarter_car_", "lpnl2_")
    renamed = [
        o
        for prefix, name in (("a_", "quarter_car"), ("b_", "lpnl2"))
        for o in prefixed(cc, unpacked[name], tmp_path / prefix, f"-DFMI2_FUNCTION_PREFIX={prefix}")
    ]
    force, velocity = map(float.fromhex, first.split())
    assert abs(force) > 1.0 and abs(velocity) > 1e-3
    assert coupled(cc, unpacked, tmp_path / "second", renamed, "a_", "b_") == first


@pytest.mark.repeated(2)
@pytest.mark.parametrize(
    ("options", "name"),
    [
        ((), "lpf1_fmi2DoStep"),
        (("-DFMI2_FUNCTION_PREFIX=",), "fmi2DoStep"),
        (("-DFMI2_FUNCTION_PREFIX=my_",), "my_fmi2DoStep"),
        (("-DFMI2_OVERRIDE_FUNCTION_PREFIX",), "fmi2DoStep"),
        (("-DFMI2_OVERRIDE_FUNCTION_PREFIX", "-DFMI2_ACTUAL_FUNCTION_PREFIX=my_"), "my_fmi2DoStep"),
        (("-Dlpf1_EXPORTS",), "fmi2DoStep"),
        (("-D_WINDLL",), "fmi2DoStep"),
        (("-fPIE",), "lpf1_fmi2DoStep"),
        (("-fPIC",), "fmi2DoStep"),
    ],
)
def test_the_prefix_is_the_model_identifier_in_programs_nothing_in_libraries_and_what_a_host_defines(
    options, name, unpacked, cc, tmp_path
):
    cc("-c", "-fno-pie", *options, unpacked["lpf1"] / "sources" / "step.c", "-o", tmp_path / "step.o")
    assert name in names(tmp_path / "step.o", "--defined-only")


@pytest.mark.parametrize("name", ARCHIVES)
def test_the_build_description_lists_the_c_files_of_the_model_description(name, unpacked):
    (configuration,) = read_build_description(str(unpacked[name]))  # checks the schema of FMI 3.0
    (file_set,) = configuration.sourceFileSets
    root = ET.parse(unpacked[name] / "modelDescription.xml").getroot()
    assert configuration.modelIdentifier == name and file_set.language == "C99"
    for kind in ("ModelExchange", "CoSimulation"):
        assert file_set.sourceFiles == [f.get("name") for f in root.iterfind(f"{kind}/SourceFiles/File")]
    assert file_set.sourceFiles == [path.name for path in sources(unpacked[name])]


def words(text):
    return " ".join(re.sub(r"[^\w.,;:()/@\"-]", " ", text).split())


@pytest.mark.parametrize("name", ["lpnl2", "seven_dof"])
def test_the_fmi_headers_are_included_with_their_licence(name, fmus):
    members = read_archive(fmus[name])
    licence = members["documentation/licenses/fmi_headers.txt"].decode()
    terms = words(licence[licence.index("Copyright") :])
    for header in HEADERS:
        assert header in licence and terms in words(members[f"sources/{header}"].decode()), header
