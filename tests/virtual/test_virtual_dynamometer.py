"""Laws with a lag fit the physical damper better than static laws, and a fit reads the files of `eightpost dyno`."""

import shlex
from functools import cache

import numpy as np
import pytest
from click.testing import CliRunner

from eightpost.__main__ import main
from eightpost.ident import evaluate, fit_shock
from eightpost.rig import DynoTest, read_dyno_test
from eightpost.signals import TimeSeries, parquet_header
from eightpost.virtual import (
    CONFIGURATIONS,
    Actuator,
    cavitation,
    configuration,
    measure,
    random_multisine,
    read_out,
    sine_test,
)

#: The regular tests use one row of each of two builds that do not cavitate; all twelve take minutes.
BY_DAY = (1, 12)
NUMBERS = [pytest.param(number, marks=() if number in BY_DAY else pytest.mark.nightly) for number in CONFIGURATIONS]


@cache
def records(number):
    """Return a record to fit, one of another phase draw, and whether it cavitates; short for row 12, a regular test."""
    duration = 5.0 if number == 12 else 10.0
    damper, actuator = configuration(number), Actuator()
    drives = [random_multisine(seed, duration=duration).series for seed in (1, 2)]
    responses = [damper.respond(actuator.follow(drive), rate=2000.0) for drive in drives]
    seen, unseen = (DynoTest(read_out(response, seed=i)) for i, response in enumerate(responses))
    return seen, unseen, cavitation(responses[0]).cavitates


@cache
def fit(number, law):
    seen = records(number)[0]
    return fit_shock(seen, law, segment=(1.0, seen.series.duration))


@pytest.mark.nightly
@pytest.mark.parametrize("number", NUMBERS)
def test_a_lag_halves_the_error_on_another_phase_draw_unless_it_cavitates(number):
    _, unseen, cavitates = records(number)
    segment = (1.0, unseen.series.duration)
    static, lagged = (evaluate(fit(number, law).shock, unseen, segment=segment).rms for law in ("polylinear", "lpf1"))
    # 3.4.1 has 45 % for the cavitating build 2 at 50 psi and 60 to 75 % for most others.
    assert cavitates == (number in (5, 6))
    assert 1.0 - lagged / static >= (0.35 if cavitates else 0.6)


@pytest.mark.nightly
@pytest.mark.parametrize("open_bleed", [1, 3, 5, 7])
def test_a_more_closed_bleed_raises_the_static_error_of_builds_1_and_2(open_bleed):
    few, many = (fit(number, "polylinear").rms for number in (open_bleed, open_bleed + 1))
    assert many > few


@pytest.mark.nightly
def test_a_softer_head_valve_lowers_the_static_error_at_150_psi_and_raises_it_at_50():
    error = {number: fit(number, "polylinear").rms for number in (1, 3, 5, 7)}
    assert error[7] < error[3]
    assert error[5] > 1.2 * error[1]


@pytest.mark.nightly
def test_the_errors_of_build_1_are_near_those_of_table_3_4():
    static, lagged = (fit(1, law) for law in ("polylinear", "lpf1"))
    assert static.deviation / 4.4482216 == pytest.approx(366.5, rel=0.03)
    assert static.percent == pytest.approx(8.0, abs=1.5)
    assert lagged.percent == pytest.approx(2.2, abs=0.6)


def run(words, path):
    return CliRunner().invoke(main, ["-v", "virtual", "dyno", *shlex.split(words), "-o", str(path)])


@pytest.mark.repeated
@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
def test_a_file_is_read_back_as_a_dynamometer_test(tmp_path, suffix):
    path = tmp_path / f"sub/dyno{suffix}"
    result = run("--build C/B --set 'gas=150 psi' --set clicks=14 --set 'duration=2 s' --set seed=7", path)
    assert result.exit_code == 0, result.output
    assert "C/B, 150 psi, 14 clicks" in result.output
    assert "does not cavitate" in " ".join(result.output.split())
    test = read_dyno_test(path)
    assert set(test.series.names) == {"displacement", "velocity", "force", "temperature"}
    assert test.series.sample_rate == pytest.approx(2000.0)
    note = parquet_header(path)["note"] if suffix == ".parquet" else path.read_text().splitlines()[0]
    assert note.lstrip('"').startswith("SYNTHETIC: eightpost dyno")
    assert "seed 7" in note


@pytest.mark.nightly
def test_the_same_seed_gives_the_same_file_and_the_librarys_result(tmp_path):
    paths = [tmp_path / f"{i}.parquet" for i in range(2)]
    for path in paths:
        asked = "--configuration 5 --test sine --set 'amplitude=0.5 in' --set 'speed=20 in/s' --set seed=3"
        assert run(asked, path).exit_code == 0
    assert paths[0].read_bytes() == paths[1].read_bytes()
    drivefile = sine_test(0.0127, 0.508).drivefile
    made = measure(configuration(5), drivefile, actuator=Actuator(), seed=3)
    np.testing.assert_allclose(read_dyno_test(paths[0]).series["force"], made["force"], atol=0.5)


@pytest.mark.parametrize(
    ("words", "what"),
    [
        ("", "give one shock"),
        ("--configuration 1 --build B/B", "give one shock"),
        ("--configuration 13", "1 to 12"),
        ("--configuration 1 --set clicks=3", "omit gas and clicks"),
        ("--build B/B --set 'gas=3 in'", "--set gas"),
        ("--configuration 1 --test sine", "--set amplitude"),
        ("--configuration 1 --test bump --set 'speed=10 in/s'", "omit it"),
        ("--configuration 1 --test static --set 'amplitude=1 in'", "omit it"),
        ("--configuration 1 --test bump --set 'duration=5 s'", "omit it"),
    ],
)
def test_bad_input_is_refused_with_exit_code_2_and_no_output(tmp_path, words, what):
    """Other wrong builds and motions are refused by the library: see test_dampers.py and test_bench.py."""
    path = tmp_path / "out.parquet"
    result = run(words, path)
    assert result.exit_code == 2, result.output
    assert what in " ".join(result.output.split())
    assert not path.exists()


def test_the_readings_have_the_noise_and_the_resolution_of_the_machine():
    """Noise of 0.0001 in, 0.02 in/s, 0.5 lbf and 0.05 K; rounding adds a twelfth of the squared resolution."""
    zero = np.zeros(40_000)
    names = {"displacement": "m", "velocity": "m/s", "force": "N", "warming": "K"}
    still = TimeSeries.from_channels(np.arange(zero.size) / 2e3, {name: (unit, zero) for name, unit in names.items()})
    found = read_out(still)
    inch, pound = 0.0254, 4.4482216152605
    expected = {"displacement": (1e-4 * inch, 1e-4 * inch), "velocity": (0.02 * inch, 0.01 * inch),
                "force": (0.5 * pound, 0.1 * pound), "temperature": (0.05, 0.1)}  # fmt: skip
    for name, (noise, resolution) in expected.items():
        steps = found[name] / resolution
        np.testing.assert_allclose(steps, np.round(steps), atol=1e-6)
        assert found[name].std() == pytest.approx(np.hypot(noise, resolution / np.sqrt(12.0)), rel=0.03)
    assert found["temperature"].mean() == pytest.approx(273.15 + (110.0 - 32.0) / 1.8, abs=0.01)


@pytest.mark.nightly
def test_all_writes_every_test_of_chapter_3(tmp_path):
    assert run("--configuration 1 --test all", tmp_path).exit_code == 0
    names = {path.stem for path in tmp_path.glob("*.parquet")}
    assert {"random", "random_validation", "static", "bump", "sine_1in_1ips"} <= names
    assert len(names) == 18
