"""Barbs within a vane, in its own coordinates: strips of any width carry all the real ones.

A place is (b, s), b counts barbs along the shaft and s is the place on the barb. Barb k covers

    |b - k - 1/2| <= w((e_k - s) / f) / 2,    w(r) = r (3 - r) / 2 up to r = 1, then 1

where f is the part of the barb over which its end is free, and e_k its uneven end. At some
boundaries, drawn at random, the vane has come apart from its edge inwards. What is between barbs
is open, so that an edge is as soft as its barbs are fine; barbs that hook nowhere (f above _LOOSE)
have barbules there, lines across that grow thin away from their barb. Barbs lean a little, near
ones together, which makes the streaks of a vane's gloss. How much of each is chosen by eye.

Marks of feathers run across it while its barbs are oblique (featherfx/feather/colours.py). Between
two rows of barbs a colour is therefore that of the same distance along the rachis, on the columns
of points on either side of it: bars have straight borders however few the barbs of a mesh are.
"""

from __future__ import annotations

from featherfx.jit.compiled import kernel

_UNEVEN = 0.6  # of the free end, by which barbs differ at most
_SPLITS, _DEEP, _WIDE = 0.007, 0.55, 0.9  # share of boundaries, of the barb, half width in barbs
_LOOSE, _BARBULES, _DENSE = 0.5, 90.0, 0.8  # number on a barb, share of its length that they cover


@kernel
def mixed_bits(value):
    """A hash of an integer (Wellons' lowbias32)."""
    value = (value ^ (value >> 16)) * 0x7FEB352D & 0xFFFFFFFF
    value = (value ^ (value >> 15)) * 0x846CA68B & 0xFFFFFFFF
    return value ^ (value >> 16)


@kernel
def chance(number):
    """A number in 0..1 of an integer's own."""
    return mixed_bits(number) * 2.3283064365386963e-10


@kernel
def barb_there(barbs, corners, u, v):
    """(b, s, roundness, f) of a place in a triangle. barbs: (V, 5)."""
    first, second, third = barbs[corners[0]], barbs[corners[1]], barbs[corners[2]]
    number = first[0] + u * (second[0] - first[0]) + v * (third[0] - first[0])
    place = first[1] + u * (second[1] - first[1]) + v * (third[1] - first[1])
    free = first[3] + u * (second[3] - first[3]) + v * (third[3] - first[3])
    return number, place, first[2], free


@kernel
def streak(number, place):
    """-1..1, how barbs at (b, s) lean together: alike over some of them and most of their
    length."""
    total = 0.0
    for barbs in (4.0, 15.0):
        at = number / barbs + 0.6 * place
        cell = int(at)
        part = at - cell
        part = part * part * (3.0 - 2.0 * part)
        low, high = chance(2 * cell + int(barbs)), chance(2 * cell + 2 + int(barbs))
        total += low + part * (high - low) - 0.5
    return total


@kernel
def half_width(number, place, free):
    """Half width of the barb at (b, s), in barbs; negative beyond its end."""
    left = (1.0 - _UNEVEN * free * chance(int(number)) - place) / free
    return 0.5 if left >= 1.0 else 0.25 * left * (3.0 - left)


@kernel
def _is_barbule(number, place, half):
    """Check that (b, s), beside a loose barb of a half width, is on one of its barbules."""
    own = int(number)
    off = number - own - 0.5
    across = _BARBULES * place + chance(2 * own + (1 if off > 0.0 else 0))
    far = (abs(off) - max(half, 0.0)) / (0.5 - max(half, 0.0))
    ending = 1.0 - place * place
    return abs(across - int(across) - 0.5) < 0.5 * _DENSE * ending * (1.0 - 0.7 * far)


@kernel
def is_gap(number, place, free):
    """Check that light passes at (b, s) between barbs."""
    own, half = int(number), half_width(number, place, free)
    if abs(number - own - 0.5) > half:
        return free < _LOOSE or not _is_barbule(number, place, half)
    for boundary in range(own, own + 2):
        drawn = chance(boundary + 7919) / _SPLITS
        if drawn < 1.0:
            deep = 0.1 + _DEEP * drawn
            if abs(number - boundary) < _WIDE * (place + deep - 1.0) / deep:
                return True
    return False


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
