"""LabVIEW measurements (.lvm) are read with the times of each channel, whatever columns of X they have."""

import datetime
import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from eightpost.errors import EightpostError, FileFormatError, MissingChannelError
from eightpost.rig import read_dyno_test, read_dyno_tests
from eightpost.signals import read_record, read_records

RATE, COUNT = 500.0, 400
TIME = np.arange(COUNT) / RATE
X = 20.0 * np.sin(2.0 * np.pi * 2.5 * TIME)  # [mm]
V = 20.0 * 2.0 * np.pi * 2.5 * np.cos(2.0 * np.pi * 2.5 * TIME)  # [mm/s]
F = 900.0 * np.tanh(V / 80.0) + 1.5 * V + np.random.default_rng(1).normal(0.0, 2.0, COUNT)  # [N]
CHANNELS = (("Disp", "mm", TIME, X), ("Vel", "mm/s", TIME, V), ("Load", "N", TIME, F))
START = datetime.datetime(2024, 5, 3, 10, 0, 0)


def segment(channels, x_columns, *, starts=None, decimal=".", headers=True, comment=True, ending="", dense=False):
    """Return the lines of a segment; each channel is (name, unit, times [s], samples)."""
    multi = x_columns == "Multi"
    gap = "\t" if dense or not multi else "\t\t"
    starts = starts or [START] * len(channels)

    def tag(name, cells):
        return f"{name}\t" + gap.join(cells) + ("\t" if multi and not dense else "")

    def cell(value):
        return f"{value:.12g}".replace(".", decimal)

    names = [f"X_Value\t{c[0]}" for c in channels] if multi else ["X_Value", *(c[0] for c in channels)]
    head = [
        "", tag("Channels", [str(len(channels))]), tag("Samples", [str(c[3].size) for c in channels]),
        tag("Date", [f"{s:%Y/%m/%d}" for s in starts]), tag("Time", [f"{s:%H:%M:%S.%f}" for s in starts]),
        tag("Y_Unit_Label", [c[1] for c in channels]), tag("X_Dimension", ["Time"] * len(channels)),
        tag("X0", [cell(c[2][0]) for c in channels]), tag("Delta_X", [cell(c[2][1] - c[2][0]) for c in channels]),
        "***End_of_Header***", "\t".join(names) + ("\tComment" if comment else ""),
    ]  # fmt: skip
    rows = []
    for i in range(max(c[3].size for c in channels)):
        cells = [[cell(c[2][i]), cell(c[3][i])] if i < c[3].size else ["", ""] for c in channels]
        first = [] if multi else [cells[0][0] if x_columns == "One" else ""]
        rows.append("\t".join(first + [one for pair in cells for one in (pair if multi else pair[1:])]) + ending)
    return [*(head if headers else []), *rows]


def lvm(path, *segments, x_columns="One", decimal=".", end="\n", tags=(), encoding="utf-8"):
    """Write a file from the lines of its segments."""
    head = [
        "LabVIEW Measurement\t", "Writer_Version\t2", "Reader_Version\t2", "Separator\tTab",
        f"Decimal_Separator\t{decimal}", "Multi_Headings\tYes", f"X_Columns\t{x_columns}", "Time_Pref\tRelative",
        *tags, "***End_of_Header***\t",
    ]  # fmt: skip
    path.write_bytes(("\r\n".join([*head, *(line for one in segments for line in one)]) + end).encode(encoding))
    return path


@pytest.mark.parametrize(
    ("x_columns", "dense", "decimal", "comment"),
    [("One", False, ".", True), ("No", False, ",", False), ("Multi", False, ".", False), ("Multi", True, ",", True)],
)
def test_one_several_and_no_columns_of_x_give_the_same_record(tmp_path, x_columns, dense, decimal, comment):
    lines = segment(CHANNELS, x_columns, decimal=decimal, comment=comment, ending="\t" if comment else "", dense=dense)
    test = read_dyno_test(lvm(tmp_path / "run.lvm", lines, x_columns=x_columns, decimal=decimal))
    np.testing.assert_allclose(test.series.time, TIME, atol=1e-9)
    for name, values in (("displacement", X / 1e3), ("velocity", V / 1e3), ("force", F)):
        np.testing.assert_allclose(test.series[name], values, rtol=1e-9, atol=1e-9)
    assert test.notes == ()


@settings(max_examples=25, deadline=None)
@given(
    x_columns=st.sampled_from(["Multi", "No"]),
    rates=st.lists(st.sampled_from([100.0, 250.0, 1000.0]), min_size=2, max_size=4),
    delays=st.lists(st.sampled_from([0.0, 1e-3, 0.5]), min_size=4, max_size=4),
    sizes=st.lists(st.integers(20, 40), min_size=4, max_size=4),
    start=st.sampled_from([0.0, 2.5]),
)
def test_every_channel_is_read_at_its_own_times(tmp_path_factory, x_columns, rates, delays, sizes, start):
    """The sample of each channel is its own time in microseconds, so a wrong time is seen."""
    channels, starts, truth = [], [], {}
    for k, rate in enumerate(rates):
        own = start + np.arange(sizes[k]) / rate
        truth[f"c{k}"] = own + delays[k]
        channels.append((f"c{k}", "mm", own, 1e6 * (own + delays[k])))
        starts.append(START + datetime.timedelta(seconds=delays[k]))
    path = tmp_path_factory.mktemp("lvm") / "run.lvm"
    lines = segment(channels, x_columns, starts=starts)
    records = read_records(lvm(path, lines, x_columns=x_columns))
    found = {}
    for record in records:
        assert record.names[0] == "time"
        for name, column in zip(record.names[1:], record.columns[1:], strict=True):
            assert name not in found
            found[name] = column
            np.testing.assert_allclose(record.columns[0] + delays[0], 1e-6 * column, atol=1e-6)
    assert {name: values.size for name, values in found.items()} == {n: times.size for n, times in truth.items()}
    kinds = {times.tobytes() for times in truth.values()}
    assert len(records) == len(kinds)
    assert len(records[0].notes) == len(records) - 1


@pytest.mark.parametrize("x_columns", ["One", "Multi"])
def test_a_force_at_another_rate_is_named_and_not_read_as_if_it_had_the_rate_of_the_motion(tmp_path, x_columns):
    slow = ("Load", "N", TIME[::2], F[::2])
    path = lvm(tmp_path / "run.lvm", segment((*CHANNELS[:2], slow), x_columns), x_columns=x_columns)
    with pytest.raises(
        MissingChannelError, match=r"force.*'Load' were sampled at other times.*steps of 4 ms.*not 400 s"
    ):
        read_dyno_tests(path)
    with pytest.raises(FileFormatError, match=r"the file has 2 tables"):
        read_record(path)


def test_a_force_that_starts_later_is_named(tmp_path):
    starts = [START, START, START + datetime.timedelta(seconds=0.004)]
    path = lvm(tmp_path / "run.lvm", segment(CHANNELS, "One", starts=starts))
    with pytest.raises(MissingChannelError, match=r"'Load' were sampled at other times .*first at 0\.004 s, not"):
        read_dyno_tests(path)


def test_slow_temperatures_are_interpolated(tmp_path):
    slow = ("Temp", "Deg C", TIME[::40], 25.0 + TIME[::40])
    path = lvm(tmp_path / "run.lvm", segment((*CHANNELS, slow), "Multi"), x_columns="Multi")
    test = read_dyno_test(path)
    np.testing.assert_allclose(test.series["temperature"], 298.15 + np.minimum(TIME, TIME[::40][-1]), rtol=1e-9)
    assert test.notes == ()


@settings(max_examples=15, deadline=None)
@given(x_columns=st.sampled_from(["One", "Multi", "No"]), cuts=st.sets(st.integers(2, COUNT - 2), max_size=4))
def test_segments_that_follow_each_other_are_one_record(tmp_path_factory, x_columns, cuts):
    edges = [0, *sorted(cuts), COUNT]
    edges = [a for a, b in zip(edges, [*edges[1:], None], strict=True) if b is None or b - a > 1]
    parts = []
    for a, b in itertools.pairwise(edges):
        begin = [START + datetime.timedelta(seconds=float(TIME[a]))] * 3
        own = TIME[: b - a]
        parts.append(segment([(n, u, own, values[a:b]) for n, u, _, values in CHANNELS], x_columns, starts=begin))
    path = lvm(tmp_path_factory.mktemp("lvm") / "run.lvm", *parts, x_columns=x_columns)
    record = read_record(path)
    first = TIME[edges[0] : edges[-1]]
    np.testing.assert_allclose(record.columns[0], first - first[0], atol=1e-9)
    np.testing.assert_allclose(record.columns[record.names.index("Load")], F[edges[0] : edges[-1]], rtol=1e-9)


def test_segments_with_a_pause_between_them_are_tests_of_their_own(tmp_path):
    later = [START + datetime.timedelta(seconds=60.0)] * 3
    path = lvm(tmp_path / "run.lvm", segment(CHANNELS, "One"), segment(CHANNELS, "One", starts=later))
    assert [test.series.time.size for test in read_dyno_tests(path)] == [COUNT, COUNT]


def test_a_second_block_without_a_header_continues_the_table(tmp_path):
    half = COUNT // 2
    parts = [
        [(n, u, t[part], values[part]) for n, u, t, values in CHANNELS] for part in (slice(half), slice(half, None))
    ]
    one, other = segment(parts[0], "One"), segment(parts[1], "One", headers=False)
    test = read_dyno_test(lvm(tmp_path / "run.lvm", one, [""], other))
    np.testing.assert_allclose(test.series["force"], F, rtol=1e-9, atol=1e-9)


def test_a_block_without_times_and_header_is_refused(tmp_path):
    one, other = segment(CHANNELS, "No"), segment(CHANNELS, "No", headers=False)
    with pytest.raises(FileFormatError, match="no header and no X values"):
        read_records(lvm(tmp_path / "run.lvm", one, [""], other, x_columns="No"))


@settings(max_examples=12, deadline=None)
@given(cut=st.integers(1, 60), x_columns=st.sampled_from(["One", "Multi", "No"]))
def test_a_last_line_that_was_cut_anywhere_is_left_out_with_a_note(tmp_path_factory, cut, x_columns):
    path = lvm(tmp_path_factory.mktemp("lvm") / "run.lvm", segment(CHANNELS, x_columns), x_columns=x_columns, end="")
    content = path.read_bytes()
    last = len(content) - content.rfind(b"\n") - 1
    path.write_bytes(content[: len(content) - min(cut, last - 2)])
    record = read_record(path)
    assert record.columns[0].size == COUNT - 1
    assert any("was left out" in note for note in record.notes)


def test_a_decimal_comma_that_the_header_does_not_state_is_read(tmp_path):
    path = lvm(tmp_path / "run.lvm", segment(CHANNELS, "No", decimal=","), x_columns="No")
    path.write_text(path.read_text(encoding="utf-8").replace("Decimal_Separator\t.\n", ""), encoding="utf-8")
    test = read_dyno_test(path)
    np.testing.assert_allclose(test.series.time, TIME, atol=1e-9)
    np.testing.assert_allclose(test.series["force"], F, rtol=1e-9, atol=1e-9)


def test_columns_may_be_separated_by_commas(tmp_path):
    path = lvm(tmp_path / "run.lvm", segment(CHANNELS, "Multi"), x_columns="Multi")
    path.write_text(path.read_text(encoding="utf-8").replace("\tTab", "\tComma").replace("\t", ","), encoding="utf-8")
    np.testing.assert_allclose(read_dyno_test(path).series["force"], F, rtol=1e-9, atol=1e-9)


def test_facts_of_the_header_are_conditions_and_comments_are_noted(tmp_path):
    lines = segment(CHANNELS, "One", comment=True)
    lines[30] += "\tclick 12 to 14"
    path = lvm(tmp_path / "run.lvm", lines, tags=("UUT_Name\tFront 7", "Test_Name\tPVP 3", "Date\t2024/05/03"))
    test = read_dyno_test(path)
    assert (test.conditions.build, test.conditions.run, test.conditions.date) == ("Front 7", "PVP 3", "2024/05/03")
    assert any("click 12 to 14" in note for note in test.notes)


def test_a_spectrum_is_refused(tmp_path):
    lines = [line.replace("X_Dimension\tTime", "X_Dimension\tFrequency") for line in segment(CHANNELS, "One")]
    with pytest.raises(FileFormatError, match="'Frequency', not the time"):
        read_records(lvm(tmp_path / "run.lvm", lines))


def test_a_segment_without_names_is_refused(tmp_path):
    lines = [line for line in segment(CHANNELS, "One") if not line.startswith("X_Value")]
    with pytest.raises(FileFormatError, match="no line `X_Value`"):
        read_records(lvm(tmp_path / "run.lvm", lines))


SMALL = [(name, unit, times[:20], values[:20]) for name, unit, times, values in CHANNELS]
INSERTED = [b"\t", b"\r\n", b"\r\n\r\n", b"-", b"1e999", b"NaN", b"Channels\t2\t\r\n", b"X_Value\t",
            b"***End_of_Header***"]  # fmt: skip


@pytest.mark.nightly
@settings(max_examples=150, deadline=None)
@given(
    x_columns=st.sampled_from(["One", "Multi", "No"]),
    damages=st.lists(
        st.tuples(st.floats(0.0, 0.999), st.integers(0, 40), st.sampled_from([b"", *INSERTED])), min_size=1, max_size=3
    ),
)
def test_a_damaged_file_is_read_or_refused_with_its_name(tmp_path_factory, x_columns, damages):
    path = lvm(tmp_path_factory.getbasetemp() / "damaged.lvm", segment(SMALL, x_columns), x_columns=x_columns)
    content = path.read_bytes()
    for share, removed, inserted in damages:
        place = int(share * len(content))
        content = content[:place] + inserted + content[place + removed :]
    path.write_bytes(content)
    try:
        read_records(path)
    except EightpostError as error:
        assert "damaged.lvm" in str(error)


@pytest.mark.parametrize("stated", ["One", "Multi"])
def test_a_header_that_contradicts_the_columns_is_refused(tmp_path, stated):
    actual = "Multi" if stated == "One" else "One"
    with pytest.raises(FileFormatError, match=f"its header states the X columns '{stated}'"):
        read_records(lvm(tmp_path / "run.lvm", segment(CHANNELS, actual), x_columns=stated))


def test_a_table_without_the_header_of_labview_is_read_as_text(tmp_path):
    rows = [f"{t:.6f}\t{v:.6f}\t{f:.6f}" for t, v, f in zip(TIME, V, F, strict=True)]
    path = tmp_path / "run.lvm"
    path.write_text("\n".join(["Time [s]\tVelocity [mm/s]\tForce [N]", *rows]) + "\n", encoding="utf-8")
    np.testing.assert_allclose(read_dyno_test(path).series["force"], F, atol=1e-6)
