"""A study whose shock ends or blocks its worker ends with a message and exit code 1, whoever made the shock."""

from pathlib import Path

import pytest
from click.testing import CliRunner

from eightpost.__main__ import main

from . import test_shocks_as_force_laws as shocks
from . import version_2

TRACK = Path(__file__).resolve().parents[3] / "examples" / "data" / "track.parquet"

STUDY = """
name = "odd"
families = ["numbers"]
settling = "1 s"

[vehicle]
fmu = "{car}"
means = "trusted"

[bank]
odd = "{shock}"

[corners]
lf = ["odd"]
rf = ["odd"]
lr = ["odd"]
rr = ["odd"]

[[drive]]
file = "{track}"
stop = "3 s"
"""


@pytest.mark.slow
@pytest.mark.parametrize(("last", "message"), [
    ("_exit(0)", "a worker process crashed while it chose the coupling, so an FMU crashes"),
    ("for (;;)", "a worker process was not responding for 3 s while it chose the coupling, so an FMU hangs"),
])  # fmt: skip
@pytest.mark.repeated("_exit(0)")
def test_a_study_with_such_a_shock_has_no_result(last, message, foreign_compiler, fmus, tmp_path):
    library = foreign_compiler(tmp_path / "shock.so", f"-DLAST={last}", source=shocks.SOURCE)
    names = {"piston.speed": "velocity", "piston.travel": "displacement", "rod.force": "force"}
    variables = [(names[name], *others) for name, *others in shocks.VARIABLES]
    flags = " ".join((shocks.RAMPS, shocks.STATES, shocks.ANY_STEP))
    tool = 'generationTool="eightpost 9"'
    version_2.write(tmp_path / "odd.fmu", library, "shock", variables, flags=flags, attributes=tool)
    study = tmp_path / "study.toml"
    study.write_text(STUDY.format(car=fmus["seven_dof"], shock=tmp_path / "odd.fmu", track=TRACK))
    options = ["-o", str(tmp_path / "out"), "--workers", "1", "--patience", "3 s"]
    done = CliRunner().invoke(main, ["study", str(study), *options])
    assert done.exit_code == 1
    assert message in " ".join(done.stderr.split())
    assert not (tmp_path / "out" / "results.parquet").exists()
