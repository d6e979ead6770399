"""Every type of fault at a random place of a good record is refused or reported in a note."""

import os
import re
import tempfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from eightpost import errors
from eightpost.rig.dyno_test import read_dyno_test

RATE, COUNT = 500.0, 2000
NAMES = ("t [s]", "x [mm]", "v [mm/s]", "F [N]", "T [degC]")
T, X, V, F, HEAT = range(5)


def good(seed: int) -> np.ndarray:
    """A (5, N) record of a digressive damper with 1 ms of lag on gas, measured with noise."""
    generator = np.random.default_rng(seed)
    time = np.arange(COUNT) / RATE
    omega = 2.0 * np.pi * np.array([0.5, 1.25, 2.0, 3.5, 6.0])
    phase = omega * time[:, None] + generator.uniform(0.0, 2.0 * np.pi, 5)
    size = np.array([8.0, 4.0, 3.0, 1.5, 0.8])
    x, v, late = (size * np.sin(phase)).sum(1), (size * omega * np.cos(phase)).sum(1), 1e-3
    behind = (size * omega * np.cos(phase - late * omega)).sum(1)
    force = 150.0 + 700.0 * np.tanh(behind / 80.0) + 4.0 * behind + x
    noise = generator.standard_normal((3, COUNT)) * np.array([[0.002], [0.3], [1.0]])
    heat = 30.0 + 0.2 * time + 0.05 * generator.standard_normal(COUNT)
    return np.stack([time, x + noise[0], v + noise[1], force + noise[2], heat])


def text(columns: np.ndarray, names: tuple[str, ...] = NAMES) -> str:
    lines = [",".join(f"{value:.9g}" for value in row) for row in columns.T]
    return "\n".join([",".join(names), *lines]) + "\n"


def lost(columns, generator):
    i, n = int(generator.integers(10, COUNT - 200)), int(generator.integers(2, 150))
    return text(np.delete(columns, np.s_[i : i + n], axis=1))


def lost_and_joined(columns, generator):
    """Remove samples during which the shock moves, and close the gap in time."""
    moved = np.abs(columns[X, 100:] - columns[X, :-100])[50:-250]
    i = 50 + int(generator.choice(np.flatnonzero(moved > 0.25 * np.ptp(columns[X]))))
    cut = np.delete(columns, np.s_[i : i + 100], axis=1)
    cut[T] = columns[T, : cut.shape[1]]
    return text(cut)


def cut_off(columns, generator):
    return text(columns[:, : int(generator.integers(2, 199))])


def dead(row):
    def put(columns, generator):
        columns[row] = generator.uniform(-50.0, 50.0)
        return text(columns)

    return put


def saturated(row):
    def put(columns, generator):
        share, low = generator.uniform(0.5, 0.75), generator.random() < 0.5
        values = -columns[row] if low else columns[row]
        top = values.min() + share * np.ptp(values)
        columns[row] = np.minimum(values, top) * (-1.0 if low else 1.0)
        return text(columns)

    return put


def scaled(row, low, high):
    def put(columns, generator):
        columns[row] *= generator.uniform(low, high)
        return text(columns)

    return put


def shifted(row, low, high):
    def put(columns, generator):
        shift = int(generator.integers(low, high)) * int(generator.choice([-1, 1]))
        moved = np.roll(columns, shift, axis=1)[row]
        columns[row] = moved
        return text(columns[:, high:-high])

    return put


def offset(row, low, high):
    """Return a change that adds a share of the range, with a random sign or (low < 0) the sign of the bounds."""

    def put(columns, generator):
        sign = int(generator.choice([-1, 1])) if low > 0.0 else 1
        columns[row] += sign * generator.uniform(low, high) * np.ptp(columns[row])
        return text(columns)

    return put


def sampled_and_held(columns, generator):
    slow = int(generator.integers(2, 8))
    kept = slow * (np.arange(COUNT) // slow)
    return text(np.vstack([columns[:1], columns[1:, kept]]))


def spike(row):
    def put(columns, generator):
        i = int(generator.integers(60, COUNT - 60))
        columns[row, i] += generator.choice([-1, 1]) * generator.uniform(0.6, 3.0) * np.ptp(columns[row])
        return text(columns)

    return put


def renamed(row, name):
    def put(columns, generator):
        return text(columns, (*NAMES[:row], name, *NAMES[row + 1 :]))

    return put


def other_noise(columns, generator):
    """Replace the force by a signal that is independent of the velocity."""
    columns[F] = 500.0 * generator.standard_normal(COUNT)
    return text(columns)


#: Change of the record, and the expected error.
REFUSED = {
    "lost samples": (lost, errors.TimeGapError),
    "a record that ends early": (cut_off, (errors.TooShortError, errors.FileFormatError)),
    "a dead force": (dead(F), errors.ConstantChannelError),
    "a force of the wrong sign": (scaled(F, -1.0, -1.0), errors.WrongSignError),
    "a velocity of the wrong sign": (scaled(V, -1.0, -1.0), errors.WrongSignError),
    "a displacement of the wrong sign": (scaled(X, -1.0, -1.0), errors.WrongSignError),
    "a force without a unit": (renamed(F, "F"), errors.MissingUnitError),
    "a force in millimetres": (renamed(F, "F [mm]"), errors.UnknownUnitError),
    "no force": (renamed(F, "P [bar]"), errors.MissingChannelError),
    "no time": (renamed(T, "n [1]"), errors.MissingChannelError),
}

#: Change of the record, and the expected text of one of its findings or notes.
FOUND = {
    "a dead velocity": (dead(V), "the column 'v' was not read: it is constant"),
    "a dead displacement": (dead(X), "the column 'x' was not read: it is constant"),
    "an unknown unit of velocity": (renamed(V, "v [furlong/x]"), "'v' was not read: its unit 'furlong/x'"),
    # clipped near the middle of its range, a velocity may have no sign left
    "a saturated velocity": (saturated(V), "the velocity is clipped|'v' was not read: it is a magnitude"),
    "a saturated force": (saturated(F), r"the force is clipped: [\d.]+ % of the samples are at -?[\d.]+ N"),
    "a saturated displacement": (saturated(X), r"the displacement is clipped: [\d.]+ % of the samples are at -?[\d.]+"),
    "an offset of velocity": (offset(V, 0.02, 0.3), "the mean of velocity is off|velocity is .* times the slope"),
    "a velocity with a wrong gain": (scaled(V, 1.08, 1.3), "velocity is 1.* times the slope of displacement"),
    "a load cell off zero": (offset(F, -0.6, -0.35), "the force at standstill is negative.*zero the load cell"),
    "a load cell far off zero": (offset(F, 0.7, 3.0), "the force at standstill is (large|negative).*load cell"),
    "a force shifted in time": (shifted(F, 7, 16), "the force is (later|earlier) than a shock makes it"),
    "a displacement shifted in time": (shifted(X, 3, 16), "velocity (follows|leads) the slope of displacement"),
    "samples held": (sampled_and_held, "samples repeat the one before"),
    "samples lost and joined": (lost_and_joined, "the displacement jumps|off the slope of displacement"),
    "a spike in force": (spike(F), "the force jumps"),
    "a spike in velocity": (spike(V), "the velocity jumps"),
    "a spike in displacement": (spike(X), "the displacement jumps"),
    "velocity in the wrong unit": (renamed(V, "v [m/s]"), "velocity in mm/s labelled m/s"),
    "displacement in the wrong unit": (
        renamed(X, "x [in]"),
        "slope of displacement is 2.* times the velocity: displacement is in mm",
    ),
    "two forces": (renamed(HEAT, "Load [N]"), "'F' was read, and not 'Load'"),
    "force in the wrong unit": (renamed(F, "F [kN]"), "the unit of the force is probably wrong: it reaches"),
    "a column that is no force": (other_noise, "force and velocity are hardly related"),
}


def read(content: str):
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "run.csv"
        path.write_text(content)
        return read_dyno_test(path)


def cases(table: dict):
    """Parametrise a test with all faults of a table."""
    return pytest.mark.parametrize("fault", table)


#: Number of seeds per fault; EIGHTPOST_EXAMPLES sets a larger number.
few = settings(max_examples=int(os.environ.get("EIGHTPOST_EXAMPLES", "2")), deadline=None)
seeds = st.integers(0, 2**32 - 1)


@few
@given(seeds)
def test_a_good_record_is_read_without_a_note(seed):
    test = read(text(good(seed)))
    assert (test.warnings, test.remarks) == ((), ())


@cases(REFUSED)
@few
@given(seed=seeds)
def test_a_fault_that_makes_a_record_unusable_raises_its_own_error(fault, seed):
    put, error = REFUSED[fault]
    with pytest.raises(error, match=r"run\.csv"):
        read(put(good(seed), np.random.default_rng(seed)))


@cases(FOUND)
@few
@given(seed=seeds)
def test_a_fault_that_leaves_a_record_usable_gives_a_finding_or_a_note(fault, seed):
    put, expected = FOUND[fault]
    content = put(good(seed), np.random.default_rng(seed))
    try:
        test = read(content)
    except errors.WrongSignError:  # a force with a large shift, or noise, may have a negative correlation
        assert fault in ("a force shifted in time", "a column that is no force")
        return
    notes = (*test.remarks, *test.warnings)
    assert any(re.search(expected, note) for note in notes), notes
