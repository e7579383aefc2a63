"""Memory for the states of some batches, and views of it.

To tell where every array of a state lies takes Python longer than feathers of a small shot take to
solve, so only what differs from one room to the next is asked for.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from featherfx.algebra.types import Array, Flags
from featherfx.algebra.views import Views, views_of
from featherfx.solver.state import State


class StateBuffer(NamedTuple):
    """States of all batches, views of them and of their rows of numbers, one for each feather."""

    states: list[State]
    views: Views
    rows: Views


class StateBuffers:
    """Makes room for states that are like some, one per batch. before: a room to be written over
    again and again."""

    def __init__(self, like: Sequence[State]) -> None:
        arrays = [list(state.arrays().items()) for state in like]
        self._forms = [[(name, each.shape, each.dtype) for name, each in some] for some in arrays]
        self._whole = views_of(like).views
        self._rows = views_of([_rows(state) for state in like]).views
        # a view has the address of each array, and behind it its shape and strides
        self._at_whole = _addresses([each.ndim for _, each in arrays[0]])
        self._at_rows = _addresses([2 for _ in arrays[0]])
        self.before = self.made(np.zeros)

    def made(self, new: Callable[..., Any]) -> StateBuffer:
        """A room of arrays as np.empty or np.zeros makes them."""
        states = [
            State.from_arrays({name: new(shape, dtype) for name, shape, dtype in forms})
            for forms in self._forms
        ]
        addresses = [[each.ctypes.data for each in state.arrays().values()] for state in states]
        whole, rows = self._whole.words.copy(), self._rows.words.copy()
        whole[:, self._at_whole] = rows[:, self._at_rows] = addresses
        return StateBuffer(
            states, self._whole._replace(words=whole), self._rows._replace(words=rows)
        )


def put(given: State, state: State, some: Flags) -> None:
    """Copy some feathers (F,) of a state into another, in place."""
    whole, arrays = bool(some.all()), given.arrays()
    for name, array in state.arrays().items():
        if whole:
            array[...] = arrays[name]
        else:
            array[some] = arrays[name][some]


def _addresses(dimensions: Sequence[int]) -> NDArray[np.int64]:
    return np.cumsum([0, *(1 + 2 * each for each in dimensions[:-1])])


def _rows(state: State) -> tuple[Array, ...]:
    """All arrays of a state, a row of numbers per feather."""
    return tuple(array.reshape(len(array), -1) for array in state.arrays().values())
