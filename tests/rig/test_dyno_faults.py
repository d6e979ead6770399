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


def renamed(row, name):
    def put(columns, generator):
        return text(columns, (*NAMES[:row], name, *NAMES[row + 1 :]))

    return put


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

#: Change of the record, and the text of one of its findings or notes; test_limits_of_findings.py has the others.
FOUND = {
    "a dead velocity": (dead(V), "the column 'v' was not read: it is constant"),
    "a dead displacement": (dead(X), "the column 'x' was not read: it is constant"),
    "an unknown unit of velocity": (renamed(V, "v [furlong/x]"), "'v' was not read: its unit 'furlong/x'"),
    # clipped near the middle of its range, a velocity may have no sign left
    "a saturated velocity": (saturated(V), "the velocity is clipped|'v' was not read: it is a magnitude"),
    "a saturated force": (saturated(F), r"the force is clipped: [\d.]+ % of the samples are at -?[\d.]+ N"),
    "samples lost and joined": (lost_and_joined, "the displacement jumps|off the slope of displacement"),
    "velocity in the wrong unit": (renamed(V, "v [m/s]"), "velocity in mm/s labelled m/s"),
    "two forces": (renamed(HEAT, "Load [N]"), "'F' was read, and not 'Load'"),
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
    test = read(put(good(seed), np.random.default_rng(seed)))
    notes = (*test.remarks, *test.warnings)
    assert any(re.search(expected, note) for note in notes), notes
