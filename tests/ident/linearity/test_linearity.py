"""Tests that paths are classified as in Table 6.4, and that responses that depend on the amplitude are reported."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from eightpost.__main__ import main
from eightpost.errors import InputError, ParameterError, TooShortError
from eightpost.ident import linearity_plots
from eightpost.ident.linearity import (
    Condition,
    Linearity,
    Thresholds,
    _shock_change,
    _shock_excitation,
    judge_linearity,
)
from eightpost.ident.preparation import prepare
from eightpost.ident.vehicle.estimators import LocalPolynomial
from eightpost.rig import RigTest
from eightpost.signals import TimeSeries
from tests.drawn import drawn

from ..linear_rig import record

NEAR, FAR = ("lf.velocity", "lf.road"), ("lf.velocity", "rr.road")
#: In this car even the response at the far corner has -15 dB.
LOW = Thresholds(level=-12.0)


def single(channel: str, *, seed: int = 1, size: float = 1.0, noise: float = 1e-3) -> RigTest:
    return record("seven_dof", seconds=30.0, active=(channel,), seed=seed, size=size, noise=noise)


def judged(*tests: RigTest, **options: object) -> Linearity:
    return judge_linearity(prepare(tests), **options)  # type: ignore[arg-type]


def with_channel(test: RigTest, name: str, values: np.ndarray) -> RigTest:
    return replace(test, series=test.series.with_channel(name, test.series.unit(name), values))


@pytest.fixture(scope="module")
def singles() -> tuple[RigTest, ...]:
    return single("lf.road"), single("rr.road", seed=2)


@pytest.mark.nightly
def test_a_response_far_from_its_input_is_low(singles: tuple[RigTest, ...]) -> None:
    verdict = judged(*singles, thresholds=LOW).verdict(*FAR)
    assert verdict.condition is Condition.II
    assert verdict.coherence > 0.99
    assert verdict.level < -12.0


@pytest.mark.nightly
def test_a_low_response_in_noise_is_under_condition_iv(singles: tuple[RigTest, ...]) -> None:
    generator, near = np.random.default_rng(1), singles[0].series["lf.tire_force"]
    drowned = 0.05 * singles[1].series["lf.tire_force"] + 0.3 * near.std() * generator.standard_normal(near.size)
    found = judged(singles[0], with_channel(singles[1], "lf.tire_force", drowned))
    assert found.verdict("lf.tire_force", "rr.road").condition is Condition.IV


@pytest.fixture(scope="module")
def quarter_tests() -> tuple[RigTest, ...]:
    """Tests of a quarter car: a large road, a load, and a small road."""
    drives = (("road", 1, 1.0), ("aero_force", 2, 1.0), ("road", 3, 0.25))
    return tuple(
        record("quarter_car", seconds=25.0, active=(name,), seed=seed, size=size) for name, seed, size in drives
    )


def test_only_tests_of_other_amplitudes_show_an_effect_which_is_a_share_of_the_response(
    quarter_tests: tuple[RigTest, ...],
) -> None:
    """The force of the small test is a fifth smaller than the response of the large one predicts."""
    large, load, small = quarter_tests
    weak = with_channel(small, "tire_force", 0.8 * small.series["tire_force"])
    found = judged(large, load, weak, outputs=["tire_force"])
    (effect,) = found.effects
    assert (found.inputs, effect.input, effect.output) == (("road", "aero_force"), "road", "tire_force")
    assert effect.large / effect.small == pytest.approx(4.0, rel=0.01)
    assert effect.change == pytest.approx(0.2, abs=0.02)
    assert effect.is_notable
    assert {each.condition for each in found.verdicts} == {Condition.I}
    similar = replace(weak, series=replace(weak.series, values=3.0 * weak.series.values))
    assert judged(large, load, similar, outputs=["tire_force"]).effects == ()


@pytest.mark.slow
def test_the_verdicts_effects_tables_and_plots_of_a_quarter_car(
    quarter_tests: tuple[RigTest, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, unchanged: Callable[..., None]
) -> None:
    found = judged(*quarter_tests, outputs=["tire_force", "velocity"])
    shown = {}
    monkeypatch.setattr(linearity_plots, "save", lambda figure, path, **_: shown.update({path.name: drawn(figure)}))
    linearity_plots.plot_output(found, "tire_force", tmp_path / "tire_force.png")
    linearity_plots.plot_conditions(found, tmp_path / "conditions.png")
    linearity_plots.write_paths(tmp_path / "paths.csv", found, sources={"large": "0" * 64})
    linearity_plots.write_effects(tmp_path / "effects.csv", found)
    tables = {name: (tmp_path / f"{name}.csv").read_text(encoding="utf-8") for name in ("paths", "effects")}
    parts = {"verdicts": found.verdicts, "effects": found.effects, "notes": found.notes, "paths": found.paths}
    unchanged({**parts, **tables, **shown}, relative=1e-3)


def test_an_actuator_with_only_noise_is_at_rest() -> None:
    test = single("lf.road")
    noise = 1e-5 * np.random.default_rng(4).standard_normal((3, len(test.series)))
    for name, row in zip(("rf.road", "lr.road", "rr.road"), noise, strict=True):
        test = with_channel(test, name, row)
    assert judged(test, outputs=["lf.velocity"]).inputs == ("lf.road",)


def forces(**sizes: float) -> TimeSeries:
    """Return a test of two shocks of 2000 N.s/m with further forces of given sizes [N], each of its own shape."""
    time = np.arange(2000) / 200.0
    channels = {}
    for k, corner in enumerate(("lf", "rf")):
        velocity = 0.1 * np.sin(2.0 * np.pi * (k + 1.0) * time)
        more = sizes.get(corner, 0.0) * np.sin(2.0 * np.pi * (k + 5.0) * time)
        channels |= {f"{corner}.velocity": ("m/s", velocity), f"{corner}.force": ("N", 2000.0 * velocity + more)}
    return TimeSeries.from_channels(time, channels)


@pytest.mark.parametrize(
    ("sizes", "note"),
    [
        ({"rf": 15.0}, "new: repeats first with the same shocks; omitted"),
        ({"rf": 100.0, "lf": 60.0}, "new: rf.force, lf.force differ from first; change one shock at a time"),
    ],
)
def test_a_test_without_one_other_shock_is_omitted_with_the_reason(sizes: dict[str, float], note: str) -> None:
    """A change below a tenth of the force does not count; one below half of the largest is due to the car's motion."""
    assert _shock_change("new", forces(**sizes), ("first", forces()), ("lf", "rf")) == note


def test_the_change_of_a_shock_is_that_of_its_force_beside_the_baseline_damping() -> None:
    first, other = forces(), forces(rf=100.0, lf=40.0)
    found = _shock_change("new", other, ("first", first), ("lf", "rf"))
    assert not isinstance(found, str)
    assert found.force == "rf.force"
    assert found.values == pytest.approx(other["rf.force"] - first["rf.force"], abs=1e-9)
    excitation = _shock_excitation("new", other, first, found, ["lf.force", "rf.velocity"])
    assert (excitation.test, excitation.channel.name, excitation.channel.unit) == ("new", "rf.force", "N")
    assert excitation.y[0] == pytest.approx(other["lf.force"] - first["lf.force"])
    assert not excitation.y[1].any()
    assert [channel.name for channel in excitation.outputs] == ["lf.force", "rf.velocity"]


def test_tests_without_an_input_that_moves_alone_are_rejected_with_a_remedy() -> None:
    with pytest.raises(InputError, match=r"one input moves alone.*virtual rig --test single"):
        judged(record("seven_dof"))


@pytest.mark.nightly
def test_short_records_and_invalid_thresholds_are_rejected(singles: tuple[RigTest, ...]) -> None:
    with pytest.raises(TooShortError, match="noise has a coherence of"):
        judged(*singles, recipe=LocalPolynomial(half_width=0.01, spare=1.1))
    with pytest.raises(ParameterError, match="between 0 and 1"):
        Thresholds(coherence=1.5)
    with pytest.raises(ParameterError, match="below 0 dB"):
        Thresholds(level=3.0)


KEY = ("--set", "channel=tire_force")


def quarter_files(folder: Path, **changes: float) -> list[str]:
    """Write quarter-car tests of a large road, a small road and a load, with tire forces raised to given powers."""
    tests = {"large": ("road", 1, 1.0), "load": ("aero_force", 2, 1.0), "small": ("road", 3, 0.25)}
    for name, (channel, seed, size) in tests.items():
        test = record("quarter_car", seconds=25.0, active=(channel,), seed=seed, size=size)
        if name in changes:
            force = test.series["tire_force"]
            test = with_channel(test, "tire_force", np.abs(force) ** changes[name])
        test.write(folder / f"{name}.parquet")
    return ["inspect", *[str(folder / f"{name}.parquet") for name in tests], "-o", str(folder / "out")]


@pytest.mark.slow
def test_the_command_exits_1_if_a_response_is_under_condition_iii(tmp_path: Path) -> None:
    done = CliRunner().invoke(main, [*quarter_files(tmp_path, large=1.5), *KEY], env={"COLUMNS": "200"})
    assert done.exit_code == 1, done.output
    assert "tire_force: " in done.output
    assert "of its energy from road is not predictable (III)" in " ".join(done.output.split())
