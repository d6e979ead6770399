"""What is taken from the libraries that read files of other programs: numbers, units, times, and what differs."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from eightpost.confined import readers


def waveform(**facts):
    return SimpleNamespace(properties={f"wf_{name}": value for name, value in facts.items()})


MIDNIGHT = np.datetime64("2020-01-01T00:00:00")  # 18262 days after 1970


@pytest.mark.parametrize(
    ("facts", "axis"),
    [
        ({"increment": 0.002, "start_offset": 3.0}, (0.002, 3.0)),
        ({"increment": 2.0, "start_offset": 3.0, "xunit_string": " MS "}, (0.002, 0.003)),
        ({"increment": 0.5, "xunit_string": "min"}, (30.0, 0.0)),
        ({"increment": 0.5, "xunit_string": "Hz"}, (0.0, 0.0)),  # a spectrum has no time
        ({"increment": 0.5, "start_time": MIDNIGHT, "start_offset": 0.25}, (0.5, 18262 * 86400.0 + 0.25)),
        ({"increment": 0.5, "start_time": np.datetime64("NaT")}, (0.5, 0.0)),
        ({"start_time": MIDNIGHT}, (0.0, 0.0)),
    ],
)
def test_the_time_of_a_waveform_is_in_seconds(facts, axis):
    assert readers._time_axis(waveform(**facts)) == pytest.approx(axis, rel=1e-12)


def test_a_group_has_the_time_of_its_first_waveform_and_a_time_of_day_becomes_zero():
    assert readers._common_axis({"a": (0.0, 0.0), "b": (0.1, 2.0), "c": (0.2, 3.0)}) == (0.1, 2.0)
    assert readers._common_axis({"a": (0.1, 1.6e9)}) == (0.1, 0.0)
    assert readers._common_axis({"a": (0.0, 5.0)}) == readers._common_axis({}) == (0.0, 0.0)


@pytest.mark.parametrize(
    ("axis", "words"),
    [
        ((0.1, 2.0), ""),
        ((0.1, 2.0009), ""),  # less than a hundredth of a step
        ((0.1 + 1e-8, 2.0), ""),
        ((0.0, 0.0), ""),  # no waveform
        ((0.1, 2.002), "it has steps of 100 ms from 2.002 s on, others 100 ms from 2 s on"),
        ((0.2, 2.0), "it has steps of 200 ms from 2 s on, others 100 ms from 2 s on"),
        ((0.1, 7.5), "it has steps of 100 ms from 7.5 s on, others 100 ms from 2 s on"),
    ],
)
def test_channels_that_were_sampled_at_other_times_are_named(axis, words):
    found = dict(readers._with_other_times({"first": (0.1, 2.0), "other": axis}))
    assert found.get("other", "").partition(";")[0] == words
    assert "first" not in found


def test_starts_with_a_time_of_day_are_stated_relative_to_the_first():
    ((name, words),) = readers._with_other_times({"first": (0.1, 1.6e9), "other": (0.1, 1.6e9 + 7.5)})
    assert (name, words.partition(";")[0]) == (
        "other",
        "it has steps of 100 ms from 7.5 s on, others 100 ms from 0 s on",
    )


def test_without_a_waveform_no_channel_differs():
    assert not list(readers._with_other_times({"first": (0.0, 0.0), "other": (0.0, 9.0)}))


def test_times_of_day_become_seconds_from_the_first_sample():
    times = MIDNIGHT + np.array([0, 1500, 3000]).astype("timedelta64[ms]")
    assert readers._numbers(times.astype("datetime64[ns]")) == pytest.approx([0.0, 1.5, 3.0])
    assert readers._numbers(np.array([1, 2], dtype=np.int16)).dtype == np.float64


@pytest.mark.parametrize(
    ("properties", "kind", "unit"),
    [({"unit_string": " N "}, "f", "N"), ({"NI_UnitDescription": "mm"}, "f", "mm"), ({}, "f", ""), ({}, "M", "s")],
)
def test_the_unit_of_a_channel_is_that_of_its_properties(properties, kind, unit):
    channel = SimpleNamespace(properties=properties, dtype=SimpleNamespace(kind=kind))
    assert readers._unit_of(channel) == unit


def test_texts_and_arrays_of_a_measured_file_are_skipped(tmp_path, monkeypatch):
    def signal(name, samples):
        return SimpleNamespace(name=name, unit=" N ", samples=np.array(samples), timestamps=[0, 1])

    class File:
        header = SimpleNamespace(comment=None)
        closed = False
        virtual_groups = (0,)

        def included_channels(self, number):
            return {number: {0: [1, 2, 3]}}

        def select(self, places, *, copy_master):
            assert places == [(None, 0, 1), (None, 0, 2), (None, 0, 3)] and not copy_master
            return [signal("gear", ["P", "D"]), signal("force", [1, 2]), signal("spectrum", [[1.0], [2.0]])]

        def close(self):
            File.closed = True

    library = SimpleNamespace(MDF=lambda _path: File())
    monkeypatch.setattr(readers, "importlib", SimpleNamespace(import_module=lambda _: library))
    (found,), comment = readers.load_mdf(tmp_path / "run.mf4", tmp_path / "samples")
    assert (found.name, found.unit, found.size, found.times.tolist()) == ("force", "N", 2, [0.0, 1.0])
    assert np.fromfile(tmp_path / "samples", found.kind, found.size, offset=found.place).tolist() == [1, 2]
    assert comment == "" and File.closed


def test_values_of_hdf5_become_those_of_matlab(tmp_path):
    h5py = pytest.importorskip("h5py")
    path = tmp_path / "run.mat"
    with h5py.File(path, "w") as file:
        file["matrix"] = np.array([[1.0, 2.0], [3.0, 4.0]])  # stored transposed
        file["number"] = np.array([[7.0]])
        file["name"] = np.array([[104], [105]], dtype=np.uint16)
        file["name"].attrs["MATLAB_class"] = np.bytes_("char")
        file["empty"] = np.array([0, 0], dtype=np.uint64)
        file["empty"].attrs["MATLAB_empty"] = 1
        file["struct/force"] = np.array([[5.0], [6.0]])
        group = file.create_group("#refs#")
        for k in range(2):
            group[f"v{k}"] = np.array([[float(k)]])
        references = np.array([[group["v0"].ref, group["v1"].ref]], dtype=h5py.ref_dtype)
        file.create_group("runs").create_dataset("speed", data=references, dtype=h5py.ref_dtype)
    found = readers._load_hdf5(path)
    assert set(found) == {"matrix", "number", "name", "struct", "runs"}
    assert found["matrix"].tolist() == [[1.0, 3.0], [2.0, 4.0]]
    assert (found["number"], found["name"]) == (7.0, "hi")
    assert found["struct"]["force"].tolist() == [5.0, 6.0]
    assert found["runs"] == [{"speed": 0.0}, {"speed": 1.0}]
