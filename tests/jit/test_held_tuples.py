"""Large tuples of arrays that kernels take by their address."""

from typing import Any, NamedTuple

import numpy as np
import pytest

from featherfx.jit.compiled import kernel, shared_kernel
from featherfx.jit.compiler import find_types
from featherfx.jit.kernel_types import MIN_POINTER_WORDS, StructPointer, count_words


class Alike(NamedTuple):
    first: Any
    second: Any


class Large(NamedTuple):
    """More words than are handed on field by field."""

    one: Any
    count: int
    pair: Alike
    rows: tuple[Any, Any]
    there: bool
    share: float


def alike(seed):
    values = np.random.default_rng(seed).uniform(size=(2, 2, 3, 1, 2, *4 * (1,)))
    return Alike(values[0], values[1])


def large(seed):
    numbers = np.random.default_rng(seed).uniform(size=(3, 4))
    return Large(
        numbers[:, 1:], 3, alike(seed), (numbers[0], np.arange(5) + seed), seed % 2 == 1, 0.5
    )


@shared_kernel(float)
def weighed(all_of, k):
    pair, rows = all_of.pair, all_of.rows
    total = all_of.one[k, 1] + all_of.count * all_of.share + rows[0][k] + rows[1][k]
    for side in range(2):
        part = pair.first if side == 0 else pair.second
        total += part.flat[k] - 2.0 * part[1].flat[k]
    return total + (100.0 if all_of.there else 0.0)


@kernel
def shifted(all_of, k):
    other = Large(all_of.one[1:], 7, all_of.pair, all_of.rows, not all_of.there, all_of.share)
    return weighed(all_of, k), weighed(other, k)


@kernel
def chosen(one, wanted):
    other = Large(one.one, 9, one.pair, one.rows, one.there, one.share)
    taken = other if wanted else one
    return taken.count * taken.share


@kernel
def fill(all_of):
    for i in range(all_of.one.shape[0]):
        for j in range(all_of.one.shape[1]):
            all_of.one[i, j] = 10.0 * i + j
    all_of.rows[1][2] = all_of.count


def test_large_tuples_are_pointers_and_nothing_else():
    kinds = find_types((large(0), alike(0), 1.0))
    assert [isinstance(each, StructPointer) for each in kinds] == [True, False, False]
    assert count_words(kinds[1]) < MIN_POINTER_WORDS <= count_words(kinds[0].like)


@pytest.mark.parametrize("seed", [1, 2])
def test_fields_of_struct_pointers_are_those_that_were_given(seed):
    given = large(seed)
    for k in range(2):
        other = given._replace(one=given.one[1:], count=7, there=not given.there)
        wanted = weighed.py_func(given, k), weighed.py_func(other, k)
        assert shifted(given, k) == pytest.approx(wanted, rel=1e-14)
    assert (chosen(given, False), chosen(given, True)) == (1.5, 4.5)


def test_arrays_of_struct_pointers_are_the_callers():
    given = large(4)
    fill(given)
    assert given.one.tolist() == [[0.0, 1.0, 2.0], [10.0, 11.0, 12.0], [20.0, 21.0, 22.0]]
    assert given.rows[1].tolist() == [4, 5, 3, 7, 8]
