"""The virtual rig and the virtual dynamometer are configured by names, as in their commands."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from eightpost.errors import InputError, ParameterError
from eightpost.rig.motion import run_down
from eightpost.signals import read_series
from eightpost.virtual import LinearDamper, configuration
from eightpost.virtual.dynamometer import Specimen, drivefile_of
from eightpost.virtual.program import Bench
from eightpost.virtual.shocks import shocks_named


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
    with pytest.raises(ParameterError, match=r"--set duration must be 0\.5 to 600 s, not 0\.1 s"):
        drivefile_of("random", 1, duration=0.1)
    with pytest.raises(ParameterError, match=r"--set amplitude of the random test .* at most 2 in, not 2\.5 in"):
        drivefile_of("random", 1, duration=1.0, amplitude=0.0635)
    with pytest.raises(ParameterError, match=r"--set amplitude of the random test must be above 0"):
        drivefile_of("random", 1, duration=1.0, amplitude=0.0)


def test_a_planned_test_has_the_alternate_shock_at_its_corner() -> None:
    planned = SimpleNamespace(alternate="rf", draw=lambda: "drive", drivefile="random 2")
    bench = SimpleNamespace(car=SimpleNamespace(corners=("lf", "rf", "lr", "rr")), record=lambda *words: words)
    found = Bench.record_planned(bench, planned, 5, ["a", "b", "c", "d"], "other")
    assert found == ("drive", ["a", "other", "c", "d"], "random 2", 5)


def test_a_sine_runs_down_if_its_last_cycles_fade_but_not_if_another_steady_sine_follows() -> None:
    time = np.arange(12_000) / 1000.0
    steady, phase = time < 8.0, 4.0 * np.pi * time
    fading = np.sin(phase) * np.where(steady, 1.0, np.exp(-2.0 * (time - 8.0)))
    smaller = np.sin(phase) * np.where(steady, 1.0, 0.3)
    assert run_down(time, fading, np.gradient(fading, time)) == pytest.approx(8.0, abs=0.5)
    assert run_down(time, smaller, np.gradient(smaller, time)) is None
    assert run_down(time, np.sin(phase), np.gradient(np.sin(phase), time)) is None
    assert run_down(time[:100], fading[:100], np.gradient(fading, time)[:100]) is None
