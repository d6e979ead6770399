"""Progress is reported as shares that never decrease, however the work is divided."""

import time

import pytest
from hypothesis import given
from hypothesis import strategies as st

from eightpost.ident.threads import for_each
from eightpost.progress import advance, beat, continued, parts, portion, reported_to

#: Work as a tree: a leaf, or a list of parts.
WORK = st.recursive(st.none(), lambda part: st.lists(part, max_size=4), max_leaves=20)


def do(work):
    for part in parts(work or ()):
        do(part)
    beat()


@given(WORK)
def test_the_share_never_decreases_and_ends_at_one(work):
    told = []
    with reported_to(lambda done, total: told.append((done, total))):
        do(work)
    shares = [done for done, _ in told]
    assert shares == sorted(shares)
    assert (shares[0], shares[-1]) == (0.0, 1.0)
    assert {total for _, total in told} == {1.0}


@given(WORK)
def test_without_a_callback_the_same_work_is_done(work):
    assert list(parts(work or ())) == list(work or ())
    do(work)
    advance(1.0, 2.0)


def test_a_part_of_a_part_is_a_share_of_it():
    told = []
    with reported_to(lambda done, _: told.append(done)), portion(0.5, 1.0):
        for _ in parts(range(2)):
            advance(1.0, 2.0)
    assert told == [0.0, 0.625, 0.75, 0.875, 1.0]


def test_work_that_fails_is_not_reported_as_done():
    told = []
    with pytest.raises(ValueError, match="failed"), reported_to(lambda done, _: told.append(done)):
        for part in parts(range(4)):
            if part == 2:
                raise ValueError("failed")
    assert told[-1] == 0.5
    beat()  # nobody listens any more
    assert told[-1] == 0.5


def test_an_exception_of_the_callback_ends_the_work():
    def stop(done, _total):
        if done >= 0.5:
            raise KeyboardInterrupt

    made = []
    with pytest.raises(KeyboardInterrupt), reported_to(stop):
        made.extend(parts(range(4)))
    assert made == [0, 1]


def test_work_in_threads_is_reported_while_it_goes_on():
    calls = []
    with reported_to(lambda done, _: calls.append(done)):
        assert for_each([0.3, 0.3], lambda seconds: time.sleep(seconds) or seconds) == [0.3, 0.3]
    assert len(calls) >= 4


@pytest.mark.nightly
@given(st.lists(st.lists(st.floats(0.0, 10.0), min_size=1, max_size=5).map(sorted), min_size=1, max_size=4))
def test_work_that_begins_again_is_added(rounds):
    told = []
    tell = continued(lambda done, total: told.append((done, total)))
    for one in rounds:
        for done in one:
            tell(done, 10.0)
    assert told == sorted(told)
