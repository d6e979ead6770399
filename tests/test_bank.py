"""The shipped bank is the output of its script."""

import importlib.util
import json
from pathlib import Path

import numpy as np
import pytest

from eightpost.shock import read_shock
from eightpost.virtual import BUILDS

EXAMPLES = Path(__file__).resolve().parents[1] / "examples"


def test_there_is_a_shock_for_every_build_of_table_7_3():
    assert sorted(path.stem for path in (EXAMPLES / "bank").iterdir()) == sorted(b.replace("/", "_") for b in BUILDS)


@pytest.mark.nightly
def test_a_build_of_the_bank_is_reproduced_by_its_script(tmp_path):
    spec = importlib.util.spec_from_file_location("make_bank", EXAMPLES / "make_bank.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    made = module.make("B/B", 101 + BUILDS.index("B/B"), tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["B_B.json"]
    shipped = EXAMPLES / "bank" / "B_B.json"
    velocities = np.linspace(-1.0, 1.0, 81)
    found, expected = (np.array([read_shock(path).law.curve.force(v) for v in velocities]) for path in (made, shipped))
    # Bits may differ between versions of numpy and scipy; the curve may not.
    assert np.abs(found - expected).max() < 5e-4 * np.ptp(expected)
    assert json.loads(shipped.read_text())["law"] == "lpnl2"
