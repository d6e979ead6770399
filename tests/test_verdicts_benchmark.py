"""The benchmark of the verdicts: its damper has the stated force, its table counts what each verdict is worth."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.verdicts import laws
from benchmarks.verdicts.__main__ import report
from benchmarks.verdicts.cases import stepped
from benchmarks.verdicts.dampers import RATE, Damper
from eightpost.shock import LAWS


def row(case, grade, error, *, within=True):
    return {"case": case, "grade": grade, "error": error, "within": within}


def test_the_table_has_the_tails_of_each_verdict_and_counts_good_fits():
    rows = [row("a", "usable", 1.0), row("a", "usable", 6.0), row("b", "usable", 2.0)]
    rows += [row("c", "usable within limits", 5.0), row("c", "usable within limits", 12.0, within=False)]
    text = report([*rows, {"case": "d", "refused": "too short"}])
    assert "| usable | within the range | 3 of 2 fits | 6 | 5.6 | 5.2 | 2 | 33 % | 0 % |" in text
    assert "| usable within limits | outside | 1 of 1 fits | 12 | 12 | 12 | 12 | 100 % | 100 % |" in text
    assert "at most 5 % on all records within their range: 2, of which green: 1." in text
    assert text.endswith(" Refused: 1.")


def test_the_regret_of_a_law_is_its_error_over_that_of_the_best_one():
    errors = ({"polylinear": 4.0, "lpf1": 3.0, "lpnl2": 2.0, "hysteresis": 2.04}, dict.fromkeys(LAWS, 1.0))
    text = laws.report([{"kind": laws.RUN, "errors": one} for one in errors])
    assert f"| {laws.RUN} (2) | 2.5 | 2 | 1.5 | 1.52 | 50, 25, 0, 1 | 2 | 2 |" in text


def test_a_held_out_part_begins_with_its_first_motion_and_may_end_with_a_rest(tmp_path):
    time = np.arange(1600) / 100.0
    moves = (time >= 0.2) & (time < 14.2)
    x = np.where(moves, 0.01 * (1.0 - np.cos(2.0 * np.pi * (time - 0.2))), 0.0)
    v = np.gradient(x, time)
    columns = {"time [s]": time, "displacement [m]": x, "velocity [m/s]": v, "force [N]": 2000.0 * v}
    (tmp_path / "labcontrol").mkdir()
    path = tmp_path / "labcontrol" / "run.csv"
    np.savetxt(path, np.column_stack(list(columns.values())), delimiter=",", header=",".join(columns), comments="")
    found = [(kind, record.series.time) for one in laws.splits(tmp_path) for kind, record in one.held_out.items()]
    assert [kind for kind, _ in found] == [laws.REST, laws.TIME, laws.REST, laws.TIME]
    assert [round(float(time[0]), 1) for kind, time in found if kind == laws.TIME] == [0.2, 0.2]


def test_stepped_sines_have_three_cycles_each_and_no_jump():
    x = stepped(0.01, np.array([1.0, 2.0]))
    assert x.size == round(4.5 * RATE)
    assert np.abs(np.diff(x)).max() < 1.01 * 0.01 * 2 * np.pi * 2.0 / RATE


@pytest.mark.nightly
@pytest.mark.parametrize(("speed", "force"), [(0.05, 4000.0 * 0.05), (-0.05, -6000.0 * 0.05)])
def test_the_force_of_a_laminar_valve_is_proportional_to_the_speed(speed, force):
    damper = Damper(bleed=(0.0, 0.0), blow_off=(1e5, 1e5), orifice=0.0, friction=20.0, gas=100.0, gas_stiffness=0.0)
    found, temperature = damper.respond(speed * np.arange(800) / RATE)
    assert found[-1] == pytest.approx(force + np.sign(speed) * 20.0 + 100.0, rel=1e-3)
    assert not temperature.any()
