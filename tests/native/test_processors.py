"""The sources give the same bits on other processors, emulated by qemu, as the shipped binary on this one.

zig compiles the C library of each processor once, which takes minutes: `make nightly`.
"""

import os
import shutil
import subprocess
from pathlib import Path

import pytest

from builder.toolchain import FLAGS, Zig, find_toolchain
from eightpost.cache import cache_folder
from eightpost.shock import LAWS

MODELS = (*LAWS, "seven_dof", "quarter_car")

#: Models of every day: the law with the most operations, and the vehicle.
DAILY = ("hysteresis", "quarter_car")
HERE = Path(__file__).parent
STEPS = 500

#: Emulator and target of zig: 32-bit ARM; RISC-V, which has fused operations; PowerPC, which has the other byte order.
PROCESSORS = {
    "arm": "arm-linux-musleabihf",
    "riscv64": "riscv64-linux-musl",
    "riscv32": "riscv32-linux-musl",
    "ppc": "powerpc-linux-musleabihf",
}


@pytest.fixture(scope="session", params=PROCESSORS)
def processor(request):
    """Return a function that compiles a program for another processor, and the command that runs it."""
    emulator = shutil.which(f"qemu-{request.param}") or shutil.which(f"qemu-{request.param}-static")
    if emulator is None:
        pytest.skip(f"qemu-{request.param} is not installed (apt-get install qemu-user)")
    zig = find_toolchain()
    if not isinstance(zig, Zig):
        pytest.skip("zig is not installed (pip install 'eightpost[build]')")

    def build(folder, output):
        files = [*sorted((folder / "sources").glob("*.c")), HERE / "random_ramps.c"]
        line = [zig.path, "cc", "-target", PROCESSORS[request.param], "-static", *FLAGS, "-Wall", "-Wextra", "-Werror"]
        ran = subprocess.run(
            [*line, f"-I{folder / 'sources'}", *map(str, files), "-o", str(output)],
            capture_output=True,
            text=True,
            check=False,
            env=os.environ | {"ZIG_GLOBAL_CACHE_DIR": str(cache_folder() / "zig")},
        )
        assert ran.returncode == 0, ran.stderr[:2000]
        return [emulator, str(output)]

    return build


def runs(command):
    """Return the references of inputs and outputs, and a row of numbers per step."""
    ran = subprocess.run([*command, str(STEPS)], capture_output=True, text=True, check=True)
    inputs, outputs, *rows = (line.split() for line in ran.stdout.splitlines())
    return list(map(int, inputs)), list(map(int, outputs)), [list(map(float.fromhex, row)) for row in rows]


def assert_equals_the_shipped_binary(command, instance):
    """Give the shipped binary the inputs of the program, and compare outputs bit for bit."""
    references, outputs, rows = runs(command)
    name = {reference: variable for variable, reference in instance.references.items()}
    inputs, wanted = [name[r] for r in references], [name[r] for r in outputs]
    time, count = 0.0, len(inputs)
    instance.start()
    assert len(rows) == STEPS
    for row in rows:
        step, values, slopes, results = row[0], row[1 : 1 + count], row[1 + count : 1 + 2 * count], row[1 + 2 * count :]
        assert instance.set_named(dict(zip(inputs, values, strict=True))) == 0
        assert instance.set_slopes(dict(zip(inputs, slopes, strict=True))) == 0
        assert instance.step(time, step) == 0
        assert instance.get(*wanted) == results
        time += step


@pytest.mark.repeated
@pytest.mark.slow
@pytest.mark.parametrize(
    "model", [pytest.param(name, marks=() if name in DAILY else pytest.mark.nightly) for name in MODELS]
)
def test_the_program_of_the_comparison_equals_the_shipped_binary_on_this_processor(
    model, folders, compiler, host, tmp_path
):
    files = [*map(str, sorted((folders[model] / "sources").glob("*.c"))), str(HERE / "random_ramps.c")]
    program = compiler(folders[model] / "sources", ["-O2", *files], tmp_path / "random_ramps")
    assert_equals_the_shipped_binary([program], host(model))


@pytest.mark.nightly
@pytest.mark.parametrize("model", MODELS)
def test_another_processor_gives_the_same_bits(model, folders, processor, host, tmp_path):
    assert_equals_the_shipped_binary(processor(folders[model], tmp_path / "random_ramps"), host(model))
