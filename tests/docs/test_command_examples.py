"""The examples that `eightpost VERB --help` prints run, in a folder with files of the names that they use."""

from __future__ import annotations

import shlex
from collections import defaultdict

import pytest

from eightpost.__main__ import VERBS
from tests.docs.example_folders import BEFORE, CODES, NOT_RUN, RIG, SHORTER
from tests.docs.given import Given
from tests.docs.page_blocks import ROOT, blocks, commands
from tests.docs.test_pages_run import Reader, lay_out, shared, take  # noqa: F401 -- fixtures

PAGE = ROOT / "docs" / "reference" / "commands.md"


def examples() -> dict[str, list[str]]:
    """Return the examples of each verb, without `eightpost`."""
    found = defaultdict(list)
    for block in blocks(PAGE):
        if block.language == "sh":
            for words in commands(block):
                assert words[0] == "eightpost"
                found[words[1]].append(shlex.join(words[1:]))
    return found


EXAMPLES = examples()


def reason(example: str) -> str:
    """Return why an example is not run; empty if it is."""
    words = shlex.split(example)
    return next((why for first, why in NOT_RUN.items() if words[: len(shlex.split(first))] == shlex.split(first)), "")


RUN = {verb: kept for verb, found in EXAMPLES.items() if (kept := [one for one in found if not reason(one)])}


def test_every_verb_has_an_example_but_the_demo():
    assert set(VERBS) - set(EXAMPLES) <= {"demo"}
    assert sum(map(len, EXAMPLES.values())) > 90


def test_most_examples_are_run_and_every_reason_belongs_to_one():
    unused = [first for first in NOT_RUN if not any(" ".join(shlex.split(one)).startswith(first) for found in
              EXAMPLES.values() for one in found)]  # fmt: skip
    assert unused == []
    assert set(BEFORE) <= set(RUN)
    kept, every = (sum(map(len, each.values())) for each in (RUN, EXAMPLES))
    assert kept > 0.6 * every


def test_a_test_that_a_reason_names_exists():
    named = {
        word.rstrip(",;") for why in NOT_RUN.values() for word in why.split() if word.startswith(("tests/", "docs/"))
    }
    assert named
    assert {path for path in named if not (ROOT / path).is_file()} == set()


@pytest.mark.nightly
@pytest.mark.parametrize("verb", RUN)
def test_the_examples_of_a_verb_run(verb, tmp_path, monkeypatch, take):  # noqa: F811 -- the fixture
    lay_out(tmp_path)
    monkeypatch.chdir(tmp_path)
    reader = Reader(tmp_path, Given(BEFORE.get(verb, ""), SHORTER, CODES.get(verb, (0,))), take)
    for example in RUN[verb]:
        timed = example.startswith("virtual rig") and "duration" not in example and "static" not in example
        folder = tmp_path / "empty" if example == "new ." else tmp_path
        folder.mkdir(exist_ok=True)
        monkeypatch.chdir(folder)
        reader.command(["eightpost", *shlex.split(example), *(shlex.split(RIG) if timed else [])])
