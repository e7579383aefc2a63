"""Candidates on a skin where lines cross it, and one pass of dart throwing among them.

Lines run along the three axes, one through each cell of a lattice, at a place within the cell that
is a hash of the cell. Where they cross a skin depends on its shape, not on how its triangles cut
it. A dart is accepted unless one is too near, by arithmetic of integers, so that every machine
accepts the same ones.
positions: (N, 3) lattice units. normals: (N, 3). accepted: (N,) whether earlier passes took it.
heads: (H,) first candidate of each cell's chain, H a power of two; links: (N,) the next ones.
"""

from __future__ import annotations

import math

from featherfx.algebra.vector_kernels import dot, sub
from featherfx.jit.compiled import kernel


@kernel
def mixed(word):
    """Return 64 well-mixed bits of a word (the finaliser of splitmix64, Steele 2014)."""
    word = (word ^ ((word >> 30) & 0x3FFFFFFFF)) * -0x40A7B892E31B1A47
    word = (word ^ ((word >> 27) & 0x1FFFFFFFFF)) * -0x6B2FB644ECCEEE15
    return word ^ ((word >> 31) & 0x1FFFFFFFF)


@kernel
def cross_lines(corners, wanted, pitch, seed, marks, triangle, weights, line):
    """Find where lines that cross wanted triangles cross any; returns how many crossings there are.

    corners: (T, 3, 3). wanted: (T,). pitch: side of a cell. marks: (M,) False, M a power of two; of
    the lines so far, by their words. Of each crossing that has room in the arrays: triangle,
    weights (N, 2) of its second and third corner, and line: a word of which the last two bits are
    the axis. There may be lines besides, which cross no wanted triangle.
    """
    count, step = 0, 1.0 / pitch
    for number in range(2 * corners.shape[0]):
        first_time, number = number < corners.shape[0], number % corners.shape[0]
        if wanted[number] != first_time:
            continue
        for axis in range(3):
            b, c = (axis + 1) % 3, (axis + 2) % 3
            x0, y0 = corners[number, 0, b] * step, corners[number, 0, c] * step
            x1, y1 = corners[number, 1, b] * step, corners[number, 1, c] * step
            x2, y2 = corners[number, 2, b] * step, corners[number, 2, c] * step
            double = (x1 - x0) * (y2 - y0) - (x2 - x0) * (y1 - y0)
            if double == 0.0:
                continue
            first, last = math.floor(min(x0, x1, x2)), math.floor(max(x0, x1, x2))
            low, high = math.floor(min(y0, y1, y2)), math.floor(max(y0, y1, y2))
            for i in range(first, last + 1):
                for j in range(low, high + 1):
                    word = mixed(mixed(mixed(seed + axis) + i) + j)
                    mark = word & (marks.shape[0] - 1)
                    if not (first_time or marks[mark]):
                        continue
                    x = i + (word & 0x3FFFFFF) / 0x4000000 - x0
                    y = j + ((word >> 26) & 0x3FFFFFF) / 0x4000000 - y0
                    second = (x * (y2 - y0) - (x2 - x0) * y) / double
                    third = ((x1 - x0) * y - x * (y1 - y0)) / double
                    if second < 0.0 or third < 0.0 or second + third > 1.0:
                        continue
                    marks[mark] = True
                    if count < triangle.shape[0]:
                        triangle[count] = number
                        weights[count, 0], weights[count, 1] = second, third
                        line[count] = (word & -4) | axis
                    count += 1
    return count


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
