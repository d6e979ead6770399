"""Every fault raises its own error, which states the location."""

from pathlib import Path

import numpy as np
import pytest

from eightpost.errors import (
    BackwardTimeError,
    ConstantChannelError,
    DuplicateTimeError,
    NotANumberError,
    TimeGapError,
    TooShortError,
    WrongSignError,
)
from eightpost.signals import faults
from eightpost.signals.faults import Origin

TIME = np.arange(2000) / 1000.0
SINE = np.sin(2 * np.pi * 2.0 * TIME)
#: Channels with correlations of -0.295 and -0.305 with the sine.
WEAK, STRONG = (np.cos(2 * np.pi * 2.0 * TIME) - ratio * SINE for ratio in (0.3087, 0.3203))
#: The first sample is in line 11 of the file.
ORIGIN = Origin(Path("run.csv"), np.arange(2000) + 11, 10)


def changed(values, sample, value):
    copy = values.copy()
    copy[sample] = value
    return copy


FAULTS = {
    "NaN": (
        NotANumberError,
        r"run\.csv, line 16, channel 'force': the value is NaN",
        lambda: faults.check_finite(changed(SINE, 5, np.nan), channel="force", origin=ORIGIN),
    ),
    "infinite": (
        NotANumberError,
        r"run\.csv, line 16, channel 'force': the value is -inf",
        lambda: faults.check_finite(changed(SINE, 5, -np.inf), channel="force", origin=ORIGIN),
    ),
    "huge": (
        NotANumberError,
        r"run\.csv, line 16, channel 'force': the value is -1e\+100 \(SI\)",
        lambda: faults.check_moves(changed(SINE, 5, -1e100), channel="force", origin=ORIGIN),
    ),
    "backward": (
        BackwardTimeError,
        r"run\.csv, line 111, channel 'time': time decreases from 0.099 s to 0 s",
        lambda: faults.check_time(changed(TIME, 100, 0.0), origin=ORIGIN),
    ),
    "duplicate": (
        DuplicateTimeError,
        r"run\.csv, line 111, channel 'time': the time 0.099 s is repeated",
        lambda: faults.check_time(changed(TIME, 100, 0.099), origin=ORIGIN),
    ),
    "gap": (
        TimeGapError,
        r"run\.csv, line 111, channel 'time': there is a gap of 0.501 s between 0.099 s and 0.6 s",
        lambda: faults.check_gaps(np.where(TIME > 0.0995, TIME + 0.5, TIME), origin=ORIGIN),
    ),
    "short": (
        TooShortError,
        r"run\.csv, line 110, channel 'time': the record has 100 samples over 0.099 s; at least 200 samples",
        lambda: faults.check_length(TIME[:100], shortest=0.5, fewest=200, origin=ORIGIN),
    ),
    "constant": (
        ConstantChannelError,
        r"run\.csv, line 11, channel 'force': the channel is constant at 3.5 ",
        lambda: faults.check_moves(np.full(2000, 3.5), channel="force", origin=ORIGIN),
    ),
    "no relation": (
        WrongSignError,
        r"its correlation with velocity is -0.29\d, so .*its delay, and its sign \(--channel\)",
        lambda: faults.check_sign(WEAK, SINE, channel="force", against="velocity", origin=ORIGIN),
    ),
    "weak sign": (
        WrongSignError,
        r"is -0.30\d, so one of the two has the wrong sign",
        lambda: faults.check_sign(STRONG, SINE, channel="force", against="velocity", origin=ORIGIN),
    ),
    "sign": (
        WrongSignError,
        r"run\.csv, line 10, channel 'force': its correlation with velocity is -1.000.*--channel force=-",
        lambda: faults.check_sign(-SINE, SINE, channel="force", against="velocity", origin=ORIGIN),
    ),
}


@pytest.mark.parametrize("name", FAULTS)
def test_a_fault_raises_its_own_error_with_its_location(name):
    error, message, check = FAULTS[name]
    with pytest.raises(error, match=message):
        check()


@pytest.mark.parametrize(("samples", "is_clipped"), [(faults.CLIP_RUN, True), (faults.CLIP_RUN - 1, False)])
def test_a_channel_is_clipped_from_as_many_equal_samples_in_sequence_as_stated(samples, is_clipped):
    values, top = np.linspace(0.0, 0.9, SINE.size), np.arange(samples)
    for start in (100, 600, 1100, 1600):
        values[start + top] = 1.0
    assert faults.clipped_samples(values, np.ones(values.size, dtype=bool)).size == 4 * samples * is_clipped


def test_time_printed_with_few_digits_has_no_gap():
    faults.check_gaps(np.round(np.arange(1000) / 300.0, 4))


@pytest.mark.parametrize(
    ("gas", "advice"),
    [
        (0.2, "`--channel displacement=-` if the force at low speed, which is positive, is that of the gas"),
        (-0.2, "`--channel force=-` if the force at low speed, which is negative, is that of the gas"),
        (0.01, "`--channel force=-` if the velocity derived from displacement is right"),
    ],
)
def test_of_a_contradiction_the_channel_is_reversed_that_makes_the_gas_force_positive(gas, advice):
    with pytest.raises(WrongSignError) as caught:
        faults.check_sign(gas - SINE, SINE, channel="force", against="the velocity derived from displacement")
    assert advice in str(caught.value)


def test_a_wrong_sign_names_the_channel_to_flip_not_what_was_derived_from_it():
    with pytest.raises(
        WrongSignError, match=r"`--channel force=-` if the velocity .* otherwise `--channel displacement=-`,"
    ):
        faults.check_sign(-SINE, SINE, channel="force", against="the velocity derived from displacement")
