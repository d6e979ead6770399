"""A short fuzz campaign with all readers: each damaged file is read, or refused with its name."""

import shutil
from pathlib import Path

import pytest

from benchmarks.fuzz.__main__ import run_campaign, table
from benchmarks.fuzz.readers import Reader, readers
from benchmarks.fuzz.samples import make_samples
from benchmarks.fuzz.worker import make_mutant

pytestmark = pytest.mark.nightly

MUTANTS, SEED = 200, 20261122


@pytest.fixture(scope="module")
def samples(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("fuzz") / "samples"
    make_samples(folder)
    return folder


@pytest.mark.slow
def test_damaged_files_are_read_or_rejected_by_name(samples):
    chosen = [reader for reader in readers() if (samples / reader.sample).exists() and reader.share >= 0.5]
    tallies = run_campaign(chosen, mutants=MUTANTS, seed=SEED, samples=samples, together=True)
    failures = [failure for tally in tallies for failure in tally.failures]
    assert not failures, "\n\n".join(f"{f.reader} {f.number}: {f.outcome}\n{f.text}" for f in failures)
    assert sum(tally.mutants for tally in tallies) >= 0.95 * MUTANTS
    assert sum(tally.counts["refused"] for tally in tallies) > 0.5 * MUTANTS, table(tallies)


def test_a_mutant_is_the_same_for_the_same_seed(samples, tmp_path):
    chosen = [reader for reader in readers() if reader.share >= 0.5 and (samples / reader.sample).exists()]
    assert len(chosen) > 5
    for reader in chosen:
        found = []
        for k, seed in enumerate((SEED, SEED, SEED + 1)):
            path = tmp_path / f"{k}"
            shutil.copy(samples / reader.sample, path)
            make_mutant(reader, 7, seed, path)
            found.append(path.read_bytes())
        assert found[0] == found[1] != found[2], reader.name


BROKEN = {
    "a traceback": ("raise KeyError(path)", "traceback"),
    "an error without the file's name": ("raise InputError('it is wrong')", "unnamed"),
    "a crash": ("os.kill(os.getpid(), 11)", "crash"),
    "too much memory": ("bytearray(1_100_000_000)[::4096] = b'x' * 268555", "memory"),
}


@pytest.mark.parametrize(("body", "outcome"), BROKEN.values(), ids=BROKEN)
def test_a_campaign_detects_the_defect_of_a_broken_reader(samples, monkeypatch, tmp_path, body, outcome):
    """A broken reader replaces those of the worker; the campaign continues and counts each mutant."""
    (tmp_path / "sitecustomize.py").write_text(
        "import os, sys, benchmarks.fuzz.readers as module\n"
        "from eightpost.errors import InputError\n"
        "class Broken:\n"
        "    calls = 0\n"
        "    def __call__(self, path):\n"
        "        self.calls += 1\n"
        f"        if self.calls > 1: {body}\n"
        "from benchmarks.fuzz.damage import flip_bits\n"
        "broken = module.Reader('broken', 'map.toml', Broken(), (flip_bits,))\n"
        "module.readers = lambda: (broken,)\n"
    )
    monkeypatch.setenv("PYTHONPATH", f"{tmp_path}:{Path(__file__).parents[1]}")
    broken = Reader("broken", "map.toml", lambda path: None, ())
    (tally,) = run_campaign([broken], mutants=3, seed=1, samples=samples)
    assert tally.mutants == 3 and tally.counts[outcome] == 3
