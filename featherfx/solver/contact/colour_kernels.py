"""Bodies in colours, so that no two of a colour touch."""

from __future__ import annotations

import numpy as np

from featherfx.jit.compiled import kernel
from featherfx.solver.contact.types import Indices


def coloured(pairs: Indices, bodies: int) -> Indices:
    """(bodies,) the colour of each, from 0 on: the first that none before it has which it touches.

    pairs: (N, 2) bodies that touch.
    """
    both = np.concatenate([pairs, pairs[:, ::-1]])
    both = both[np.argsort(both[:, 0], kind="stable")]
    first = np.searchsorted(both[:, 0], np.arange(bodies + 1))
    colour = np.zeros(bodies, dtype=np.int64)
    _colour(first, np.ascontiguousarray(both[:, 1]), np.full(bodies + 1, -1), colour)
    return colour


@kernel
def _colour(first, near, taken_by, colour):
    """Colours of bodies whose neighbours are near[first[b]] to near[first[b + 1] - 1], to colour.

    taken_by: (B + 1,) -1, of each colour the last body that it was taken for.
    """
    for body in range(colour.shape[0]):
        for at in range(first[body], first[body + 1]):
            if near[at] < body:
                taken_by[colour[near[at]]] = body
        while taken_by[colour[body]] == body:
            colour[body] += 1
