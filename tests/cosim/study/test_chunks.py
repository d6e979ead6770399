"""Chunks of a study: every setup once, whatever was completed before; a result that is never half of one."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cosim.study import table
from cosim.study.running import sweep
from cosim.study.running.sweep import BATCH, ChunkFolder, Cutter, gaps, run_study
from cosim.study.running.workers import Chunk
from cosim.study.table import StudyResult, study_schema
from cosim.study.verdict import study_verdict
from eightpost.errors import FileFormatError, InputError

from .constructed import result

RANGES = st.lists(st.tuples(st.integers(0, 60), st.integers(1, 20)).map(lambda p: range(8 * p[0], 8 * sum(p))))


# ---- Which setups are run -------------------------------------------------------------------------------------------


@pytest.mark.nightly
@given(done=RANGES, count=st.integers(0, 700), cost=st.floats(1e-5, 10.0), workers=st.integers(0, 64))
def test_every_setup_that_is_not_completed_is_in_one_chunk(done, count, cost, workers):
    numbers = 3 * np.arange(count)
    cutter = Cutter(numbers, done, lambda: workers)
    completed = set().union(*done) if done else set()
    expected = [3 * k for k in range(count) if k not in completed]
    assert cutter.left == len(expected)
    found = []
    for chunk in cutter:
        assert numbers[chunk.number] == chunk.indices[0]
        assert chunk.number % BATCH == 0, "a batch is not divided"
        found += chunk.indices
        cutter.learn([{"seconds": cost}] * len(chunk.indices))
    assert found == expected and cutter.left == 0


@given(done=RANGES, count=st.integers(0, 700))
def test_gaps_and_completed_ranges_cover_everything_once(done, count):
    open_ = [k for part in gaps(done, count) for k in part]
    assert open_ == [k for k in range(count) if not any(k in part for part in done)]


@pytest.mark.parametrize(("cost", "largest"), [(1e-4, 1024), (0.02, 96), (0.1, 16), (10.0, 8)])
def test_chunks_take_some_seconds_and_all_workers_end_together(cost, largest):
    cutter, sizes = Cutter(np.arange(20_000), (), lambda: 4), []
    for chunk in cutter:
        sizes.append(len(chunk.indices))
        cutter.learn([{"seconds": cost}] * len(chunk.indices))
    assert sizes[0] == BATCH and max(sizes) == largest
    assert sizes[-1] <= BATCH and all(size * cost <= 2.5 or size == BATCH for size in sizes)


# ---- Files of the chunks, and the result ----------------------------------------------------------------------------


@pytest.fixture
def whole() -> StudyResult:
    """Return a result of 2401 setups of which one failed and two are marked."""
    return result(
        {"a": lambda digits: digits @ (4.0, 3.0, 2.0, 1.0), "b": lambda digits: -digits[:, 0] + 0.01 * digits[:, 3]},
        marks={3: "coupling error 1 %", 9: "lf beyond its fitted velocities"},
        failed=(5,),
        baseline=dict.fromkeys(("lf", "rf", "lr", "rr"), "B/B"),
    )


@pytest.fixture
def folder(whole, tmp_path) -> ChunkFolder:
    """Return a folder with all setups in chunks of 100, and one chunk that repeats 50 of them."""
    found = ChunkFolder(tmp_path, "0" * 64, study_schema(whole.study, whole.provenance.measure_units))
    rows = whole.table.to_pylist()
    for first in range(0, len(rows), 100):
        found.write(Chunk(first, ()), rows[first : first + 100])
    found.write(Chunk(150, ()), rows[150:200])
    return found


def test_joined_chunks_are_the_table_and_only_some_rows_are_in_memory(folder, whole, monkeypatch):
    monkeypatch.setattr(sweep, "_ROWS", 300)
    parts = list(folder.tables())
    assert pa.concat_tables(parts).equals(whole.table.replace_schema_metadata())
    assert max(map(len, parts)) <= 300 + 100


def test_a_result_that_cannot_be_completed_leaves_the_old_one(folder, whole, tmp_path):
    path = tmp_path / "results.parquet"
    whole.save(path)
    before = path.read_bytes()
    (damaged,) = tmp_path.glob("chunks/*/chunk_0001200_100.parquet")
    damaged.write_bytes(damaged.read_bytes()[:-20])
    with pytest.raises(FileFormatError, match=r"chunk_0001200_100\.parquet.*delete the file to run its setups again"):
        StudyResult.join(path, whole.study, folder.tables(), whole.provenance, partial=False)
    assert path.read_bytes() == before
    assert [one.name for one in tmp_path.iterdir() if one.is_file()] == ["results.parquet"]


def test_a_chunk_with_other_rows_than_its_name_states_is_refused(folder, tmp_path):
    (one,) = tmp_path.glob("chunks/*/chunk_0000300_100.parquet")
    one.rename(one.with_name("chunk_0000300_200.parquet"))
    with pytest.raises(FileFormatError, match="has 100 rows, not 200 as its name states"):
        list(folder.tables())


@pytest.mark.parametrize("first", [(10, 10), (0, 5)], ids=["swapped", "overlapping"])
def test_setups_that_are_not_in_order_are_refused(whole, tmp_path, first):
    parts = [whole.table.slice(*first), whole.table.slice(3, 10)]
    with pytest.raises(InputError, match="not in order"):
        StudyResult.join(tmp_path / "results.parquet", whole.study, parts, whole.provenance, partial=False)
    assert not (tmp_path / "results.parquet").exists()


# ---- Tables that are too large for the memory -----------------------------------------------------------------------


@pytest.fixture
def stored(whole, tmp_path, monkeypatch) -> StudyResult:
    """Return the same result, read from its file column by column."""
    monkeypatch.setattr(table, "IN_MEMORY", 0)
    whole.save(tmp_path / "results.parquet")
    return StudyResult.load(tmp_path / "results.parquet")


def test_a_table_that_is_read_column_by_column_says_the_same(whole, stored):
    assert isinstance(stored.table, table.StoredTable)
    assert stored.ranking().tolist() == whole.ranking().tolist()
    assert stored.ranking("b").tolist() == whole.ranking("b").tolist()
    assert stored.failures == whole.failures and len(stored.failures) == 1
    assert stored.marked("beyond its fitted") == whole.marked("beyond its fitted") == 1
    assert stored.baseline_row == whole.baseline_row and stored.builds("lr") == whole.builds("lr")
    assert study_verdict(stored) == study_verdict(whole)
    assert stored.table.read().equals(whole.table.replace_schema_metadata())


def test_a_result_that_is_replaced_while_it_is_read_is_noticed(stored, whole, tmp_path):
    replace(whole, table=whole.table.slice(0, 100)).save(tmp_path / "results.parquet")
    with pytest.raises(FileFormatError, match="was replaced or removed while it was used; run the command again"):
        stored.ranking()


# ---- A study whose process is killed --------------------------------------------------------------------------------

#: A study that kills its own process when four chunks are completed.
MAIN = """
import os, signal, sys
from pathlib import Path
from cosim.study import Study
from cosim.study.running.sweep import run_study
from tests.cosim.study.conftest import WorkersHere

def kill(done, total):
    if done == 32:
        os.kill(os.getpid(), signal.SIGKILL)

run_study(Study.from_json(Path(sys.argv[1]).read_text()), sys.argv[2], WorkersHere(), kill)
"""


@pytest.mark.nightly
@pytest.mark.skipif(sys.platform == "win32", reason="needs SIGKILL")
def test_a_study_that_is_killed_loses_nothing_and_runs_nothing_twice(small_study, here, tmp_path: Path) -> None:
    bank = {f"{name} {k}": build for name, build in small_study().bank.items() for k in range(2)}
    corners = {**dict.fromkeys(small_study().corners, tuple(bank)), "rr": ("soft 0",)}
    made = small_study(bank=bank, corners=corners)
    (tmp_path / "study.json").write_text(made.to_json())
    command = [sys.executable, "-c", MAIN, str(tmp_path / "study.json"), str(tmp_path / "out")]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(Path(__file__).parents[3]), *sys.path])}
    killed = subprocess.run(command, env=environment, capture_output=True, check=False)
    assert killed.returncode == -signal.SIGKILL, killed.stderr.decode()[-2000:]
    assert not (tmp_path / "out" / "results.parquet").exists()
    found = run_study(made, tmp_path / "out", here)
    assert here.ran == list(range(32, 64)), "32 setups were completed before"
    assert found.setups.tolist() == list(range(64)) and not found.partial
    again = run_study(made, tmp_path / "whole", here)
    assert found.table.drop_columns(["seconds"]).equals(again.table.drop_columns(["seconds"]))


@pytest.mark.nightly
def test_a_study_larger_than_the_memory_limit_has_the_same_rows(small_study, here, tmp_path, monkeypatch):
    small = run_study(small_study(), tmp_path / "small", here)
    monkeypatch.setattr(table, "IN_MEMORY", 0)
    large = run_study(small_study(), tmp_path / "large", here)
    assert isinstance(large.table, table.StoredTable)
    assert large.table.read().drop_columns(["seconds"]).equals(small.table.drop_columns(["seconds"]))
