"""Layouts written as an attack on the reader of dynamometer files: read to the same values, or refused with advice."""

from pathlib import Path

import numpy as np
import pytest

from eightpost.errors import InputError
from eightpost.rig import read_dyno_test
from eightpost.signals import read_record
from eightpost.units import convert

from . import test_fourth_attack_layouts as fourth
from . import test_third_attack_layouts as third
from .layouts import COUNT, SI, F, T, V, X, cells, column, text
from .test_layouts import check

CHANNELS = [cells(*one, ".9g") for one in SI]
TIME, DISP, VEL, FORCE = CHANNELS
WIDE = str.maketrans("0123456789.-", "０１２３４５６７８９．－")
CYCLE = [f"{t % 0.4:.9g}" for t in T]


def shown(values):
    return [f"{value:.9g}" for value in values]


def parquet(columns):
    """Return a writer of a Parquet file."""
    pd = pytest.importorskip("pandas", reason="durations are written with pandas")

    def write(folder: Path) -> Path:
        path = folder / "run.parquet"
        pd.DataFrame(columns).to_parquet(path)
        return path

    return write


def durations(folder):
    pd = pytest.importorskip("pandas", reason="durations are written with pandas")
    frame = {"time": pd.to_timedelta(T, unit="s"), "x [mm]": 1e3 * X, "v [mm/s]": 1e3 * V, "F [N]": F}
    return parquet(frame)(folder)


READ = {
    "a time of the cycle behind the others": text("t [s],x [mm],v [mm/s],F [N],t cycle [s]", [*CHANNELS, CYCLE]),
    "time in minutes": text("Time [min],x [mm],v [mm/s],F [N]", [shown(T / 60.0), *CHANNELS[1:]]),
    "time in nanoseconds since 1970": text(
        "t [ns],x [mm],v [mm/s],F [N]", [[str(1714730400 * 10**9 + round(t * 1e9)) for t in T], *CHANNELS[1:]]
    ),
    "displacement of the wheel beside": text(
        "t [s],Wheel Disp [mm],Shock Disp [mm],v [mm/s],F [N]", [TIME, shown(1600.0 * X), *CHANNELS[1:]]
    ),
    "two shocks by number, in another order": text(
        "t [s],Disp 2 [mm],Vel 2 [mm/s],Force 1 [N],Disp 1 [mm],Vel 1 [mm/s],Force 2 [N]",
        [TIME, shown(700.0 * X), shown(700.0 * V), FORCE, DISP, VEL, shown(0.5 * F)],
    ),
    "gas, spring and side force beside": text(
        "t [s],x [mm],v [mm/s],Gas Force [N],Spring Force [N],Side Force [N],Force [N]",
        [*CHANNELS[:3], column("120"), shown(3e4 * X), shown(0.1 * F), FORCE],
    ),
    "power, energy and change of the force beside": text(
        "t [s],x [mm],v [mm/s],F*v [W],E [J],dF [N],F [N]",
        [*CHANNELS[:3], shown(F * V), column("0"), shown(np.gradient(F)), FORCE],
    ),
    "velocity in m/min, kilopond": text(
        "t [s],x [mm],v [m/min],F [kp]", [TIME, DISP, shown(60.0 * V), shown(F / 9.80665)]
    ),
    "pounds-force": text("t [s],x [mm],v [mm/s],F [Pounds-Force]", [*CHANNELS[:3], shown(F / 4.4482216152605)]),
    "Chinese": text("时间(s),位移(mm),速度(mm/s),力(N)", CHANNELS),
    "Korean": text("시간(s),변위(mm),속도(mm/s),하중(N)", CHANNELS),
    "Portuguese": text("Tempo (s);Deslocamento (mm);Velocidade (mm/s);Força (N)", CHANNELS, sep=";"),
    "Dutch": text("Tijd (s);Verplaatsing (mm);Snelheid (mm/s);Kracht (N)", CHANNELS, sep=";"),
    "Swedish": text("Tid (s);Förskjutning (mm);Hastighet (mm/s);Kraft (N)", CHANNELS, sep=";"),
    "full-width digits": text("t [s],x [㎜],v [㎜/s],Ｆ [Ｎ]", [*CHANNELS[:3], [c.translate(WIDE) for c in FORCE]]),
    "a calibration table above": text(
        "t [s],x [mm],v [mm/s],F [N]", CHANNELS, above="Calibration\nmV,N,gain,off\n1,2,3,4\n2,4,6,8\n\n"
    ),
    "carriage returns twice": text("t [s],x [mm],v [mm/s],F [N]\r\r", [*CHANNELS[:3], [f"{c}\r\r" for c in FORCE]]),
    "durations": durations,
}  # fmt: skip

REFUSED = {
    "a tenth of the force": (text("t [s],x [mm],v [mm/s],Force/10 [N]", [*CHANNELS[:3], shown(F / 10)]), "Force/10"),
    "a multiple of the force": (
        text("t [s],x [mm],v [mm/s],F*10 [N]", [*CHANNELS[:3], shown(10 * F)]), "--channel force=",
    ),
    "tens of newtons": (text("t [s],x [mm],v [mm/s],F [10 N]", [*CHANNELS[:3], shown(F / 10)]), "unknown unit '10 N'"),
    "time of the cycle": (text("t [s],x [mm],v [mm/s],F [N]", [CYCLE, *CHANNELS[1:]]), "time decreases"),
    "shocks of two corners": (
        text("t [s],LF Disp [mm],LF Force [N],RF Disp [mm],RF Force [N]", [TIME, DISP, FORCE, DISP, FORCE]),
        "--channel force=",
    ),
    "least and largest force": (
        text("t [s],x [mm],v [mm/s],Force max [N],Force min [N]", [*CHANNELS, FORCE]), "--channel force=",
    ),
    "counts": (text("t [s],x [mm],v [mm/s],F [counts]", CHANNELS, above="Scale: 0.1 N/count\n"), "'counts' cannot be"),
    "rate of the force": (text("t [s],x [mm],v [mm/s],F [N/s]", CHANNELS), "'N/s' cannot be converted"),
    "another rate from the middle on": (
        text("t [s],x [mm],v [mm/s],F [N]", [c[:240] + c[240::2] for c in CHANNELS]), "gap",
    ),
    "extension for compression": (
        text("t [s],Extension [mm],Extension velocity [mm/s],Tension [N]", CHANNELS), "--channel force=",
    ),
}  # fmt: skip


#: Writers of the layouts of all attacks.
READERS = [pytest.param(write, id=layout) for attack in (READ, third.READ, fourth.READ)
           for layout, write in attack.items()]  # fmt: skip

#: Writers of the layouts that are refused, with a part of the message.
REFUSALS = [pytest.param(*case, id=layout) for attack in (REFUSED, third.REFUSED, fourth.REFUSED)
            for layout, case in attack.items()]  # fmt: skip


@pytest.mark.repeated(30)
@pytest.mark.parametrize("write", READERS)
def test_layout_is_read_to_the_same_values(write, tmp_path):
    test = read_dyno_test(write(tmp_path))
    assert len(test.series) == COUNT
    check(test.series)


@pytest.mark.parametrize(("write", "message"), REFUSALS)
def test_layout_is_refused_with_advice(write, message, tmp_path):
    with pytest.raises(InputError, match=message):
        read_dyno_test(write(tmp_path))


def test_a_motion_of_another_number_than_the_force_is_read_only_if_there_is_no_other(tmp_path):
    header = "t [s],Disp 2 [mm],Vel 2 [mm/s],Force 1 [N]"
    test = read_dyno_test(text(header, CHANNELS)(tmp_path))
    np.testing.assert_allclose(test.series["displacement"], X, atol=1e-6)


def test_full_width_letters_of_text_columns_do_not_matter(tmp_path):
    record = read_record(text("t [s],F [N],ｎｏｔｅ", [TIME, FORCE, column("ａ")])(tmp_path))
    assert record.names == ("t", "F", "note")
    assert len(record.columns[1]) == COUNT


def test_pounds_of_force_are_known_with_a_hyphen():
    assert convert(1.0, "Pounds-Force", "N") == pytest.approx(convert(1.0, "lbf", "N"))
