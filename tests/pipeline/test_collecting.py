"""Python's search for cycles is put off while a bake is set up, and only then."""

from __future__ import annotations

import gc

import pytest

from featherfx.files.process import seldom_collected


@pytest.fixture
def usual():
    before = gc.get_threshold()
    gc.set_threshold(700, 10, 10)
    yield (700, 10, 10)
    gc.set_threshold(*before)


def test_it_is_put_off_within_and_the_last_to_leave_restores_it(usual):
    one, other = seldom_collected(), seldom_collected()
    one.__enter__()
    assert gc.get_threshold()[0] > 100 * usual[0]
    other.__enter__()
    one.__exit__(None, None, None)
    assert gc.get_threshold()[0] > 100 * usual[0]
    other.__exit__(None, None, None)
    assert gc.get_threshold() == usual


def test_an_error_restores_it(usual):
    with pytest.raises(ValueError, match="broken"), seldom_collected():
        raise ValueError("broken")
    assert gc.get_threshold() == usual


def test_what_is_off_stays_off(usual):
    gc.set_threshold(0, 10, 10)
    with seldom_collected():
        assert gc.get_threshold()[0] == 0
    assert gc.get_threshold() == (0, 10, 10)
