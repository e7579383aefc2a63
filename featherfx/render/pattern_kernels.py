"""Colours of a vane between the points that have some, along lines straight across the feather.

Marks of feathers run across it while its barbs are oblique (featherfx/feather/colours.py). Between
two rows of barbs a colour is therefore that of the same distance a along the shaft, on the columns
of points on either side of it, not that of the same share of the way between the rows: bars have
straight borders however few the barbs of a mesh are.
"""

from __future__ import annotations

from featherfx.jit.compiled import kernel


@kernel
def _on_column(ahead, colours, column, distance, colour, weight):
    """Add to `colour` (3,) that of a column at a distance, by its weight."""
    low, high = 0, ahead.shape[0] - 1
    while high - low > 1:
        middle = (low + high) // 2
        if ahead[middle, column] <= distance:
            low = middle
        else:
            high = middle
    apart = ahead[high, column] - ahead[low, column]
    part = (distance - ahead[low, column]) / apart if apart > 0.0 else 0.5
    part = min(max(part, 0.0), 1.0)
    for k in range(3):
        below, above = colours[low, column, k], colours[high, column, k]
        colour[k] += weight * (below + part * (above - below))


@kernel
def colour_vanes(ahead, colours, distances, columns, shades):
    """Fill shades (n, B, S, 3) of n vanes.

    ahead: (n, R, C) distances of points along the shaft, ascending. colours: (n, R, C, 3).
    distances: (n, B, S) of what is coloured. columns: (S,) place among those of points, 0 to C - 1.
    """
    for index in range(len(shades)):
        for barb in range(shades.shape[1]):
            for station in range(shades.shape[2]):
                column = min(int(columns[station]), ahead.shape[2] - 2)
                part, colour = columns[station] - column, shades[index, barb, station]
                distance = distances[index, barb, station]
                for side in range(2):
                    weight = part if side == 1 else 1.0 - part
                    _on_column(
                        ahead[index], colours[index], column + side, distance, colour, weight
                    )
