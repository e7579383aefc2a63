"""Batches of any shape in one compiled function, and threads that work together in it."""

from __future__ import annotations

from threading import Thread
from typing import NamedTuple

import numpy as np
import pytest

from featherfx.algebra.views import (
    forget_tickets,
    meet,
    new_team,
    say_done,
    ticket,
    viewed,
    views_of,
    wait_for,
)
from featherfx.jit.compiled import kernel


class Inner(NamedTuple):
    sums: np.ndarray


class Batch(NamedTuple):
    values: np.ndarray
    used: np.ndarray
    inner: Inner


@kernel
def sum_up(views):
    for line in range(views.words.shape[0]):
        batch = viewed(views, line)
        for i in range(batch.values.shape[0]):
            for j in range(batch.values.shape[1]):
                for k in range(batch.values.shape[2]):
                    if batch.used[j]:
                        batch.inner.sums[i] += batch.values[i, j, k]


def test_a_kernel_reaches_batches_of_many_shapes():
    rng = np.random.default_rng(3)
    shapes = (2, 3, 4), (5, 1, 2), (1, 6, 0)
    batches = [
        Batch(rng.normal(size=shape), rng.random(shape[1]) < 0.7, Inner(np.zeros(shape[0])))
        for shape in shapes
    ]
    sum_up(views_of(batches).views)
    for batch in batches:
        expected = (batch.values * batch.used[None, :, None]).sum(axis=(1, 2))
        assert np.allclose(batch.inner.sums, expected, rtol=1e-14)


def test_views_copy_what_is_not_contiguous():
    values = np.arange(24.0).reshape(4, 3, 2).transpose(2, 1, 0)
    held = views_of([Batch(values, np.ones(3, dtype=bool), Inner(np.zeros(2)))])
    sum_up(held.views)
    assert np.array_equal(held.tuples[0].inner.sums, values.sum(axis=(1, 2)))


@kernel
def rounds(team, size, times, done, wrong):
    """Each round counts up all places of `done`; before the next, all must have been counted."""
    kind = 0
    for number in range(times):
        while True:
            at = ticket(team, kind)
            if at >= done.shape[0]:
                break
            for other in range(done.shape[0]):
                if done[other] < number:
                    wrong[0] += 1
            done[at] += 1
        meet(team, size)
        kind = 1 - kind
        forget_tickets(team, 1 - kind)
        meet(team, size)


@pytest.mark.parametrize("size", [1, 2, 5])
def test_a_team_shares_the_work_and_waits_for_all(size):
    team, done, wrong = new_team(2), np.zeros(40, dtype=np.int64), np.zeros(1, dtype=np.int64)
    threads = [Thread(target=rounds, args=(team, size, 60, done, wrong)) for _ in range(size)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert (done == 60).all()
    assert wrong[0] == 0


@kernel
def one_by_one(team, values, done):
    """Each place of `values` is the sum of all before it, and one more."""
    while True:
        at = ticket(team, 0)
        if at >= values.shape[0]:
            return
        total = 1
        for other in range(at):
            wait_for(done, other, 1)
            total += values[other]
        values[at] = total
        say_done(done, at)


def test_a_thread_waits_for_the_parts_that_it_needs():
    team, values, done = new_team(1), np.zeros(40, dtype=np.int64), np.zeros(40, dtype=np.int64)
    threads = [Thread(target=one_by_one, args=(team, values, done)) for _ in range(3)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert values.tolist() == [2**k for k in range(40)]
