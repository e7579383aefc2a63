"""Distances that bodies went in an interval."""

from featherfx.jit.compiled import kernel


@kernel
def largest_moves(after, before, free, found):
    """(B,) m, how far any node of each body that is free (B,) is in one pose (B, n, 1 + 2 m, 3)
    from the other along an axis; no other has moved."""
    for body in range(after.shape[0]):
        found[body] = 0.0
        if not free[body]:
            continue
        for i in range(after.shape[1]):
            for p in range(after.shape[2]):
                for k in range(3):
                    way = abs(after[body, i, p, k] - before[body, i, p, k])
                    found[body] = max(found[body], way)
