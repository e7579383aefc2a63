"""What a search tells the next one of its contacts."""

from __future__ import annotations

import numpy as np

from featherfx.solver.contact.search import ContactSearch, new_touch
from featherfx.solver.contact.types import ContactMemory

WALL = (3, 4, 5)  # bodies, rows, columns


def test_what_is_pressed_is_deep_or_is_on_another_side_is_remembered():
    touch = new_touch(7)
    touch["pair"] = [0, 1, 2, 3, 4, -1, 5]
    touch["row"], touch["column"] = [0, 1, 2, 3, 0, 2, 0], [1, 2, 3, 4, 0, 3, 0]
    touch["guest"], touch["host"] = 1, [0, 0, 0, 2, 2, -1, 2]
    touch["guest_force"], touch["host_force"] = [2, 0, 0, 0, 0, 7, 9], [0, 3, 0, 0, 0, 0, 0]
    touch["gap"], touch["spared"] = [1, 1, -1, 1, 1, 1, 1], 0.0
    touch["side"] = [1, -1, 1, 1, -1, 0, 1]
    order = np.array([1, -1, 1, -1, -1, 1])
    found = ContactSearch(touch, 6)  # the last is of an earlier search
    memory = ContactMemory(
        *(np.zeros(0),) * 3, np.ones(WALL), np.zeros(WALL, dtype=np.int8), np.zeros(3)
    )
    known = found.remembered(order, memory)
    rows, columns = WALL[1:]
    place = [(0, 0, 1), (1, 1, 2), (2, 2, 3), (3, 3, 4)]
    assert known.key.tolist() == [(p * rows + r) * columns + c for p, r, c in place]
    assert known.force.tolist() == [[2, 0], [0, 3], [0, 0], [0, 0]]
    assert known.side.tolist() == [1, -1, 1, 1]
    assert known.wall.sum() == known.wall[1, 2, 3] == 7.0
    # of an interval that goes on only forces tell, and all else is as it was
    again = found.remembered(order, memory, start=known)
    assert again.key.tolist() == known.key.tolist()
    assert again.force.tolist() == known.force.tolist()
    early = known._replace(key=known.key[:0], force=known.force[:0], side=known.side[:0])
    assert found.remembered(order, memory, start=early).key.tolist() == known.key[:2].tolist()
