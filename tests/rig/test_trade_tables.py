"""Peak-velocity tables in layouts of this trade: wide, in pairs, as coefficients, as rates and knee, by number."""

import numpy as np
import pytest
from click.testing import CliRunner

from eightpost import errors
from eightpost.__main__ import main
from eightpost.ident.shock.peak_velocity import fit_peak_velocity
from eightpost.rig import read_peak_velocity
from eightpost.rig.columns import with_channels
from eightpost.shock import read_shock
from eightpost.signals import ChannelMap, MappedChannel

from .layouts import BUMP, DROOP, SPEED, file_with, sheets

NAMES = ("speed", "compression", "rebound")


def row(name, values, form="{:.9g}"):
    return ",".join([name, *(form.format(value) for value in values)])


def agrees(table, *, speed=SPEED / 1e3, compression=BUMP, rebound=DROOP):
    for name, expected in zip(NAMES, (speed, compression, rebound), strict=True):
        np.testing.assert_allclose(getattr(table, name), expected, rtol=1e-8)


def table_of(folder, *lines, name="table.csv"):
    return file_with(folder, name, "\n".join(lines) + "\n")


ROWS = ("Velocity (mm/s)", SPEED), ("Compression (N)", BUMP), ("Rebound (N)", DROOP)


@pytest.mark.parametrize("above", [(), ("Shock: 7", "")], ids=["alone", "preamble and empty line"])
def test_a_table_whose_rows_are_channels_is_turned(tmp_path, above):
    (table,) = read_peak_velocity(table_of(tmp_path, *above, *(row(*one) for one in ROWS)))
    agrees(table)


def test_a_fault_in_a_table_whose_rows_are_channels_names_its_first_line(tmp_path):
    path = table_of(
        tmp_path, "Shock: 7", row(*ROWS[0]), row("Compression (N)", [-1, *BUMP[1:]]), row("Rebound (mm)", DROOP)
    )
    with pytest.raises(errors.UnknownUnitError, match="line 2, channel 'Rebound'"):
        read_peak_velocity(path)
    ragged = table_of(
        tmp_path, row(*ROWS[0]), row("Compression (N)", BUMP[:-1]), row("Rebound (N)", DROOP), name="b.csv"
    )
    with pytest.raises(errors.InputError, match=r"b\.csv"):
        read_peak_velocity(ragged)


def wide(folder, *, unit=" mm/s", side="Side"):
    head = ",".join(["Clicks", side, *(f"{v:g}{unit}" for v in SPEED)])
    lines = [row(f"{clicks},{name}", share * force) for clicks, share in ((3, 1.0), (6, 0.5))
             for name, force in (("Comp", BUMP), ("Reb", DROOP))]  # fmt: skip
    return table_of(folder, head, *lines)


@pytest.mark.parametrize("side", ["Side", "which way"])
def test_a_column_per_speed_and_a_row_per_setting_and_stroke_are_read_with_the_unit_of_the_force(tmp_path, side):
    path = wide(tmp_path, side=side)
    with pytest.raises(errors.MissingUnitError, match=r"--channel 'force=\[unit\]'"):
        read_peak_velocity(path)
    first, second = read_peak_velocity(path, units={"force": "N"})
    assert (first.clicks, second.clicks) == ("clicks 3", "clicks 6")
    agrees(first)
    agrees(second, compression=0.5 * BUMP, rebound=0.5 * DROOP)


def test_a_row_of_signed_speeds_needs_no_column_of_strokes(tmp_path):
    head = ",".join(["Clicks", *(f"{v:g} mm/s" for v in [*-SPEED[::-1], *SPEED])])
    (table,) = read_peak_velocity(table_of(tmp_path, head, row("3", [*DROOP[::-1], *BUMP])), units={"force": "N"})
    agrees(table)


def test_damping_coefficients_by_speed_are_multiplied_by_it_with_a_note(tmp_path):
    lines = [f"{v / 1e3:.9g},{c * 1e3 / v:.9g},{-r * 1e3 / v:.9g}" for v, c, r in zip(SPEED, BUMP, DROOP, strict=True)]
    path = table_of(tmp_path, "Velocity (m/s),Comp (N.s/m),Reb (N.s/m)", *lines)
    (table,) = read_peak_velocity(path)
    agrees(table)
    assert "'Comp' is a damping coefficient: force = coefficient x speed" in table.notes[0]
    assert table.notes[0] in fit_peak_velocity(table).fit["changes"]
    shown = CliRunner().invoke(main, ["inspect", str(path)])
    assert "note 'Reb' is a damping coefficient" in " ".join(shown.output.split())


def test_coefficients_beside_forces_are_left_out_and_slopes_alone_are_no_coefficients(tmp_path):
    lines = [f"{v:g},{c:g},{r:g},1,2" for v, c, r in zip(SPEED, BUMP, DROOP, strict=True)]
    head = "Velocity (mm/s),Comp (N),Reb (N),Comp {0} (N.s/m),Reb {0} (N.s/m)"
    (table,) = read_peak_velocity(table_of(tmp_path, head.format("coefficient"), *lines))
    agrees(table)
    assert "Comp coefficient" in table.notes[0]
    slopes = [f"{v:g},{c:g},{r:g}" for v, c, r in zip(SPEED, BUMP, DROOP, strict=True)]
    with pytest.raises(errors.UnknownUnitError, match="cannot be converted to 'N'"):
        read_peak_velocity(table_of(tmp_path, "Velocity (mm/s),Comp slope (N.s/m),Reb slope (N.s/m)", *slopes))


def test_pairs_of_columns_below_their_settings_in_a_sheet_have_their_own_speeds(tmp_path):
    speeds = np.concatenate([-SPEED[::-1], SPEED])
    forces = np.concatenate([DROOP[::-1], BUMP])
    cells = [[v, f, 2 * v, 0.5 * f] for v, f in zip(speeds.tolist(), forces.tolist(), strict=True)]
    cells[-1][2:] = [None, None]
    head = [["0 clicks", None, "3 clicks", None], ["Velocity (mm/s)", "Force (N)"] * 2]
    first, second = read_peak_velocity(sheets({"Shock": [*head, *cells]})(tmp_path))
    assert (first.clicks, second.clicks) == ("0 clicks", "3 clicks")
    agrees(first)
    agrees(second, speed=2 * SPEED[:-1] / 1e3, compression=0.5 * BUMP[:-1], rebound=0.5 * DROOP[:-1])


@pytest.mark.parametrize("sign", [1.0, -1.0], ids=["forces in compression", "forces in rebound"])
def test_a_stated_sign_of_the_speed_tells_the_strokes_of_a_signed_table_with_a_note(tmp_path, sign):
    pairs = [*zip(SPEED, DROOP, strict=True), *zip(-SPEED, BUMP, strict=True)]
    lines = ["Rebound velocity is positive", "Velocity (mm/s),Force (N)", *(f"{v:g},{sign * f:g}" for v, f in pairs)]
    (table,) = read_peak_velocity(table_of(tmp_path, *lines))
    agrees(table)
    assert table.notes == ("positive speeds are rebound, because the file states 'Rebound velocity is positive'",)


def test_a_force_without_a_speed_in_a_pair_is_refused_with_its_line(tmp_path):
    lines = ["a,,b,", "Velocity (mm/s),Force (N),Velocity (mm/s),Force (N)", "-1,-2,-1,-3", "1,2,,4"]
    with pytest.raises(errors.NotANumberError, match="line 4, channel 'speed'"):
        read_peak_velocity(table_of(tmp_path, *lines))


SCRIPT = """% A damper of a vehicle model
{0}.FrcCurve.Comment = 'Characteristic';
{0}.FrcCurve.xComment = 'Damper velocity'; {0}.FrcCurve.xUnit = 'm/s';
{0}.FrcCurve.vComment = 'Damper force'; {0}.FrcCurve.vUnit = 'N';
{0}.FrcCurve.x = [{1}]';
{0}.FrcCurve.v = [{2}]'; % forces
{0}.VelOffset.v = 0;
"""


def script(name, factor=1.0):
    speeds = np.concatenate([-SPEED[::-1], [0.0], SPEED]) / 1e3
    forces = factor * np.concatenate([DROOP[::-1], [0.0], BUMP])
    return SCRIPT.format(name, ", ...\n  ".join(map(repr, speeds.tolist())), ", ".join(map(repr, forces.tolist())))


def test_the_damper_of_a_vehicle_model_in_a_matlab_script_is_read_by_its_comments_and_units(tmp_path):
    path = file_with(tmp_path, "car.m", script("LeftDamper") + script("RightDamper", 0.5))
    left, right = read_peak_velocity(path)
    assert ("LeftDamper" in left.clicks, "RightDamper" in right.clicks) == (True, True)
    agrees(left)
    agrees(right, compression=0.5 * BUMP, rebound=0.5 * DROOP)


def test_a_matlab_script_without_comments_asks_which_vector_is_the_velocity(tmp_path):
    bare = "\n".join(line for line in script("D").splitlines() if "Comment" not in line)
    path = file_with(tmp_path, "car.m", bare)
    shown = CliRunner().invoke(main, ["inspect", str(path)])
    assert shown.exit_code == 2
    assert "--channel time=COLUMN --channel force=COLUMN" in shown.output.replace("\n", " ")
    assert "D.FrcCurve.x, D.FrcCurve.v" in shown.output.replace("\n", " ")
    mapping = with_channels(None, {"velocity": "D.FrcCurve.x", "force": "D.FrcCurve.v"})
    units = {"velocity": "m/s", "force": "N"}
    agrees(read_peak_velocity(path, channel_map=mapping, units=units)[0])
    given = [f"--channel={name}={pick.source} [{units[name]}]" for name, pick in mapping.channels.items()]
    assert "5 speeds, 50 to 250 mm/s" in CliRunner().invoke(main, ["inspect", str(path), *given]).output


@pytest.mark.parametrize("content", ["x = 3;", "v = [1 2 3];", "v = [1 2 3]; F = [a b c];", ""])
def test_a_matlab_script_without_two_vectors_is_refused(tmp_path, content):
    with pytest.raises(errors.FileFormatError, match=r"car\.m: (it contains no two vectors|is empty)"):
        read_peak_velocity(file_with(tmp_path, "car.m", content))


def test_a_table_without_a_header_is_read_by_the_numbers_of_its_columns(tmp_path):
    lines = [f"{v:g},{c:g},7,{r:g}" for v, c, r in zip(SPEED, BUMP, DROOP, strict=True)]
    names = {"velocity": "1", "compression": "2", "rebound": "4"}
    units = {"velocity": "mm/s", "force": "N"}
    agrees(read_peak_velocity(table_of(tmp_path, *lines), channel_map=with_channels(None, names), units=units)[0])
    with pytest.raises(errors.MissingChannelError, match="no column '5'"):
        read_peak_velocity(table_of(tmp_path, *lines), channel_map=with_channels(None, {"velocity": "5"}))


def test_a_column_that_the_caller_names_replaces_others_that_could_be_it(tmp_path):
    lines = [f"{v:g},{2 * v:g},{c:g},{r:g}" for v, c, r in zip(SPEED, BUMP, DROOP, strict=True)]
    path = table_of(tmp_path, "True (mm/s),Speed (mm/s),Comp (N),Reb (N)", *lines)
    agrees(read_peak_velocity(path, channel_map=with_channels(None, {"velocity": "True"}))[0])


RATES = {"comp": (4000.0, 0.05, 1200.0), "reb": (6000.0, 0.08, 1800.0)}


def test_two_damping_rates_and_a_knee_per_stroke_make_a_polylinear_shock(tmp_path):
    head = "side,low [N.s/m],knee [mm/s],high [N.s/m]"
    path = table_of(tmp_path, head, *(f"{side},{low},{1e3 * knee},{high}" for side, (low, knee, high) in RATES.items()))
    shown = CliRunner().invoke(main, ["-v", "fit", str(path), "-o", str(tmp_path / "shock.json")])
    assert "rounded within 3 % of the knee" in " ".join(shown.output.split())
    shock = read_shock(tmp_path / "shock.json")
    assert shock.conditions["velocity_range [m/s]"] == [-0.5, 0.5]
    curve = shock.law.curve
    for sign, (low, knee, high) in zip((1.0, -1.0), RATES.values(), strict=True):
        for speed in (0.5 * knee, knee, 2.0 * knee, 0.5):
            expected = low * min(speed, knee) + high * max(speed - knee, 0.0)
            assert curve.force(sign * speed) == pytest.approx(sign * expected, rel=1e-6)
        between = low * 0.75 * knee
        assert curve.force(sign * 0.75 * knee) == pytest.approx(sign * between, rel=0.01)


@pytest.mark.parametrize(
    ("head", "error", "message"),
    [("side,low [N.s/m],knee [m/s]", errors.MissingChannelError, "no column 'high"),
     ("side,high [N.s/m],knee [m/s]", errors.MissingChannelError, "no column 'low"),
     ("what,low [N.s/m],knee [m/s],high [N.s/m]", errors.MissingChannelError, "no column 'side'"),
     ("side,low [N.s/m],knee [m],high [N.s/m]", errors.UnknownUnitError, "channel 'knee'.*'m' cannot be converted"),
     ("side,low [N.s/m],knee,high [N.s/m]", errors.MissingUnitError, "'knee' has no unit")],
)  # fmt: skip
def test_a_table_of_rates_that_is_not_complete_is_refused_with_what_is_missing(tmp_path, head, error, message):
    lines = [",".join([side, "4000", "0.05", "1200"][: head.count(",") + 1]) for side in RATES]
    with pytest.raises(error, match=message):
        read_peak_velocity(table_of(tmp_path, head, *lines))


def test_a_channel_map_of_a_table_may_have_units_gains_and_offsets(tmp_path):
    lines = [f"{v:g},{2 * c + 8:g},{r:g}" for v, c, r in zip(SPEED, BUMP, DROOP, strict=True)]
    picks = {"velocity": MappedChannel("1", "mm/s"), "compression": MappedChannel("2", "N", 0.5, -4.0),
             "rebound": MappedChannel("3", "N")}  # fmt: skip
    agrees(read_peak_velocity(table_of(tmp_path, "Shock 7", *lines), channel_map=ChannelMap(picks))[0])


def test_rows_of_channels_with_a_line_of_words_between_them_are_refused(tmp_path):
    path = table_of(tmp_path, row(*ROWS[0]), row(*ROWS[1]), "words", row(*ROWS[2]))
    with pytest.raises(errors.InputError, match=r"table\.csv"):
        read_peak_velocity(path)
