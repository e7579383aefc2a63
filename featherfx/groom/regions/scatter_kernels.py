"""One pass of dart throwing: candidates in their order, each accepted unless one is too near.

All arithmetic is of integers, so that every machine accepts the same candidates.
positions: (N, 3) lattice units. normals: (N, 3). accepted: (N,) whether earlier passes took it.
heads: (H,) first candidate of each cell's chain, H a power of two; links: (N,) the next ones.
"""

from __future__ import annotations

from featherfx.algebra.vector_kernels import dot, sub
from featherfx.jit.compiled import kernel


@kernel
def cell_of(x, y, z, mask):
    """Slot of a cell of the lattice of cells; different cells may share one."""
    return ((x * 73856093) ^ (y * 19349663) ^ (z * 83492791)) & mask


@kernel
def insert(candidate, positions, cell, heads, links):
    """Put an accepted candidate into its cell's chain."""
    slot = cell_of(
        positions[candidate, 0] // cell,
        positions[candidate, 1] // cell,
        positions[candidate, 2] // cell,
        heads.shape[0] - 1,
    )
    links[candidate] = heads[slot]
    heads[slot] = candidate


@kernel
def has_room(candidate, positions, normals, cell, heads, links):
    """Return True if no accepted candidate on this side of the skin lies within one cell's size."""
    place, normal = positions[candidate], normals[candidate]
    cx, cy, cz = place[0] // cell, place[1] // cell, place[2] // cell
    for i in range(cx - 1, cx + 2):
        for j in range(cy - 1, cy + 2):
            for k in range(cz - 1, cz + 2):
                other = heads[cell_of(i, j, k, heads.shape[0] - 1)]
                while other >= 0:
                    away = sub(positions[other], place)
                    if dot(away, away) < cell * cell and dot(normals[other], normal) > 0:
                        return False
                    other = links[other]
    return True


@kernel
def throw_darts(positions, normals, accepted, cell, heads, links, taken):
    """Accept what has room among all candidates; their numbers go to taken; returns how many.

    cell: least distance of two accepted ones, lattice units.
    """
    heads[:] = -1
    for candidate in range(positions.shape[0]):
        if accepted[candidate]:
            insert(candidate, positions, cell, heads, links)
    count = 0
    for candidate in range(positions.shape[0]):
        if accepted[candidate]:
            continue
        if has_room(candidate, positions, normals, cell, heads, links):
            accepted[candidate] = True
            insert(candidate, positions, cell, heads, links)
            taken[count] = candidate
            count += 1
    return count
