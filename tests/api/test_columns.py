"""Fits of columns in memory, gaps that are bridged, and what a fit predicts."""

from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest

import eightpost as ep
from eightpost.api.models import _tests
from eightpost.ident.shock.simulation import as_measured, predicted_force, r_squared, simulate
from eightpost.rig import dyno_test_of
from eightpost.rig.columns import with_channels
from eightpost.shock import read_shock
from eightpost.signals import ChannelMap, TimeSeries
from eightpost.signals.raw_record import RawRecord
from tests.unchanged import refusals

TIME = np.arange(1500) / 500.0
SPEED = 0.1 * np.cos(10.0 * TIME) + 0.03 * np.cos(23.0 * TIME)
FORCE = 1000.0 * np.tanh(10.0 * SPEED)
COLUMNS = {"Time [s]": TIME, "Velocity [mm/s]": 1000.0 * SPEED, "Force [N]": FORCE}


@pytest.fixture(scope="module")
def shock():
    return read_shock(ep.examples() / "bank" / "B_B.json")


@pytest.fixture(scope="module")
def frame():
    return pytest.importorskip("pandas").DataFrame(COLUMNS)


@pytest.fixture(scope="module")
def fit(frame):
    return ep.fit(frame, "Polylinear")


@pytest.mark.slow
def test_a_data_frame_is_fitted_as_the_file_of_the_same_columns_is(tmp_path, fit, frame):
    path = tmp_path / "a.csv"
    frame.to_csv(path, index=False)
    of_file = ep.fit(path, "polylinear")
    assert of_file.rms == pytest.approx(fit.rms, rel=1e-9) and fit.rms < 0.01 * fit.deviation
    assert fit.shock.inputs == () and of_file.shock.inputs[0]["name"] == "a.csv"


def test_a_mapping_of_columns_is_read_as_the_data_frame_is(frame):
    given = {"channel_map": None, "units": None, "flip": ()}
    of_frame, of_mapping = (_tests(columns, given)[0].series for columns in (frame, COLUMNS))
    assert of_frame.names == of_mapping.names == ("velocity", "force")
    np.testing.assert_array_equal(of_frame.values, of_mapping.values)
    np.testing.assert_allclose(of_mapping["velocity"], SPEED)


def test_units_of_columns_are_given_by_the_name_of_the_column_or_of_the_channel():
    columns = {"time [s]": TIME, "Shaft velocity": 1000.0 * SPEED, "Load": -FORCE}
    for units in ({"Shaft velocity": "mm/s", "Load": "N"}, {"velocity": "mm/s", "force": "N"}):
        series = dyno_test_of(columns, units=units, flip=["force"]).series
        np.testing.assert_allclose(series["velocity"], SPEED)
        np.testing.assert_array_equal(series["force"], FORCE)


def test_gaps_up_to_the_stated_length_become_straight_lines_and_a_note_counts_them(unchanged):
    force = FORCE.copy()
    force[100:103] = force[200:202] = np.nan
    columns = COLUMNS | {"Force [N]": force}
    unchanged(refusals({str(bridge): lambda bridge=bridge: dyno_test_of(columns, channel_map=ChannelMap(bridge=bridge))
                        for bridge in (0, 2)}))  # fmt: skip
    test = dyno_test_of(columns, channel_map=ChannelMap(bridge=3))
    np.testing.assert_allclose(test.series["force"][99:104], np.linspace(FORCE[99], FORCE[103], 5))
    assert any("5 of 1500 samples of 'Force' are NaN or empty, at most 3 in a row" in text for text in test.derived)


def test_gaps_at_the_ends_and_texts_stay_as_they_are():
    gap = np.array([np.nan, 1.0, np.nan, 3.0, np.nan])
    text = np.array(["", "1", "", "3", "5"], dtype=object)
    word = np.array(["", "1", "", "x", "5"], dtype=object)
    record = RawRecord.in_memory({"gap": gap, "text": text, "word": word}).bridged(5)
    np.testing.assert_array_equal(record.columns[0], [np.nan, 1.0, 2.0, 3.0, np.nan])
    np.testing.assert_array_equal(record.columns[1], [np.nan, 1.0, 2.0, 3.0, 5.0])
    assert record.columns[2].tolist() == word.tolist() and np.isnan(gap[2])


def test_a_map_a_command_and_a_script_state_the_gaps_to_bridge(tmp_path, frame):
    (tmp_path / "map.toml").write_text("bridge = 4\n")
    assert ChannelMap.read(tmp_path / "map.toml").bridge == 4
    stated = with_channels(ChannelMap(bridge=4), {"bridge": "7"})
    assert (stated.bridge, dict(stated.channels)) == (7, {})
    assert with_channels(ChannelMap(bridge=4), {"force": "F"}).bridge == 4
    text = frame.astype(object)
    text.loc[700, "Force [N]"] = ""
    text.to_csv(tmp_path / "a.csv", index=False)
    test = ep.read(tmp_path / "a.csv", "dyno", channel_map={"bridge": "1"})
    assert test.series["force"][700] == pytest.approx(0.5 * (FORCE[699] + FORCE[701]), rel=1e-6)


def test_the_score_is_one_for_the_law_itself_zero_for_the_mean_and_below_for_worse(shock):
    force = predicted_force(shock, SPEED, 0.002)
    assert r_squared(shock, SPEED, force, 0.002) == 1.0
    series = TimeSeries.from_channels(TIME, {"velocity": ("m/s", SPEED), "force": ("N", force + 10.0)})
    expected = 1.0 - 100.0 * force.size / np.sum((force - force.mean()) ** 2)
    assert r_squared(shock, series, None, None) == pytest.approx(expected)
    assert r_squared(shock, SPEED, 2.0 * force.mean() - force, 0.002) < 0.0


def test_a_prediction_has_the_gas_force_of_the_dynamometer_about_the_reference_of_the_fit(shock):
    conditions = {"gas_treatment": "included", "gas_preload_estimate [N]": 50.0, "gas_stiffness_estimate [N/m]": 1e3}
    moved = 0.02 + 0.01 * np.sin(10.0 * TIME)
    motion = np.column_stack((SPEED, moved))
    plain = SimpleNamespace(law=shock.law, conditions={"gas_treatment": "estimate"})
    for reference, middle in (({"displacement_reference [m]": 0.015}, 0.015), ({}, moved.mean())):
        gassed = SimpleNamespace(law=shock.law, conditions=conditions | reference)
        port = shock.law.port
        gas = 50.0 + 1e3 * (moved - middle) - port.gas_preload - port.gas_stiffness * (moved - moved.mean())
        difference = predicted_force(gassed, motion, 0.002) - predicted_force(plain, motion, 0.002)
        np.testing.assert_allclose(difference, gas, atol=1e-9)
    assert as_measured(plain) == shock.law
    np.testing.assert_array_equal(
        predicted_force(plain, SPEED, 0.002),
        simulate(shock.law, TimeSeries.from_channels(0.002 * np.arange(SPEED.size), {"velocity": ("m/s", SPEED)})),
    )


def test_a_fit_predicts_and_scores_its_own_record(fit):
    assert fit.score(dyno_test_of(COLUMNS)) > 0.999 and fit.score(SPEED, FORCE, step=0.002) > 0.999
    np.testing.assert_array_equal(fit.predict(SPEED, step=0.002), predicted_force(fit.shock, SPEED, 0.002))


def test_laws_and_versions_are_spelled_alike_in_files_scripts_and_commands(tmp_path, shock):
    document = (ep.examples() / "bank" / "B_B.json").read_text()
    (tmp_path / "a.json").write_text(
        document.replace(f'"law": "{shock.law_name}"', f'"law": "{shock.law_name.upper()}"')
    )
    assert read_shock(tmp_path / "a.json").law == shock.law


def test_wrong_columns_motions_laws_and_versions_are_refused(tmp_path, shock, unchanged):
    """A law that does not exist is refused before the record is read."""
    (tmp_path / "map.toml").write_text('bridge = "10 ms"\n')
    lengths = ({}, {"a": [1.0], "b": [1.0, 2.0]}, {"a": [[1.0]]})
    motions = ((SPEED, None), (np.zeros((5, 3)), 0.1), (np.zeros((2, 2, 2)), 0.1))
    laws = ("lpn2", "xyz", "auto", "maxwell")
    unchanged(refusals({
        **{f"columns {one}": partial(RawRecord.in_memory, one) for one in lengths},
        **{f"a motion {one[0].shape} {one[1]}": partial(predicted_force, shock, *one) for one in motions},
        **{f"the law {law}": partial(ep.fit, "examples/no.csv", law) for law in laws},
        "no units": lambda: dyno_test_of({"time [s]": TIME, "Shaft velocity": SPEED, "Load": FORCE}),
        "a time to bridge": lambda: ChannelMap.read(tmp_path / "map.toml"),
        "3 forces": lambda: r_squared(shock, SPEED, FORCE[:3], 0.002),
        "FMI 4": lambda: ep.build(ep.examples() / "bank" / "B_B.json", tmp_path, fmi=4.0),
    }))  # fmt: skip
