"""Poses of guided feathers from their turns (featherfx/shot/detail/guided.py)."""

from math import cos, sin, sqrt

from featherfx.jit.compiled import kernel


@kernel
def turned(vector, piece, out):
    """A piece (3,) turned by a rotation vector (3,), to out (3,)."""
    x, y, z = vector[0], vector[1], vector[2]
    square = x * x + y * y + z * z
    if square < 1e-8:
        sine, versine = 1.0 - square / 6.0, 0.5 - square / 24.0
    else:
        angle = sqrt(square)
        sine, versine = sin(angle) / angle, (1.0 - cos(angle)) / square
    a, b, c = piece[0], piece[1], piece[2]
    p, q, r = y * c - z * b, z * a - x * c, x * b - y * a
    out[0] = a + sine * p + versine * (y * r - z * q)
    out[1] = b + sine * q + versine * (z * p - x * r)
    out[2] = c + sine * r + versine * (x * q - y * p)


@kernel
def add_applied(frame, vector, start, out):
    """start + frame vector, to out (3,). frame: (3, 3)."""
    for k in range(3):
        total = start[k]
        for c in range(3):
            total += frame[k, c] * vector[c]
        out[k] = total


@kernel
def chains(along, barbs, origin, steps, chords, segments, frame, piece, points):
    """Material points of all feathers, in their root frames.

    along: (F, n - 1, 6), barbs: (F, 2, n, m, 3) turns. origin: (F, 3), steps: (F, n - 1, 3, 3),
    chords: (F, n - 1, 3), segments: (F, 2, n, m, 3) at rest. frame: (2, 3, 3) and piece: (3, 3) are
    scratch. Written: points (F, n, 3 + 2 m, 3).
    """
    rows, columns = barbs.shape[2], barbs.shape[3]
    for f in range(points.shape[0]):
        now, after = frame[0], frame[1]
        for k in range(3):
            points[f, 0, 0, k] = origin[f, k]
            for c in range(3):
                now[k, c] = 1.0 if k == c else 0.0
        for i in range(rows):
            at = points[f, i]
            for k in range(3):
                at[1, k], at[2, k] = now[k, 1], now[k, 2]
            for side in range(2):
                start = at[0]
                for j in range(columns):
                    turned(barbs[f, side, i, j], segments[f, side, i, j], piece[0])
                    add_applied(now, piece[0], start, at[3 + side * columns + j])
                    start = at[3 + side * columns + j]
            if i == rows - 1:
                break
            turned(along[f, i, 3:], chords[f, i], piece[0])
            add_applied(now, piece[0], at[0], points[f, i + 1, 0])
            # columns of the next frame: A K exp(k) e_c
            for c in range(3):
                for k in range(3):
                    piece[0, k] = 1.0 if k == c else 0.0
                    piece[2, k] = 0.0
                turned(along[f, i, :3], piece[0], piece[1])
                add_applied(steps[f, i], piece[1], piece[2], piece[0])
                add_applied(now, piece[0], piece[2], piece[1])
                for k in range(3):
                    after[k, c] = piece[1, k]
            now, after = after, now
