"""Peak-velocity tables are read in every layout; inconsistent tables are refused."""

import numpy as np
import pytest

from eightpost import errors
from eightpost.ident.shock.peak_velocity import fit_peak_velocity
from eightpost.rig import read_peak_velocity
from eightpost.rig.peak_velocity_columns import _is_peak_velocity
from eightpost.signals import read_record

SPEED, COMPRESSION, REBOUND = (
    np.array([0.05, 0.1, 0.25]),
    np.array([100.0, 180.0, 300.0]),
    np.array([-200.0, -330.0, -500.0]),
)

#: The same table in every layout: at 3 clicks as above; at 6 clicks half of it, if the layout has clicks.
LAYOUTS = {
    "one setting": "speed [m/s],compression [N],rebound [N]\n.05,100,-200\n.1,180,-330\n.25,300,-500\n",
    "magnitudes": "speed [m/s],comp force [N],reb force [N]\n.05,100,200\n.1,180,330\n.25,300,500\n",
    "the other signs": "speed [m/s],bump [N],extension [N]\n.05,-100,200\n.1,-180,330\n.25,-300,500\n",
    "falling speeds and rest": "speed [m/s],C [N],R [N]\n.25,300,-500\n.1,180,-330\n.05,100,-200\n0,5,2\n",
    "preamble and units row": "Valve 17\nClicks from closed\nV,C 3,R 3,C 6,R 6\nmm/s,kN,kN,kN,kN\n"
    "50,.1,.2,.05,.1\n100,.18,.33,.09,.165\n250,.3,.5,.15,.25\n",
    "clicks in a column": "clicks;speed [m/s];comp [N];reb [N]\n3;0,05;100;-200\n3;0,1;180;-330\n3;0,25;300;-500\n"
    "6;0,05;50;-100\n6;0,1;90;-165\n6;0,25;150;-250\n",
    "a line per point": "side,setting,v_mm_s,F_N\n"
    "comp,3,50,100\ncomp,3,100,180\ncomp,3,250,300\nreb,3,50,-200\nreb,3,100,-330\nreb,3,250,-500\n"
    "comp,6,50,50\ncomp,6,100,90\ncomp,6,250,150\nreb,6,50,-100\nreb,6,100,-165\nreb,6,250,-250\n",
    "signed speed": "velocity [m/s],F 3 [N],F 6 [N]\n-.25,-500,-250\n-.1,-330,-165\n-.05,-200,-100\n.05,100,50\n"
    ".1,180,90\n.25,300,150\n",
}


def written(folder, content, name="table.csv"):
    path = folder / name
    path.write_text(content)
    return path


@pytest.mark.parametrize("layout", LAYOUTS)
def test_every_layout_gives_the_same_table(tmp_path, layout):
    path = written(tmp_path, LAYOUTS[layout])
    assert _is_peak_velocity(read_record(path))
    first, *others = read_peak_velocity(path)
    for name, expected in (("speed", SPEED), ("compression", COMPRESSION), ("rebound", REBOUND)):
        np.testing.assert_allclose(getattr(first, name), expected)
    assert first.source == path
    if others:
        assert "3" in first.clicks
        assert "6" in others[0].clicks
        np.testing.assert_allclose(others[0].rebound, REBOUND / 2.0)


def test_strokes_with_different_speeds_are_interpolated_linearly(tmp_path):
    content = "side,v_mm_s,F_N\ncomp,100,200\ncomp,200,400\ncomp,400,600\nreb,50,-10\nreb,150,-100\nreb,300,-400\n"
    (table,) = read_peak_velocity(written(tmp_path, content))
    np.testing.assert_allclose(table.speed, [0.1, 0.15, 0.2, 0.3])
    np.testing.assert_allclose(table.compression, [200.0, 300.0, 400.0, 500.0])
    np.testing.assert_allclose(table.rebound, [-55.0, -100.0, -200.0, -400.0])


def test_a_time_record_is_not_a_peak_velocity_table(tmp_path):
    content = "t_s,x_mm,v_mm_s,F_N\n0,1,2,3\n1,2,3,4\n"
    assert not _is_peak_velocity(read_record(written(tmp_path, content)))


HEAD = "speed [m/s],comp [N],reb [N]\n"
#: Text and error of tables that are refused; messages are in the kept results.
BROKEN = {
    "a stroke is missing": ("speed [m/s],comp [N]\n.1,1\n.2,2\n", errors.MissingChannelError),
    "no stroke at all": ("speed [m/s],F [N]\n.1,1\n.2,2\n", errors.MissingChannelError),
    "no speed": ("a [m/s],comp [N],reb [N]\n.1,1,2\n", errors.MissingChannelError),
    "two forces at a speed": (HEAD + ".1,100,2\n.1,200,2\n.2,300,3\n", errors.DataError),
    "both strokes negative": (HEAD + ".1,-1,-2\n.2,-2,-3\n", errors.WrongSignError),
    "an empty cell": (HEAD + ".1,1,\n.2,2,3\n", errors.NotANumberError),
    "an unknown side": ("side,v_mm_s,F_N\nup,1,2\nreb,1,2\n", errors.DataError),
    "one speed": (HEAD + ".1,1,2\n", errors.TooShortError),
}


def test_stacked_blocks_are_settings_and_a_line_above_them_may_name_the_stroke(tmp_path):
    block = "Clicks: {}\nspeed [m/s],compression [N],rebound [N]\n.05,{},-200\n.1,180,-330\n.25,300,-500\n"
    tables = read_peak_velocity(written(tmp_path, block.format(3, 100) + "\n" + block.format(6, 90)))
    assert [table.clicks for table in tables] == ["Clicks 3", "Clicks 6"]
    assert [table.compression[0] for table in tables] == [100.0, 90.0]
    one = "{}\nspeed [m/s],force [N]\n.05,{}\n.1,{}\n.25,{}\n"
    (table,) = read_peak_velocity(
        written(tmp_path, one.format("Bump", 100, 180, 300) + "\n" + one.format("Droop", 200, 330, 500))
    )
    np.testing.assert_allclose(table.rebound, REBOUND)
    np.testing.assert_allclose(table.compression, COMPRESSION)


@pytest.mark.parametrize("rest", ["", "0,150,150\n"], ids=["extrapolated", "at rest"])
def test_the_gas_force_in_a_table_is_identified_and_subtracted(tmp_path, rest):
    speed = np.array([0.01, 0.02, 0.04, 0.08, 0.15, 0.25])
    lines = "".join(f"{v},{2000 * v + 150:g},{-3000 * v + 150:g}\n" for v in speed)
    (table,) = read_peak_velocity(written(tmp_path, f"speed [m/s],compression [N],rebound [N]\n{rest}{lines}"))
    assert table.gas_force == pytest.approx(150.0)
    assert table.gas_source.startswith("the points at zero speed" if rest else "the lowest speeds")
    np.testing.assert_allclose(table.compression, 2000.0 * speed, rtol=1e-9)
    np.testing.assert_allclose(table.rebound, -3000.0 * speed, rtol=1e-9)
    shock = fit_peak_velocity(table)
    assert shock.law.port.gas_preload == pytest.approx(150.0)
    assert any("gas force of 150 N" in reason.figure for reason in shock.validity.verdict.reasons)


def test_a_loop_without_time_is_read_as_the_mean_of_its_branches(tmp_path):
    phase = np.linspace(0.0, 2.0 * np.pi, 2001)[:-1]
    v = 0.25 * np.sin(phase)
    force = 2000.0 * v + 30.0 * np.cos(phase)
    lines = "".join(f"{a:.9g},{b:.9g}\n" for a, b in zip(v, force, strict=True))
    path = written(tmp_path, "Velocity [m/s],Force [N]\n" + lines)
    assert _is_peak_velocity(read_record(path))
    (table,) = read_peak_velocity(path)
    np.testing.assert_allclose(table.compression, 2000.0 * table.speed, rtol=0.02)
    np.testing.assert_allclose(table.rebound, -2000.0 * table.speed, rtol=0.02)


def test_negative_force_at_zero_speed_is_a_doubt_because_gas_pushes(tmp_path):
    """All signs of this table are reversed: its gas force of 60 N pulls."""
    head = "velocity [m/s],force [N]\n"
    path = written(tmp_path, f"{head}-.2,-560\n-.1,-360\n0,-60\n0,-60\n.1,340\n.2,640\n")
    (table,) = read_peak_velocity(path)
    assert table.rest_force == -60.0
    assert any("all signs are reversed" in doubt for doubt in fit_peak_velocity(table).fit["warnings"])
