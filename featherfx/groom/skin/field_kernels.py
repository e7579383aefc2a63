"""Kernels of the rotations of roots with the triangles around them (field.py)."""

from math import sqrt

from featherfx.jit.compiled import kernel

# of Newton's iteration for the rotation of a matrix: steps at most, change at which it has ended,
# and least determinant over the cube of the matrix's size, below which it is not tried
_MAX_POLAR_STEPS, _POLAR_TOLERANCE, _MIN_DETERMINANT_RATIO = 40, 1e-15, 1e-9


@kernel
def gradients(corners, side, inverse, out):
    """Deformation gradients (U, 9) of triangles with corners (U, 3, 3): their sides and unit
    normal, times side, times inverse (U, 3, 3)."""
    for u in range(corners.shape[0]):
        a, b, c = corners[u, 0], corners[u, 1], corners[u, 2]
        x, y, z = b[0] - a[0], b[1] - a[1], b[2] - a[2]
        p, q, r = c[0] - a[0], c[1] - a[1], c[2] - a[2]
        k, m, n = y * r - z * q, z * p - x * r, x * q - y * p
        size = sqrt(k * k + m * m + n * n)
        scale = side / size if size > 0.0 else side
        k, m, n = k * scale, m * scale, n * scale
        own = inverse[u]
        for j in range(3):
            out[u, j] = x * own[0, j] + p * own[1, j] + k * own[2, j]
            out[u, 3 + j] = y * own[0, j] + q * own[1, j] + m * own[2, j]
            out[u, 6 + j] = z * own[0, j] + r * own[1, j] + n * own[2, j]


@kernel
def means(values, starts, places, weights, out):
    """Weighted sums (F, 9) of values (U, 9) at the places from starts[f] to the next start."""
    count, end = starts.shape[0], places.shape[0]
    for f in range(count):
        for j in range(9):
            out[f, j] = 0.0
        for k in range(starts[f], starts[f + 1] if f + 1 < count else end):
            weight, u = weights[k], places[k]
            for j in range(9):
                out[f, j] += weight * values[u, j]


@kernel
def rotations(matrices, scratch, out):
    """Proper rotations (F, 9) nearest to matrices (F, 9), by Newton's iteration (Higham 1986); how
    many were not found, whose first number is then nan. scratch: (9,)."""
    missing = 0
    for f in range(matrices.shape[0]):
        now, inverse = out[f], scratch
        size = 0.0
        for j in range(9):
            now[j] = matrices[f, j]
            size += now[j] * now[j]
        size = sqrt(size)
        found = False
        for _ in range(_MAX_POLAR_STEPS):
            # cofactors, which over the determinant are the inverse's transpose
            inverse[0] = now[4] * now[8] - now[5] * now[7]
            inverse[1] = now[5] * now[6] - now[3] * now[8]
            inverse[2] = now[3] * now[7] - now[4] * now[6]
            inverse[3] = now[2] * now[7] - now[1] * now[8]
            inverse[4] = now[0] * now[8] - now[2] * now[6]
            inverse[5] = now[1] * now[6] - now[0] * now[7]
            inverse[6] = now[1] * now[5] - now[2] * now[4]
            inverse[7] = now[2] * now[3] - now[0] * now[5]
            inverse[8] = now[0] * now[4] - now[1] * now[3]
            det = now[0] * inverse[0] + now[1] * inverse[1] + now[2] * inverse[2]
            if not det > _MIN_DETERMINANT_RATIO * size * size * size:
                break
            own, other = 0.0, 0.0
            for j in range(9):
                inverse[j] /= det
                own += now[j] * now[j]
                other += inverse[j] * inverse[j]
            scale = sqrt(sqrt(other / own))
            change = 0.0
            for j in range(9):
                after = 0.5 * (scale * now[j] + inverse[j] / scale)
                change += (after - now[j]) * (after - now[j])
                now[j] = after
            size = sqrt(3.0)
            # it converges quadratically, so that what is left is the square of the last change
            if change <= _POLAR_TOLERANCE:
                found = True
                break
        if not found:
            now[0] = float("nan")
            missing += 1
    return missing


@kernel
def has_flat(corners, thinnest):
    """Return True if any of triangles (U, 3, 3) is flat or not finite.

    thinnest: least height of a triangle over its longest side."""
    for u in range(corners.shape[0]):
        doubled, longest = _measure(corners[u])
        # a little more than asked for, so that none is missed by round-off
        if not doubled > 1.01 * thinnest * longest:
            return True
    return False


@kernel
def fill_sound(corners, rest, thinnest, crushed, sound):
    """Return whether all triangles (U, 3, 3) m have an area as at rest (U, 3, 3). Written: sound
    (U,), 1 of those, falling smoothly to 0 from a part (crushed) of their area at rest on, and
    where they are as flat as has_flat says."""
    all_sound = True
    for u in range(corners.shape[0]):
        doubled, longest = _measure(corners[u])
        then, _ = _measure(rest[u])
        sound[u] = 0.0
        if doubled > thinnest * longest:
            part = min(doubled / (crushed * then), 1.0) if then > 0.0 else 1.0
            sound[u] = part * part * (3.0 - 2.0 * part)
        all_sound = all_sound and sound[u] == 1.0
    return all_sound


@kernel
def _measure(corners):
    """Twice the area of a triangle (3, 3) m, m^2, and its longest side squared."""
    a, b, c = corners[0], corners[1], corners[2]
    x, y, z = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    p, q, r = c[0] - a[0], c[1] - a[1], c[2] - a[2]
    k, m, n = y * r - z * q, z * p - x * r, x * q - y * p
    last = (p - x) ** 2 + (q - y) ** 2 + (r - z) ** 2
    longest = max(x * x + y * y + z * z, p * p + q * q + r * r, last)
    return sqrt(k * k + m * m + n * n), longest


@kernel
def find_hanging(start, start_corners, root, corners, reached, hanging):
    """Mark triangles (N,) around roots that hang together with those (M,) at them.

    start: (M,) and root: (N,) of each, ascending. start_corners: (M, 3) and corners: (N, 3), their
    vertices. reached: (V,) last root from which each vertex was, -1. hanging: (N,) False.
    """
    s, low = 0, 0
    while low < root.shape[0]:
        own, high = root[low], low
        while high < root.shape[0] and root[high] == own:
            high += 1
        while s < start.shape[0] and start[s] <= own:
            for k in range(3):
                reached[start_corners[s, k]] = start[s]
            s += 1
        moved = True
        while moved:
            moved = False
            for n in range(low, high):
                c = corners[n]
                if not hanging[n] and own in (reached[c[0]], reached[c[1]], reached[c[2]]):
                    hanging[n] = moved = True
                    for k in range(3):
                        reached[c[k]] = own
        low = high
