"""docs/development/add_a_law.md followed literally in a copy of the sources: a law is one file and one folder."""

import json
import os
import re
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from builder.build import _imported_files
from eightpost.shock import LAWS

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "development" / "add_a_law.md").read_text(encoding="utf-8")

#: `path`: and the block under it.
FILE = re.compile(r"^`([\w./]+)`:\n\n(`{3,})\w+\n(.*?)^\2$", re.MULTILINE | re.DOTALL)
#: Commands, each on its line.
COMMANDS = re.compile(r"^```sh\n(.*?)^```$", re.MULTILINE | re.DOTALL)

#: Builds both FMUs of the new law, drives them and compares with the law; every check must hold for any law.
USE = """
import sys
from pathlib import Path
import numpy as np
import builder.build, cosim, eightpost.shock as shock
from builder import toolchain
from builder.toolchain import this_platform
here = (this_platform(),)
toolchain.Zig.platforms = property(lambda self: here)
root = Path.cwd()
assert all(root in Path(m.__file__).parents for m in (builder.build, cosim, shock)), "not the copy"
(name,) = set(shock.LAWS) - set(sys.argv[1:])
law = shock.LAWS[name]
curve = shock.StaticCurve((1800.0, 60.0, -400.0, *[0.0] * 12), (1490.0, 900.0, 40.0, 5.0),
                          (-1400.0, -1100.0, -20.0, 3.0), 0.381, 0.0127, 1.2, 1.1, 3000.0, 3500.0)
own = {p.name: p.start for p in shock.fit_parameters(law)}
made = law(curve, **own)
assert shock.own_parameters(law) == tuple(own)
shock.write_shock(shock.Shock(name, made), root / f"{name}.json")
assert shock.read_shock(root / f"{name}.json").law == made
rng = np.random.default_rng(0)
moves = [(10.0 ** rng.uniform(-6, -2), v) for v in rng.uniform(-1.5, 1.5, 60)]
lagged, expected = made.static_force(0.0), []
for step, velocity in moves:
    lagged = made.follow(lagged, velocity, velocity, step)
    expected.append(made.response(lagged, velocity, 0.0).force)
for target in ("native", "python"):
    (built,) = builder.build.build([root / f"{name}.json"], root / target, target=target)
    fmu, time, forces = cosim.FmuComponent(built.path, name), 0.0, []
    fmu.begin(0.0, 10.0, {})
    fmu.end_initialization()
    for step, velocity in moves:
        fmu.set(("velocity",), (velocity,))
        fmu.step(time, step)
        time += step
        forces += fmu.get(("force",))
    fmu.finish()
    np.testing.assert_allclose(forces, expected, rtol=1e-12, atol=1e-9)
print(name)
"""

#: Runs commands in one process; `this` restricts the FMUs to this platform, without the rig and the check, which take
#: longer than all others.
CALL = """
import shlex, sys
from builder import toolchain
from builder.toolchain import this_platform
from eightpost.__main__ import main
here = (this_platform(),)
platforms, *lines = sys.argv[1:]
if platforms == "this":
    toolchain.Zig.platforms = property(lambda self: here)
    lines = [line for line in lines if line.split()[1] not in ("rig", "check")]
for line in lines:
    sys.argv = shlex.split(line)
    try:
        main()
    except SystemExit as end:
        assert not end.code, (line, end.code)
"""


@pytest.fixture(scope="module")
def copy(tmp_path_factory):
    """Return a copy of the sources with the files of the page."""
    folder = tmp_path_factory.mktemp("copy")
    for name in ("builder", "cosim", "docs", "eightpost", "examples", "fmus"):
        shutil.copytree(ROOT / name, folder / name)  # with the byte code, which many processes would compile again
    for path, _, content in FILE.findall(PAGE):
        file = folder / path
        assert not file.exists(), f"{path} is there already: the example is no new law"
        file.parent.mkdir(exist_ok=True)
        file.write_text(content, encoding="utf-8")
    return folder


def run(folder, *arguments):
    environment = os.environ | {"PYTHONPATH": str(folder)}
    ran = subprocess.run(
        [sys.executable, *arguments], cwd=folder, env=environment, capture_output=True, text=True, check=False
    )
    assert ran.returncode == 0, ran.stderr + ran.stdout
    return ran.stdout


def test_the_page_has_all_files_of_a_law():
    paths = [Path(path) for path, _, _ in FILE.findall(PAGE)]
    (law,) = [path for path in paths if path.parts[0] == "eightpost"]
    known = {p.name for p in (ROOT / "fmus" / "shock_lpf1").iterdir()}
    assert {p for p in paths if p != law} == {Path("fmus", f"shock_{law.stem}", name) for name in known}


@pytest.mark.nightly
def test_the_new_law_is_built_for_both_targets_and_both_are_the_law(copy):
    assert run(copy, "-c", USE, *LAWS).strip() == "share"


@pytest.mark.nightly
def test_the_tables_of_the_documentation_include_the_new_law(copy):
    (command,) = (line for block in COMMANDS.findall(PAGE) for line in block.splitlines() if line.startswith("python "))
    run(copy, *command.split()[1:])
    page = (copy / "docs" / "reference" / "ports.md").read_text(encoding="utf-8")
    assert "### shock_share\n" in page and "| `lag_share` | 21 |" in page


def test_the_frozen_references_of_the_page_are_those_of_its_interface():
    (frozen,) = re.findall(r"^```toml frozen\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL)
    (interface,) = (tomllib.loads(text) for path, _, text in FILE.findall(PAGE) if path.endswith("interface.toml"))
    (name,), (rows,) = tomllib.loads(frozen).keys(), tomllib.loads(frozen).values()
    assert name == interface["law"]
    assert rows.pop("interface") == f"{interface['interface']} {interface['version']}"
    assert rows == {v["name"]: v["reference"] for v in interface["variable"]}


@pytest.mark.nightly
@pytest.mark.parametrize("platforms", ["this", pytest.param("all", marks=pytest.mark.nightly)])
def test_the_commands_of_the_page_use_it_everywhere(copy, platforms):
    lines = [line for block in COMMANDS.findall(PAGE) for line in block.splitlines() if line.startswith("eightpost ")]
    assert [line.split()[1] for line in lines] == ["fit", "build", "build", "check", "run", "virtual"]
    run(copy, "-c", CALL, platforms, *lines)
    shock = json.loads((copy / "dist" / "dyno_A.json").read_text(encoding="utf-8"))
    assert shock["law"] == "share"
    assert 0.0 < shock["parameters"]["lag_share"] <= 1.0


@pytest.mark.parametrize("law", LAWS)
def test_a_law_and_what_it_ships_are_standard_library_only(law):
    files = _imported_files(ROOT / "eightpost" / "shock" / f"{law}.py")
    assert len(files) > 1
    for file in files:
        text = file.read_text(encoding="utf-8")
        names = set(re.findall(r"^\s*(?:from|import) ([\w]+)", text, re.MULTILINE))
        assert names <= set(sys.stdlib_module_names), file.name
