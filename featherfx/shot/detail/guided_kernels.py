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
def mirror(nodes, directors):
    """Mirror one feather (guided.py), in place: nodes (n, 1 + 2 m, 3), directors (n, 2, 3)."""
    for i in range(nodes.shape[0]):
        for j in range(nodes.shape[1]):
            nodes[i, j, 1] = -nodes[i, j, 1]
        for k in range(0, 3, 2):
            directors[i, 0, k] = -directors[i, 0, k]
        directors[i, 1, 1] = -directors[i, 1, 1]


@kernel
def chains(turns, rest, mirrored, scratch, points):
    """Nodes and directors of all feathers, in their root frames.

    turns: Turns, rest: FeatherPieces, of F feathers at rest. mirrored: (F,). scratch: (3, 3, 3).
    Written: points (RowPoints).
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
        if mirrored[f]:
            mirror(nodes[f], directors[f])


@kernel
def in_world(posed, step, shifted, roots, world):
    """Vectors of F feathers in the world, with their first and second rates.

    posed: three (F, K, 3) in root frames that move: now, and step (s) later and earlier. shifted:
    1 for places, 0 for directions. roots: three pairs of positions (F, 3) and rotations (F, 3, 3),
    now and their rates. Written: world, three (F, K, 3).

    With x = p + R y:  x' = p' + R' y + R y',  x'' = p'' + R'' y + 2 R' y' + R y''.
    """
    now, after, before = posed
    (p, turn), (p1, turn1), (p2, turn2) = roots
    points, rates, seconds = world
    for f in range(now.shape[0]):
        r, r1, r2 = turn[f], turn1[f], turn2[f]
        for k in range(now.shape[1]):
            a, b, c = now[f, k, 0], now[f, k, 1], now[f, k, 2]
            later, earlier = after[f, k], before[f, k]
            u = (later[0] - earlier[0]) / (2.0 * step)
            v = (later[1] - earlier[1]) / (2.0 * step)
            w = (later[2] - earlier[2]) / (2.0 * step)
            x = (later[0] - 2.0 * a + earlier[0]) / (step * step)
            y = (later[1] - 2.0 * b + earlier[1]) / (step * step)
            z = (later[2] - 2.0 * c + earlier[2]) / (step * step)
            for i in range(3):
                points[f, k, i] = shifted * p[f, i] + r[i, 0] * a + r[i, 1] * b + r[i, 2] * c
                rates[f, k, i] = (
                    shifted * p1[f, i]
                    + (r1[i, 0] * a + r1[i, 1] * b + r1[i, 2] * c)
                    + (r[i, 0] * u + r[i, 1] * v + r[i, 2] * w)
                )
                seconds[f, k, i] = (
                    shifted * p2[f, i]
                    + (r2[i, 0] * a + r2[i, 1] * b + r2[i, 2] * c)
                    + 2.0 * (r1[i, 0] * u + r1[i, 1] * v + r1[i, 2] * w)
                    + (r[i, 0] * x + r[i, 1] * y + r[i, 2] * z)
                )
