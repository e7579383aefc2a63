"""Phases of long work: their times add up, and what is told of them holds."""

import threading
import time

import pytest

from featherfx.phases import Account, account, counted, phase, time_left


def test_the_seconds_of_phases_add_up_and_belong_to_the_innermost():
    with Account() as own:
        with phase("outer"):
            time.sleep(0.02)
            with phase("inner", silent=True):
                time.sleep(0.05)
            with phase("inner"):
                time.sleep(0.05)
        seconds = own.seconds()
        assert sum(seconds.values()) == pytest.approx(own.elapsed, abs=0.02)
    assert set(seconds) == {"starting", "outer", "inner"}
    assert seconds["inner"] >= 0.1
    assert 0.02 <= seconds["outer"] <= own.elapsed - seconds["inner"]


def test_processor_time_belongs_to_the_phase_that_works():
    with Account() as own:
        with phase("asleep"):
            time.sleep(0.1)
        with phase("at work"):
            end = time.process_time() + 0.1
            while time.process_time() < end:
                pass
        found = own.processor_seconds()
    assert found["at work"] >= 0.1
    assert found["asleep"] < 0.05


def test_time_counts_from_the_given_beginning():
    with Account(begin=time.perf_counter() - 3.0) as own, phase("late"):
        pass
    assert own.spent("starting") == pytest.approx(3.0, abs=0.5)


def test_what_is_told_of_a_phase():
    told = []
    with Account(told.append), phase("work", total=5, first=1) as done:
        time.sleep(0.2)  # the first part loads what all others need
        done(2)
        time.sleep(0.02)
        done(3)
        done(4, left=7.0)
    assert [(each.name, each.done, each.total, each.ended) for each in told] == [
        ("work", 1, 5, False),
        ("work", 2, 5, False),
        ("work", 3, 5, False),
        ("work", 4, 5, False),
        ("work", 5, 5, True),
    ]
    assert [told[k].left for k in (0, 1, 3, 4)] == [None, None, 7.0, 0.0]
    assert told[2].left == pytest.approx(2 * (told[2].seconds - told[1].seconds))


def test_the_most_parts_that_there_may_be_say_nothing_of_the_time_left():
    told = []
    with Account(told.append), phase("settling", total=24, at_most=True) as done:
        done(3)
        done(4, left=2.0)
    assert [each.left for each in told] == [None, None, 2.0, None]


def test_phases_within_a_whole_one_are_told_and_timed_as_that():
    told = []
    with Account(told.append) as own:
        with phase("calibrating", 2, whole=True) as done:
            assert list(counted("settling", "ab", 2)) == ["a", "b"]
            done(1)
        with phase("settling", 1):
            pass
    assert [each.name for each in told] == ["calibrating"] * 3 + ["settling"] * 2
    assert own.seconds().keys() == {"starting", "calibrating", "settling"}


def test_counted_goes_through_all_parts_and_tells_of_each():
    told = []
    with Account(told.append):
        assert list(counted("parts", "abc", 3)) == ["a", "b", "c"]
    assert [each.done for each in told] == [0, 1, 2, 3, 3]
    assert list(counted("parts", "abc", 3)) == ["a", "b", "c"]


def test_parts_that_were_not_foreseen_are_counted_in():
    told = []
    with Account(told.append), phase("compiling", 1) as done:
        done(1)
        done(2)
    assert [(each.done, each.total) for each in told] == [(0, 1), (1, 1), (2, 2), (2, 2)]


def test_a_phase_that_fails_is_named_and_not_complete():
    told = []
    with Account(told.append) as own:
        with pytest.raises(KeyboardInterrupt):
            _interrupted()
        assert own.failed == "inner"
    assert (told[-2].name, told[-2].done, told[-2].ended) == ("inner", 2, True)


def _interrupted():
    with phase("outer"), phase("inner", 5) as done:
        done(2)
        raise KeyboardInterrupt


def test_without_an_account_nothing_is_told():
    with phase("work", 3) as done:
        done(1)
    assert account() is None


def test_work_of_other_threads_belongs_to_the_account_that_they_name():
    with Account() as own:
        opened = own.open("elsewhere")
        thread = threading.Thread(target=lambda: (time.sleep(0.03), own.close(opened)))
        thread.start()
        thread.join()
        assert own.spent("elsewhere") >= 0.03
        assert sum(own.seconds().values()) == pytest.approx(own.elapsed, abs=0.02)


def test_time_left_goes_on_as_it_went():
    assert time_left(0, 0, 10, 5.0) is None
    assert time_left(0, 2, 10, 5.0) == 20.0
    assert time_left(6, 8, 10, 5.0) == 5.0  # what was done before does not count


def test_what_a_silent_phase_tells_of_the_time_left_can_be_asked():
    with Account() as timed:
        assert timed.left("simulating") is None
        with phase("simulating", silent=True) as done:
            assert timed.left("simulating") is None
            done(1, 4.5)
            with phase("simulating", silent=True):
                assert timed.left("simulating") == 4.5
        assert timed.left("simulating") is None
