"""Poses of guided feathers from their turns (featherfx/shot/detail/guided.py)."""

from math import cos, sin, sqrt

from featherfx.jit.compiled import kernel


@kernel
def turned(vector, piece):
    """A piece (3,) turned by a rotation vector (3,)."""
    x, y, z = vector[0], vector[1], vector[2]
    square = x * x + y * y + z * z
    if square < 1e-8:
        sine, versine = 1.0 - square / 6.0, 0.5 - square / 24.0
    else:
        angle = sqrt(square)
        sine, versine = sin(angle) / angle, (1.0 - cos(angle)) / square
    a, b, c = piece[0], piece[1], piece[2]
    p, q, r = y * c - z * b, z * a - x * c, x * b - y * a
    return (
        a + sine * p + versine * (y * r - z * q),
        b + sine * q + versine * (z * p - x * r),
        c + sine * r + versine * (x * q - y * p),
    )


@kernel
def add_applied(frame, vector, start, out):
    """start + frame vector, to out (3,). frame: (3, 3)."""
    for k in range(3):
        out[k] = (
            start[k] + frame[k, 0] * vector[0] + frame[k, 1] * vector[1] + frame[k, 2] * vector[2]
        )


@kernel
def chains(turns, rest, scratch, points):
    """Nodes and directors of all feathers, in their root frames.

    turns: Turns, and rest: Pieces at rest, of F feathers. scratch: (3, 3, 3). Written: points
    (RowPoints).
    """
    rows, columns = turns.barbs.shape[2], turns.barbs.shape[3]
    step, none = scratch[2, 0], (0.0, 0.0, 0.0)
    nodes, directors = points.nodes, points.directors
    for f in range(nodes.shape[0]):
        now, after = scratch[0], scratch[1]
        for k in range(3):
            nodes[f, 0, 0, k] = rest.origins[f, k]
            for c in range(3):
                now[k, c] = 1.0 if k == c else 0.0
        for i in range(rows):
            at = nodes[f, i]
            for k in range(3):
                directors[f, i, 0, k], directors[f, i, 1, k] = now[k, 1], now[k, 2]
            for side in range(2):
                start = at[0]
                for j in range(columns):
                    piece = turned(turns.barbs[f, side, i, j], rest.segments[f, side, i, j])
                    end = at[1 + side * columns + j]
                    add_applied(now, piece, start, end)
                    start = end
            if i == rows - 1:
                break
            chord = turned(turns.along[f, i, 3:], rest.chords[f, i])
            add_applied(now, chord, at[0], nodes[f, i + 1, 0])
            # columns of the next frame: A K exp(k) e_c
            for c in range(3):
                unit = (1.0 if c == 0 else 0.0, 1.0 if c == 1 else 0.0, 1.0 if c == 2 else 0.0)
                add_applied(rest.steps[f, i], turned(turns.along[f, i, :3], unit), none, step)
                add_applied(now, step, none, after[:, c])
            now, after = after, now
