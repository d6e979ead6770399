"""The header for C and C++ gives the bits of cosim.ForceLaw, compiles without warnings, and names every error."""

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from builder.toolchain import fmi_headers
from cosim import ExtrapolatedForce, ForceLaw, HeldForce
from cosim.components.fmu_file import FmuFile
from eightpost.archive import extract_archive
from eightpost.compilers import find_compiler
from eightpost.errors import FmuError

ROOT = Path(__file__).parents[2]
HOSTS = ROOT / "examples" / "hosts"
CALLS = Path(__file__).with_name("force_law_calls.c")
STRICT = ["-Wall", "-Wextra", "-pedantic", "-Werror"]
LIBRARIES = ["-lm", "-ldl"] if sys.platform == "linux" else ["-lm"]


@pytest.fixture(scope="module")
def compiler():
    try:
        return find_compiler()
    except FmuError:
        pytest.skip("there is no C compiler here")


@pytest.fixture(scope="module")
def program(compiler, tmp_path_factory):
    made = tmp_path_factory.mktemp("calls") / "calls"
    line = [*compiler, "-std=c99", *STRICT, "-I", str(HOSTS), str(CALLS), "-o", str(made), *LIBRARIES]
    subprocess.run(line, check=True)
    return made


@pytest.fixture(scope="module")
def unpacked(fmus, tmp_path_factory):
    folder = tmp_path_factory.mktemp("unpacked")
    extract_archive(fmus["lpnl2"], folder)
    return folder


def lines_of(program, *arguments):
    ran = subprocess.run([program, *map(str, arguments)], capture_output=True, text=True, check=True)
    assert ran.stderr == ""
    return ran.stdout.splitlines()


def expected(fmu, **parameters):
    """The numbers of force_law_calls.c, from the classes of cosim."""
    with ForceLaw(fmu, parameters=parameters) as law:
        found = [law.start(0.5, 0.1, 0.01), law.force(0.502, 0.2, 0.01), law.force(0.5, -0.1, 0.01)]
        found += [*law.jacobian(0.501, 0.15, 0.01), law.accept(0.501, 0.15, 0.012), law.force(0.503, 0.1, 0.01)]
        found.append(law.accept(0.503, 0.1, 0.01))
    with HeldForce(fmu, parameters=parameters) as loop:
        found.append(loop.start(0.0, 0.1, 0.01))
        found += [loop.step(0.0, 0.001, 0.2, 0.01), loop.step(0.001, 0.002, 0.3, 0.01)]
    with ExtrapolatedForce(fmu, parameters=parameters) as loop:
        found.append(loop.start(0.0, 0.1, 0.01))
        found += [
            loop.step(0.0, 0.001, 0.1, 0.01),
            loop.step(0.001, 0.001, 0.2, 0.01),
            loop.step(0.002, 0.002, 0.3, 0.01),
        ]
    return found


def test_the_header_gives_the_bits_of_cosim_and_names_every_error(program, unpacked, fmus):
    lines = lines_of(program, unpacked)
    errors = [line for line in lines if line.startswith("error: ")]
    assert [float(line) for line in lines if line not in errors][1:] == expected(fmus["lpnl2"], compression_scale=1.25)
    causes = ("call force_law_start first", "no variable no_such", "before the last accepted time", "not finite")
    causes += ("fmi2DoStep returned fmi2Discard", "begin where the last one ended, at 0.003 s")
    assert len(errors) == len(causes)
    for error, cause in zip(errors, causes, strict=True):
        assert cause in error
    assert "the FMU says: fmi2DoStep: the result is not finite" in errors[4]


@pytest.mark.parametrize(("arguments", "cause"), [
    (("/no/such/folder",), "cannot be read; unpack the .fmu"), (("{folder}", "speed"), "the FMU has no variable speed"),
])  # fmt: skip
def test_an_fmu_that_cannot_be_opened_is_refused_with_the_reason(program, unpacked, arguments, cause):
    (line,) = lines_of(program, *(argument.format(folder=unpacked) for argument in arguments))
    assert line.startswith("error: ") and cause in line


def test_a_missing_library_is_named(program, unpacked, tmp_path):
    shutil.copy(unpacked / "modelDescription.xml", tmp_path)
    (line,) = lines_of(program, tmp_path)
    assert "lpnl2" in line and "cannot be loaded" in line


@pytest.mark.repeated
@pytest.mark.parametrize("source", [CALLS, HOSTS / "c_host.c", HOSTS / "chrono_style.cpp"], ids=lambda path: path.name)
def test_the_sources_compile_as_cpp_without_warnings(source, tmp_path):
    compiler = shutil.which("g++") or shutil.which("clang++")
    if compiler is None:
        pytest.skip("there is no C++ compiler here")
    line = [compiler, "-x", "c++", "-std=c++11", *STRICT, "-I", str(HOSTS), "-c", str(source)]
    subprocess.run([*line, "-o", str(tmp_path / "o")], check=True)


def test_the_c_host_compiles_as_c99_without_warnings(compiler, tmp_path):
    source = HOSTS / "c_host.c"
    line = [*compiler, "-std=c99", *STRICT, "-Wconversion", "-Wshadow", "-c", str(source), "-o", str(tmp_path / "o")]
    subprocess.run(line, check=True)


def test_the_header_runs_clean_under_sanitizers(compiler, unpacked, program, tmp_path):
    made = tmp_path / "calls"
    checks = ["-g", "-fsanitize=address,undefined", "-fno-sanitize-recover=all"]
    line = [*compiler, "-std=c99", *checks, "-I", str(HOSTS), str(CALLS), "-o", str(made), *LIBRARIES]
    if subprocess.run(line, check=False, capture_output=True).returncode != 0:
        pytest.skip("this compiler has no sanitizers")
    assert lines_of(made, unpacked) == lines_of(program, unpacked)


@pytest.mark.nightly
def test_linked_sources_give_the_bits_of_the_library(compiler, unpacked, fmus, tmp_path):
    sources = [str(unpacked / "sources" / name) for name in FmuFile.unpacked(fmus["lpnl2"], unpacked).sources]
    objects = tmp_path / "objects"
    objects.mkdir()
    line = [*compiler, "-std=c99", "-O2", "-ffp-contract=off", "-DFMI2_FUNCTION_PREFIX=shock_"]
    line += ["-I", str(fmi_headers()), "-I", str(unpacked / "sources"), "-c", *sources]
    subprocess.run(line, check=True, cwd=objects)
    made = tmp_path / "linked"
    line = [*compiler, "-std=c99", *STRICT, "-DFORCE_LAW_PREFIX=shock_", "-I", str(HOSTS), str(CALLS)]
    subprocess.run([*line, *map(str, sorted(objects.iterdir())), "-o", str(made), "-lm"], check=True)
    guid = FmuFile.unpacked(fmus["lpnl2"], unpacked).description.guid
    numbers = [float(line) for line in lines_of(made, guid) if not line.startswith("error: ")]
    assert numbers == expected(fmus["lpnl2"])
