"""The size from which each fault of a dynamometer record is found."""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray

from eightpost.rig import DynoConditions
from eightpost.rig.plausibility import part_faults, record_faults
from eightpost.signals import TimeSeries
from tests.drawn import timed
from tests.limits import limit_of

from .test_plausibility import sine

Array = NDArray[np.float64]
Columns = dict[str, Array]

GOOD = sine()
LONG = sine(seconds=30.0)
UNITS = {"x": ("displacement", "m", 1e-3), "v": ("velocity", "m/s", 1e-3), "F": ("force", "N", 1.0)}
NOISE = np.random.default_rng(7).standard_normal((3, GOOD["t"].size))


def series_of(columns: Columns) -> TimeSeries:
    channels = {name: (unit, factor * columns[key]) for key, (name, unit, factor) in UNITS.items() if key in columns}
    return TimeSeries.from_channels(columns["t"], channels)


class Case(NamedTuple):
    """A fault of a size; the text of its finding; the sizes between which it begins or ends to be found."""

    change: Callable[[float], Columns]
    words: str
    low: float
    high: float
    stated: DynoConditions | None = None


def found_in(columns: Columns, stated: DynoConditions | None) -> str:
    series = series_of(columns)
    measured = series.names
    if "velocity" not in series:
        series = series.with_channel("velocity", "m/s", np.gradient(series["displacement"], series.time))
    found = [*record_faults(series, measured=measured, conditions=stated), *part_faults(series, measured=measured)]
    return timed("; ".join(f"{one.rule.name}: {one.statement}: {one.figure}" for one in found))


def with_(columns: Columns = GOOD, /, **changed: Any) -> Columns:
    return {name: values for name, values in (columns | changed).items() if values is not None}


T, X, V, F = (GOOD[name] for name in "txvF")
SPAN = {name: float(np.ptp(values)) for name, values in GOOD.items()}
AT = 2507


def spike(name: str, length: int = 1) -> Callable[[float], Columns]:
    def change(size: float) -> Columns:
        values = GOOD[name].copy()
        values[AT : AT + length] += size * SPAN[name] * (-1.0 if values[AT] > values.mean() else 1.0)
        return with_(**{name: values})

    return change


def hum(name: str, hertz: float) -> Callable[[float], Columns]:
    return lambda size: with_(**{name: GOOD[name] + size * SPAN[name] * np.sin(2.0 * np.pi * hertz * T + 0.3)})


def late(seconds: float) -> Columns:
    return with_(F=np.interp(T - seconds, T, F))


def averaged(samples: float) -> Columns:
    count = round(samples)
    return with_(LONG, F=np.convolve(LONG["F"], np.ones(count) / count, "same"))


def repeated(share: float) -> Columns:
    kept = np.arange(T.size)
    places = np.flatnonzero(np.abs(V) > 0.2 * V.max())[5::7][: round(share * T.size)]
    kept[places] -= 1
    return with_(x=X[kept], v=V[kept], F=F[kept])


def clipped(share: float) -> Columns:
    return with_(x=np.minimum(X, (1.0 - share) * X.max()))


def step(where: Callable[[Array], Array], at: float = 6.0) -> Callable[[float], Columns]:
    return lambda size: with_(F=np.where((at < T) & where(V), (1.0 + size) * F, F))


def step_with_motion(ratio: float) -> Columns:
    parts = [sine(seconds=5.0, stroke=stroke) for stroke in (40.0, 40.0 * ratio)]
    columns = {name: np.concatenate([part[name] for part in parts]) for name in "xvF"}
    columns["F"] = columns["F"] * np.where(T < 5.0, 1.0, 1.1)
    return with_(**columns)


def stopping(speed: float) -> Columns:
    """The machine runs slower after 7 s."""
    phase = np.where(T < 7.0, T, 7.0 + speed * (T - 7.0))
    factor, omega = np.where(T < 7.0, 1.0, speed), 4.0 * np.pi
    stroke = np.where(T < 7.0, 20.0, 20.0 * np.exp(-(T - 7.0) / 2.0))
    v = np.gradient(stroke * np.sin(omega * phase), T)
    force = 150.0 + 500.0 * np.tanh(v / 60.0) + 2.0 * v
    return with_(x=stroke * np.sin(omega * phase) + 0.01 * NOISE[0], v=v + 0.2 * NOISE[1], F=force * factor**0)


def scaled_time(factor: float) -> Columns:
    return with_(t=factor * T, v=V / factor)


CASES = {
    "a slow sample rate": Case(scaled_time, "sample rate", 20.0, 35.0),
    "a fast sample rate": Case(scaled_time, "sample rate", 1.5e-3, 5e-3),
    "a slow velocity": Case(lambda k: with_(v=k * V, x=None), "unit of the velocity", 1e-3, 9e-3),
    "a fast velocity": Case(lambda k: with_(v=k * V, x=None), "unit of the velocity", 20.0, 90.0),
    "a small displacement": Case(lambda k: with_(x=k * X, v=k * V), "unit of the displacement", 1e-3, 5e-3),
    "a large displacement": Case(lambda k: with_(x=k * X, v=k * V), "unit of the displacement", 8.0, 30.0),
    "a small force": Case(lambda k: with_(F=k * F), "unit of the force", 5e-4, 3e-3),
    "a large force": Case(lambda k: with_(F=k * F), "unit of the force", 50.0, 200.0),
    "a stated gas force that is smaller": Case(
        lambda k: with_(F=F / k), "lbf labelled N", 3.0, 4.4, DynoConditions(gas_force=150.0)),
    "a stated gas force that is larger": Case(
        lambda k: with_(F=F / k), "lbf labelled N", 4.5, 6.0, DynoConditions(gas_force=150.0)),
    "a stated gas force in pounds": Case(
        lambda k: with_(F=k * F), "N labelled lbf", 4.5, 6.0, DynoConditions(gas_force=150.0)),
    "a stated gas force of an unclear record": Case(
        lambda k: with_(F=F / 4.448 + k * NOISE[2]), "lbf labelled N", 10.0, 900.0, DynoConditions(gas_force=150.0)),
    "a negative force at standstill": Case(lambda k: with_(F=F - k), "negative force at stand", 130.0, 400.0),
    "a large force at standstill": Case(lambda k: with_(F=F + k), "large force at stand", 300.0, 2000.0),
    "a large force at standstill of a stiff shock": Case(
        lambda k: with_(F=4.0 * F + k * SPAN["F"]), "large force at stand", 0.5, 4.0),
    "a rectified force": Case(lambda k: with_(F=np.abs(F - F.min() - k * SPAN["F"])), "rectified", 0.02, 0.2),
    "a force with a floor": Case(lambda k: with_(F=np.abs(F) - k * SPAN["F"]), "rectified", 1e-3, 0.1),
    "a rectified force that is unrelated to speed": Case(
        lambda k: with_(F=np.abs(np.abs(F) + k * 300.0 * NOISE[2])), "rectified", 0.3, 12.0),
    "a noisy rectified force": Case(lambda k: with_(F=np.abs(F) + k * NOISE[2]), "rectified", 300.0, 9e3),
    "a force without velocity": Case(lambda k: with_(F=F + k * NOISE[2]), "force without vel", 300.0, 9000.0),
    "a spike in velocity": Case(spike("v"), "the velocity jumps", 0.02, 0.6),
    "a spike in displacement": Case(spike("x"), "the displacement jumps", 2e-3, 0.2),
    "a spike in force": Case(spike("F"), "the force jumps", 0.02, 0.6),
    "a step in force": Case(lambda k: spike("F", round(k))(0.5), "the force jumps", 2.0, 20.0),
    "a noisy spike": Case(lambda k: with_(F=spike("F")(0.5)["F"] + k * NOISE[2]), "the force jumps", 1.0, 400.0),
    "a clipped displacement": Case(clipped, "the displacement is clipped", 1e-4, 0.1),
    "repeated samples": Case(repeated, "repeated samples", 5e-3, 0.06),
    "hum of 50 Hz in force": Case(hum("F", 50.0), "the force has hum", 1e-4, 0.02),
    "hum of 60 Hz in velocity": Case(hum("v", 60.0), "the velocity has hum", 1e-4, 0.02),
    "hum of a generator": Case(lambda k: hum("F", 50.0 + k)(0.02), "the force has hum", 0.05, 2.0),
    "hum among noise": Case(
        lambda k: with_(F=hum("F", 50.0)(0.02)["F"] + k * NOISE[2]), "the force has hum", 10.0, 900.0),
    "a short moving average": Case(averaged, "moving average", 1.0, 12.0),
    "a long moving average": Case(averaged, "moving average", 40.0, 90.0),
    "a moving average of a noisy force": Case(
        lambda k: with_(LONG, F=averaged(25.0)["F"] + k * np.resize(NOISE[2], LONG["t"].size)),
        "moving average", 0.02, 20.0),
    "a late force": Case(late, "the force is later", 5e-3, 0.03),
    "an early force": Case(lambda k: late(-k), "the force is earlier", 3e-4, 0.02),
    "a velocity that is too large": Case(lambda k: with_(v=(1.0 + k) * V), "times the slope", 0.01, 0.2),
    "a velocity that is too small": Case(lambda k: with_(v=V / (1.0 + k)), "times the slope", 0.01, 0.2),
    "a late velocity": Case(lambda k: with_(v=np.interp(T - k, T, V)), "velocity follows", 1e-3, 0.02),
    "an early velocity": Case(lambda k: with_(v=np.interp(T + k, T, V)), "velocity leads", 1e-3, 0.02),
    "an offset of velocity": Case(lambda k: with_(v=V + k * V.std()), "mean of velocity is off", 2e-3, 0.2),
    "a velocity that is off for a while": Case(
        lambda k: with_(v=V + k * SPAN["v"] * np.exp(-(((T - 5.0) / 0.04) ** 2))), "off the slope", 0.05, 0.8),
    "a mean velocity without a displacement": Case(
        lambda k: with_(v=V + k, x=None), "would move the shock", 5.0, 200.0),
    "a ratio above that of two units": Case(
        lambda k: with_(x=25.4 * X * (1.0 + k)), "labelled", 0.01, 0.3),
    "a ratio below that of two units": Case(
        lambda k: with_(x=25.4 * X / (1.0 + k)), "labelled", 0.01, 0.3),
    "another setting": Case(step(lambda v: v > -1e9), "the shock changed a little", 0.01, 0.04),
    "quite another setting": Case(step(lambda v: v > -1e9), "shock changed: ", 0.02, 0.1),
    "another rebound": Case(step(lambda v: v < 0.0), "rebound force", 0.01, 0.06),
    "another force at high speed": Case(step(lambda v: v > 0.6 * v.max()), "at high speed", 0.01, 0.2),
    "another setting from a late time on": Case(
        lambda k: step(lambda v: v > -1e9, at=k)(0.2), "the shock changed", 6.0, 9.8),
    "another setting from an early time on": Case(
        lambda k: step(lambda v: v > -1e9, at=k)(0.2), "the shock changed", 0.3, 4.0),
    "another setting of a noisy shock": Case(
        lambda k: with_(F=step(lambda v: v > -1e9)(0.1)["F"] * (1.0 + k * np.repeat(NOISE[0, ::250], 250))),
        "the shock changed", 1e-3, 0.2),
    "another setting with another motion": Case(step_with_motion, "the shock changed", 1.02, 2.0),
    "a drift of the force": Case(lambda k: with_(F=F * (1.0 - k * T / 10.0)), "the force drifts", 0.02, 0.2),
    "a drift of the level": Case(lambda k: with_(F=F + k * SPAN["F"] * T / 10.0), "level of the force", 0.02, 0.3),
    "a drift of the displacement": Case(lambda k: with_(x=X * (1.0 - k * T / 10.0)), "displacement drifts", 0.02, 0.2),
    "a noisy drift": Case(
        lambda k: with_(F=F * (1.0 - 0.1 * T / 10.0 + k * np.repeat(NOISE[0, ::250], 250))), "drifts", 2e-3, 0.3),
    "a stroke that grows": Case(
        lambda k: with_(x=X * (1.0 + k * T / 10.0), v=None), "displacement drifts", 0.1, 0.9),
    "a machine that slows down": Case(stopping, "motion runs down", 0.1, 3.0),
}  # fmt: skip


@pytest.mark.parametrize("name", CASES)
def test_the_size_from_which_a_fault_is_found(name: str, unchanged: Callable[..., None]) -> None:
    case = CASES[name]
    size = limit_of(lambda size: case.words in found_in(case.change(size), case.stated), case.low, case.high)
    ends = [found_in(case.change(end), case.stated) for end in (case.low, case.high)]
    unchanged({"from": size, "at either end": ends}, relative=1e-3)
