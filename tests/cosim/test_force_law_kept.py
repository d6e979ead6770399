"""Forces and derivatives of shocks as force laws along a fixed motion, kept number by number."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from cosim import ExtrapolatedForce, ForceLaw, HeldForce
from cosim.engine import force_law as engine
from cosim.engine.plan import STEP as STEP_CALL
from eightpost.errors import InputError
from eightpost.shock import LAWS

CORNERS = ("lf", "rr")
STEP = 2e-3
TIME = STEP * np.arange(40)


def motion(t: float) -> tuple[np.ndarray, np.ndarray]:
    """Return velocities and displacements of two corners."""
    phase = np.array([0.0, 0.9])
    return 0.4 * np.sin(60.0 * t + phase), -0.4 / 60.0 * np.cos(60.0 * t + phase)


@pytest.mark.parametrize("name", LAWS)
def test_forces_and_derivatives_of_a_law_are_unchanged(
    name: str, fmus: Mapping[str, Path], unchanged: Callable[..., None]
) -> None:
    parameters = {"lf": {"rebound_scale": 1.3, "gas_stiffness": 900.0}, "rr": {"gas_preload": 40.0}}
    forces, tried, slopes = [], [], []
    with ForceLaw([fmus[name]] * 2, corners=CORNERS, parameters=parameters) as law:
        forces.append(law.start(0.0, *motion(0.0)))
        for t in TIME[1:].tolist():
            tried.append(law.force(t - 0.5 * STEP, *motion(t - 0.3 * STEP)))
            slopes.append(np.stack(law.jacobian(t, *motion(t))))
            forces.append(law.accept(t, *motion(t)))
        again = law.accept(TIME[-1], *motion(TIME[-1]))
        with pytest.raises(InputError, match="before"):
            law.force(TIME[-1] - STEP, *motion(0.0))
    unchanged({"forces": np.array(forces), "tried": np.array(tried), "again": again}, relative=1e-6)
    unchanged(np.array(slopes), "slopes", relative=1e-4)


@pytest.mark.parametrize("kind", [HeldForce, ExtrapolatedForce])
def test_forces_that_are_held_over_a_step_are_unchanged(
    kind: type[HeldForce | ExtrapolatedForce], fmus: Mapping[str, Path], unchanged: Callable[..., None]
) -> None:
    found = {}
    for name in ("polylinear", "lpnl2"):
        with kind([fmus[name]] * 2, corners=CORNERS) as loop:
            forces = [loop.start(0.0, *motion(0.0))]
            forces += [loop.step(t, STEP, *motion(t)) for t in TIME.tolist()]
        found[name] = np.array(forces)
    unchanged(found, relative=1e-6)


@pytest.mark.parametrize(("ramped", "h", "steps"), [
    (1, 0.5, [(1.0, 0.5)]), (0, 0.5, [(1.0, 0.5 * 1023.0 / 1024.0), (1.0 + 0.5 * 1023.0 / 1024.0, 0.5 / 1024.0)]),
    (1, 1e-9, [(1.0, 1e-9)]), (0, 0.0, [(1.0, 1e-9)]),
])  # fmt: skip
def test_a_trial_step_can_be_taken_back_and_its_refusal_is_recorded(
    ramped: int, h: float, steps: list[tuple[float, float]], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Held inputs have the mean of the ramp over the first part, and their end values over the last one."""
    calls: list[tuple[float, float, int]] = []
    sets: list[list[float]] = []
    refused = [0]

    def do_step(_function: int, _instance: int, time: float, step: float, final: int) -> int:
        calls.append((time, step, final))
        return refused[0]

    def exchange(*_arguments: int) -> int:
        sets.append(m.values[0].tolist())
        return 0

    monkeypatch.setattr(engine.blocks, "do_step", do_step)
    monkeypatch.setattr(engine.blocks, "exchange", exchange)
    monkeypatch.setattr(engine.blocks, "set_slopes", lambda *_: 0)
    none = dict.fromkeys(
        ("do_step", "instance", "set_real", "inputs", "values", "set_slopes", "orders", "slopes"), (0,)
    )
    p = SimpleNamespace(**none, shortest=1e-9, ramped=[ramped], width=[2], scale=np.full((1, 3), 2.0),
                        offset=np.full((1, 3), 0.5))  # fmt: skip
    m = SimpleNamespace(clock=np.array([1.0, 1.0 + h, np.nan]), accepted=np.array([[1.0, 0.0]]), failure=np.zeros(3),
                        trial=np.array([[3.0, 4.0]]), values=np.zeros((1, 2)), slopes=np.zeros((1, 2)))  # fmt: skip
    assert engine.advance(p, m, 0, h) == 0 and m.failure.tolist() == [0.0, 0.0, 0.0]
    assert [call[:2] for call in calls] == [pytest.approx(step, rel=1e-12) for step in steps]
    assert [call[2] for call in calls] == [0] * len(steps)  # the FMU must be able to return
    if ramped and h > 1e-9:
        assert sets == [[2.5, 0.5]] and m.slopes.tolist() == [[8.0, 16.0]]
    else:
        assert sets[-1] == [6.5, 8.5]  # the end values
    if len(steps) == 2:
        mean = np.array(sets) * np.array([1023.0, 1.0])[:, None] / 1024.0
        assert mean.sum(axis=0) == pytest.approx([4.5, 4.5])
    refused[0] = 3
    assert engine.advance(p, m, 0, h) == 1 and m.failure.tolist() == [3.0, 0.0, STEP_CALL]


@pytest.mark.parametrize("changed", ["time", "velocity", "displacement", "nothing"])
def test_a_point_that_was_tried_is_accepted_as_it_is_only_at_its_own_time_and_motion(
    changed: str, fmus: Mapping[str, Path]
) -> None:
    with ForceLaw(fmus["lpnl2"]) as law:
        forces = []
        for is_tried in (False, True):
            law.start(0.0, 0.05, 0.001)
            if is_tried:
                time, velocity, travel = 2e-3 * (changed != "time") + 1e-3, 0.12, 0.002
                law.force(time, velocity + 0.1 * (changed == "velocity"), travel + 0.01 * (changed == "displacement"))
            forces.append(law.accept(3e-3, 0.12, 0.002))
        assert forces[0] == forces[1]
