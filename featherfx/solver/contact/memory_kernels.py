"""Data of the contacts of one search that the next one needs."""

from featherfx.jit.compiled import kernel


@kernel
def remember(touch, count, order, goes_on, key, force, side, wall):
    """Write what the next search needs of contacts (ContactSearch.remembered); returns how many of
    bodies are kept.

    order: (N,) of Candidates. goes_on: whether an interval goes on, so that only forces tell sides.
    Written: key, force and side of those kept, and wall, as of ContactMemory.
    """
    rows, columns = wall.shape[1], wall.shape[2]
    kept = 0
    for at in range(count):
        contact = touch[at]
        if contact.host < 0:
            wall[contact.guest, contact.row, contact.column] = contact.guest_force
            continue
        held = contact.guest_force > 0.0 or contact.host_force > 0.0
        if not goes_on:
            # what is deep belongs on its side, whether it is pressed or not
            deep = contact.gap < contact.spared
            held = held or deep or contact.side != order[contact.pair]
        if held:
            key[kept] = (contact.pair * rows + contact.row) * columns + contact.column
            force[kept, 0], force[kept, 1] = contact.guest_force, contact.host_force
            side[kept] = contact.side
            kept += 1
    return kept
