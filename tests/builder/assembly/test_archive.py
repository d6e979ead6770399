"""The archive of an assembly is like that of a native FMU: clean, correct and reproducible."""

import shutil
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pytest

from builder.assembly import assemble
from builder.check import GROUPS, Level, check
from eightpost.archive import read_archive

from .hosts import replayed

#: Groups of every day: those that an assembly does not share with its parts.
DAILY = ("static", "tools", "simulation", "state", "initial_dependencies", "dependencies", "reference")


@pytest.mark.nightly
@pytest.mark.parametrize("daily", [True, pytest.param(False, marks=pytest.mark.nightly)], ids=["daily", "all groups"])
def test_check_reports_no_error_and_no_warning_for_an_assembly(corner, daily):
    not_for_it = {"ports", "model_exchange", "version_3"} | (set() if shutil.which("cmake") else {"rebuild"})
    groups = DAILY if daily else tuple(group for group in GROUPS if group not in not_for_it)
    report = check(corner, groups=groups)
    own = {f.rule.identifier: f.rule.level for f in report.findings} | {"platforms": Level.HINT}  # one platform here
    assert own == {"terminals": Level.HINT, "platforms": Level.HINT}
    assert report.done == tuple(GROUPS[group].title for group in groups)


def test_the_reference_results_of_a_quarter_car_equal_the_fmus_output(corner):
    outputs, found, expected = replayed(corner, 200)
    assert "coupling_error" in outputs and expected[-1, outputs.index("damper.coupling_error")] > 0.0
    np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-9 * np.abs(expected).max())


@pytest.mark.nightly
def test_the_same_assembly_gives_the_same_bytes(case, toolchain, tmp_path, car):
    again = assemble(case.wiring, tmp_path / "car_with_shocks.fmu", toolchain=toolchain)
    assert again.path.read_bytes() == car.read_bytes()


def test_the_paths_in_the_archive_are_those_of_a_native_fmu(car):
    members = set(read_archive(car))
    assert {"model.png", "documentation/index.html", "documentation/licenses/license.txt"} <= members
    listed = {f"sources/{f.get('name')}" for f in ET.fromstring(read_archive(car)["modelDescription.xml"]).iter("File")}
    assert listed == {m for m in members if m.endswith(".c")}
    assert Path(car).stat().st_size < 2_000_000
