"""The virtual rig and the virtual dynamometer are configured by names, as in their commands."""

from __future__ import annotations

from pathlib import Path

import pytest

from eightpost.errors import InputError, ParameterError
from eightpost.rig import configuration
from eightpost.rig.dynamometer import Specimen, drivefile_of
from eightpost.rig.post import LinearDamper
from eightpost.rig.post.bench import Bench
from eightpost.rig.post.shocks import shocks_named
from eightpost.signals import read_series


def test_a_shock_is_found_by_its_name() -> None:
    found = shocks_named(["configuration:3", "2 N.s/mm", "configuration:3"])
    assert list(found) == ["configuration:3", "2 N.s/mm"]
    assert found["configuration:3"] == configuration(3)
    assert found["2 N.s/mm"] == LinearDamper(2000.0)


@pytest.mark.parametrize(
    ("name", "error"),
    [("configuration:13", InputError), ("build:Z", InputError), ("soft", InputError), ("-1 N.s/m", ParameterError)],
)
def test_a_shock_that_does_not_exist_is_refused(name: str, error: type[Exception]) -> None:
    with pytest.raises(error, match="--shock"):
        shocks_named([name])


def test_a_single_shock_is_used_at_every_corner() -> None:
    bench = Bench.of("seven_dof", noise=False, seed=7)
    assert bench.shocks(["demo:A"]) == ("demo:A",) * 4
    assert bench.shocks(["a", "b", "c", "d"]) == ("a", "b", "c", "d")
    assert "seven_dof, friction on, noise none, drivefile seed 7" in bench.note
    with pytest.raises(InputError, match="once or 4 times, not 2 times"):
        bench.shocks(["a", "b"])


def test_a_specimen_writes_its_record_and_describes_it(tmp_path: Path) -> None:
    specimen = Specimen.built("C/B", clicks=14)
    assert specimen.title.startswith("C/B, 150 psi, 14 clicks; nominal damping")
    sine = drivefile_of("sine", 1, amplitude=0.01, speed=0.1)
    text = specimen.test(sine, "sine", 1, tmp_path / "sine.csv")
    assert text.startswith("sine: ") and text.endswith(f"wrote {tmp_path / 'sine.csv'}")
    assert {"displacement", "velocity", "force", "temperature"} <= set(read_series(tmp_path / "sine.csv").names)


def test_a_random_tests_duration_must_be_half_a_second_to_ten_minutes() -> None:
    with pytest.raises(ParameterError, match=r"--duration must be 0\.5 to 600 s, not 0\.1 s"):
        drivefile_of("random", 1, duration=0.1)
