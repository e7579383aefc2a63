"""Calls in another thread: in order, bounded, and no error is lost."""

import threading
import time
import weakref

import pytest

from featherfx.files.process import Background


def test_calls_come_in_order_and_all_are_done_at_the_end():
    seen = []
    with Background(lambda *given: seen.append(given)) as call:
        for k in range(50):
            call(k, -k)
    assert seen == [(k, -k) for k in range(50)]


def test_work_overlaps():
    """A call at work sees what its caller does only after handing it over."""
    later, seen = threading.Event(), []
    with Background(lambda _: seen.append(later.wait(5.0))) as call:
        call(0)
        later.set()
    assert seen == [True]


def test_the_caller_waits_when_too_much_waits_already():
    release, ahead = threading.Event(), []
    with Background(lambda _: release.wait(5.0), room=2) as call:

        def produce() -> None:
            for k in range(6):
                call(k)
                ahead.append(k)

        producer = threading.Thread(target=produce)
        producer.start()
        time.sleep(0.2)
        assert len(ahead) == 3  # one at work, two waiting
        release.set()
        producer.join(5.0)
    assert ahead == list(range(6))


def test_what_a_call_was_given_is_let_go_when_it_is_done():
    class Sample:
        pass

    sample = Sample()
    there = weakref.ref(sample)
    with Background(lambda _: None) as call:
        call(sample)
        del sample
        call.wait()
        assert there() is None


def test_an_error_reaches_the_caller_and_stops_the_work():
    seen = []

    def work(k):
        seen.append(k)
        if k == 3:
            raise OSError("full")

    def produce():
        with Background(work) as call:
            for k in range(100):
                call(k)

    with pytest.raises(OSError, match="full"):
        produce()
    assert seen == [0, 1, 2, 3]


def test_an_error_in_the_last_call_is_not_lost():
    def fail(_):
        raise OSError("full")

    with pytest.raises(OSError, match="full"), Background(fail) as call:
        call(1)


def test_an_error_of_the_caller_loses_nothing_that_waits():
    seen, release = [], threading.Event()

    def work(k):
        release.wait(5.0)
        seen.append(k)

    def produce():
        with Background(work, room=3) as call:
            for k in range(4):
                call(k)
            threading.Timer(0.1, release.set).start()
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        produce()
    assert seen == [0, 1, 2, 3]
