"""Fixtures: folders with the FMUs of the packages."""

import shutil

import numpy as np
import pytest
from fmpy import platform

from eightpost.archive import read_archive, write_archive
from eightpost.signals import TimeSeries, write_series


@pytest.fixture(scope="session")
def bare_fmus(tmp_path_factory, fmus):
    """The FMUs without documentation and sources: quick to open."""
    made = tmp_path_factory.mktemp("bare")
    for name in ("quarter_car", "lpnl2"):
        members = read_archive(fmus[name])
        kept = {
            n: c for n, c in members.items() if n == "modelDescription.xml" or n.startswith(f"binaries/{platform}/")
        }
        write_archive(made / f"{name}.fmu", kept)
    return made


@pytest.fixture
def folder(tmp_path, bare_fmus):
    """A folder with FMUs under resources/ and a drive file."""
    shutil.copytree(bare_fmus, tmp_path / "resources")
    time = np.linspace(0.0, 1.0, 101)
    road = 0.005 * np.sin(2 * np.pi * 3 * time)
    write_series(TimeSeries.from_channels(time, {"road": ("m", road)}), tmp_path / "road.csv")
    return tmp_path
