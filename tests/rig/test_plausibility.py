"""A record that is not what its header says is reported with a figure and a remedy; a good record is not."""

import os
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.signal import lfilter, welch

from eightpost.errors import WrongSignError
from eightpost.rig import read_dyno_test
from eightpost.rig.dyno_conditions import reversed_channels
from eightpost.rig.motion import run_down
from eightpost.rig.plausibility import _level, _spectrum_faults, rectified_force, rest_force, setting_faults
from eightpost.signals import TimeSeries

RATE = 500.0


def sine(*, seconds=10.0, frequency=2.0, stroke=40.0):
    """Return time [s], displacement [mm], velocity [mm/s] and force [N] of a digressive shock with gas."""
    t = np.arange(int(seconds * RATE)) / RATE
    noise = np.random.default_rng(0).standard_normal((3, t.size))
    omega = 2.0 * np.pi * frequency
    x, v = 0.5 * stroke * np.sin(omega * t), 0.5 * stroke * omega * np.cos(omega * t)
    force = 150.0 + 500.0 * np.tanh(v / 60.0) + 2.0 * v + np.where(v < 0.0, 0.5 * v, 0.0) + 1.5 * x
    return {"t": t, "x": x + 0.002 * noise[0], "v": v + 0.2 * noise[1], "F": force + 2.0 * noise[2]}


UNITS = {"t": "s", "x": "mm", "v": "mm/s", "F": "N"}


def rules(folder: Path, columns, *, units=UNITS, **options):
    """Return the rules of the reasons of a record that is written as text and read."""
    path = folder / "run.csv"
    header = ",".join(f"{name} [{units[name]}]" if units.get(name) else name for name in columns)
    np.savetxt(path, np.column_stack(list(columns.values())), delimiter=",", header=header, comments="", fmt="%.9g")
    return [reason.rule for reason in read_dyno_test(path, **options).reasons]


def times(name, factor):
    return lambda columns: columns | {name: factor * columns[name]}


def without(*names):
    return lambda columns: {name: values for name, values in columns.items() if name not in names}


def both(*changes):
    def change(columns):
        for one in changes:
            columns = one(columns)
        return columns

    return change


def later(columns, factor, *, only=0.0):
    """Scale the force after 6 s; in the stroke with the sign `only`, if it is not 0."""
    chosen = (columns["t"] > 6.0) & (columns["v"] * only >= 0.0)
    return columns | {"F": np.where(chosen, factor * columns["F"], columns["F"])}


def stopping(columns):
    """Let the machine slow down and stop after 7 s."""
    t = columns["t"]
    phase = np.where(t < 7.0, t, 7.0 + 0.5 * (1.0 - np.exp(-(np.maximum(t - 7.0, 0.0)) / 0.5)))
    speed = np.gradient(phase, t)
    omega = 4.0 * np.pi
    v = 20.0 * omega * np.cos(omega * phase) * speed
    force = 150.0 + 500.0 * np.tanh(v / 60.0) + 2.0 * v
    noise = np.random.default_rng(1).standard_normal((3, t.size)) * 0.01
    return {"t": t, "x": 20.0 * np.sin(omega * phase) + noise[0], "v": v + noise[1], "F": force + noise[2]}


def noisy(force):
    """Add noise of 3 % of the largest force."""
    return force + 0.03 * np.abs(force).max() * np.random.default_rng(3).standard_normal(force.size)


@pytest.mark.parametrize(("cycles", "frequency"), [(1.03, 1.3), (4.12, 1.3), (8.24, 4.0), (20.6, 8.0)])
def test_the_harmonics_of_a_sine_and_the_ends_of_a_record_are_no_moving_average(cycles, frequency):
    """Before, one of five clean sines was called smoothed."""
    time = np.arange(0.0, cycles / frequency, 1.0 / RATE)
    path = 0.025 * np.sin(2.0 * np.pi * frequency * time)
    speed = np.gradient(path, time)
    force = np.where(speed > 0.0, 110.0 * np.tanh(speed / 0.06), 180.0 * np.tanh(speed / 0.07)) + 900.0 * speed
    noise = 0.3 * np.random.default_rng(0).standard_normal(time.size)
    channels = {"velocity": ("m/s", speed), "force": ("N", force + 180.0 + 3000.0 * path + noise)}
    series = TimeSeries.from_channels(time, channels)
    assert list(_spectrum_faults(series, series.names)) == []


def test_a_rectified_force_is_read_with_this_reason_although_rebound_is_stiffer(tmp_path):
    """It is then largest against the velocity, but its sign is not reversed."""
    columns = sine()
    force = np.where(columns["v"] < 0.0, 3.0, 1.0) * np.abs(columns["F"])
    assert rules(tmp_path, columns | {"F": force}) == ["rectified force"]


def test_a_good_record_has_no_reason(tmp_path):
    good = sine()
    assert rules(tmp_path, good) == []
    extra = {
        "cell 2": 0.001 * good["F"], "index": np.arange(good["t"].size), "cycle": np.floor(2.0 * good["t"]),
        "supply": np.full(good["t"].size, 12.0), "noise": np.random.default_rng(2).standard_normal(good["t"].size),
    }  # fmt: skip
    assert rules(tmp_path, good | extra) == []
    top = int(np.argmax(good["x"]))  # a stop at the end of the stroke is no clipping: the force stands still too
    waiting = {name: np.insert(values, top, np.full(200, values[top])) for name, values in good.items()}
    assert rules(tmp_path, waiting | {"t": np.arange(waiting["t"].size) / RATE}) == []


@pytest.mark.repeated
@pytest.mark.parametrize("lowest", [0.0, 0.01])
def test_gas_that_keeps_the_force_positive_does_not_look_rectified(tmp_path, lowest):
    columns = sine()
    span = np.ptp(columns["F"])
    positive = columns["F"] - columns["F"].min() + lowest * span
    for force in (positive, noisy(positive)):
        assert "rectified force" not in rules(tmp_path, columns | {"F": force})


@pytest.mark.parametrize("noise", [0.1, 3.0])
def test_a_shock_that_hardly_damps_in_rebound_is_not_rectified_although_no_mean_is_negative(noise):
    """On a random motion the gas spring hides the sign in the means over velocity, but not in single values."""
    t, rng = np.arange(5000) / RATE, np.random.default_rng(6)
    f, phase = np.arange(1, 100)[:, None] / 10.0, rng.uniform(0.0, 2.0 * np.pi, (99, 1))
    x = 0.004 * (np.sin(2.0 * np.pi * f * t + phase) / f).sum(axis=0)
    v = np.gradient(x, t)
    force = 1500.0 * np.maximum(v, 0.0) + 40.0 + 2e3 * x + noise * rng.standard_normal(t.size)
    signed, rectified = (
        TimeSeries(t, np.vstack([v, values]), ("velocity", "force"), ("m/s", "N")) for values in (force, np.abs(force))
    )
    assert force.min() < -0.1 * force.max()
    assert rectified_force(signed) == ""
    assert rectified_force(rectified)


def test_a_bleed_that_opens_is_found_at_low_speed(tmp_path):
    columns = sine(stroke=60.0, frequency=3.0)
    slow = np.where((columns["t"] > 6.0) & (columns["v"] > 0.0), 400.0 * np.exp(-np.abs(columns["v"]) / 60.0), 0.0)
    rules(tmp_path, columns | {"F": columns["F"] - slow})
    reasons = read_dyno_test(tmp_path / "run.csv").reasons
    assert [reason.rule for reason in reasons] == ["the shock changed"]
    assert "compression force -" in reasons[0].figure and "at low speed" in reasons[0].figure


@settings(max_examples=25, deadline=None)
@given(st.floats(0.0, 0.25), st.floats(0.03, 2.0), st.booleans())
def test_a_drift_and_a_warming_towards_a_constant_value_are_no_change_of_the_shock(size, constant, straight):
    columns = sine()
    t = columns["t"] / columns["t"][-1]
    course = t if straight else 1.0 - np.exp(-t / constant)
    series = TimeSeries.from_channels(
        columns["t"],
        {
            "displacement": ("m", 1e-3 * columns["x"]),
            "velocity": ("m/s", 1e-3 * columns["v"]),
            "force": ("N", columns["F"] * (1.0 - size * course)),
        },
    )
    assert list(setting_faults(series)) == []


# ---- Statements of the file -----------------------------------------------------------------------------------------


def written(folder, columns, preamble):
    names = {"t": "Time", "x": "Displacement", "v": "Velocity", "F": "Force"}
    header = f"{preamble}\n" + ",".join(f"{names[name]} [{UNITS[name]}]" for name in columns)
    np.savetxt(folder / "r.csv", np.column_stack(list(columns.values())), delimiter=",", header=header, comments="")
    return folder / "r.csv"


def test_a_stated_gas_force_shows_that_pounds_are_labelled_newtons(tmp_path):
    gas = sine() | {"F": sine()["F"] + 50.0}
    assert read_dyno_test(written(tmp_path, gas, "Gas force: 200 N")).reasons == ()
    pounds = times("F", 1.0 / 4.448)(gas)
    (reason,) = read_dyno_test(written(tmp_path, pounds, "Gas force: 200 N")).reasons
    assert reason.rule == "contradictory units" and reason.figure.endswith("lbf labelled N")


TURNED = both(times("F", -1.0), times("v", -1.0), times("x", -1.0))


def test_a_file_that_contradicts_its_sign_convention_asks_the_user(tmp_path):
    with pytest.raises(
        WrongSignError, match=r"states 'compression positive', but then .* or confirm .*--channel force=\+"
    ):
        read_dyno_test(written(tmp_path, TURNED(sine()), "compression positive"))
    with pytest.raises(WrongSignError, match=r"states 'extension positive' \(--channel replaces it\), but its"):
        read_dyno_test(written(tmp_path, times("F", -1.0)(sine()), "extension positive"))
    known = read_dyno_test(written(tmp_path, TURNED(sine()), "compression positive"), flip=["none"])
    assert [reason.rule for reason in known.reasons] == ["negative force at standstill"]
    flipped = read_dyno_test(written(tmp_path, TURNED(sine()), "x"), flip=["force", "velocity", "displacement"])
    assert flipped.reasons == ()


@pytest.mark.parametrize("line", ["Rebound: 3 clicks", "Rebound +2", "Compression adjuster: 3", "Test at +20 degC"])
def test_a_setting_is_no_sign_convention(line):
    assert reversed_channels([(line,)], Path()) == ({}, "")


def test_a_shock_with_stiff_rebound_and_a_lag_does_not_look_reversed(tmp_path):
    """A lag of 2 ms keeps 150 N or more of the stiffer rebound at standstill, 4 % of the range; a lag explains it."""
    t = np.arange(20_000) / 2000.0
    angle = 2.0 * np.pi * 2.2 * t
    velocity = 0.7 * np.sin(angle)
    static = np.where(velocity > 0.0, 300.0, 1200.0) * np.tanh(velocity / 0.05) + 2000.0 * velocity
    decay = np.exp(-1.0 / (2000.0 * 2e-3))
    force = lfilter([1.0 - decay], [1.0, -decay], static)
    rest = rest_force(velocity, force)
    assert rest is not None
    assert rest[0] < -150.0
    columns = {"t": t, "x": -700.0 * np.cos(angle) / (2.0 * np.pi * 2.2), "v": 1000.0 * velocity, "F": force}
    assert "negative force at standstill" not in rules(tmp_path, columns)
    assert "negative force at standstill" in rules(tmp_path, columns | {"F": force - 400.0})


MEASURED = sorted(Path(os.environ.get("EIGHTPOST_DATA", "/nowhere")).glob("labcontrol/*.csv"))


@pytest.mark.skipif(not MEASURED, reason="EIGHTPOST_DATA does not name the folder of measured records")
@pytest.mark.parametrize("path", MEASURED, ids=lambda path: path.stem)
def test_the_measured_records_have_no_reason(path):
    assert read_dyno_test(path).reasons == ()


@settings(max_examples=30, deadline=None)
@given(
    strokes=st.tuples(st.floats(0.005, 0.025), st.floats(0.005, 0.025)),
    frequencies=st.tuples(st.floats(1.0, 4.0), st.floats(0.5, 4.0)),
)
def test_a_sine_that_follows_another_is_no_run_down(strokes, frequencies):
    cycles = 8
    parts = [
        stroke * np.sin(2.0 * np.pi * frequency * np.arange(int(500.0 * cycles / frequency)) / 500.0)
        for stroke, frequency in zip(strokes, frequencies, strict=True)
    ]
    path = np.concatenate(parts)
    assert run_down(np.arange(path.size) / 500.0, path, np.gradient(path, 1.0 / 500.0)) is None


@pytest.mark.parametrize("count", [400, 333])
def test_the_spectrum_of_a_channel_is_welchs_up_to_its_unit(count):
    values = np.cumsum(np.random.default_rng(6).standard_normal(1800))
    _, power = welch(values, nperseg=count)
    # Welch's density counts the ends of the spectrum half.
    found = _level(values, count)[1:-1]
    np.testing.assert_allclose(np.diff(found), np.diff(np.log(power[1:-1])), atol=1e-9)
    assert _level(np.zeros(1800), count).max() < -600.0
