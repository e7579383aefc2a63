"""Feathers on a skin that moves: feet of their nodes, and poses that are drawn over these.

A node x of a feather at rest has a foot with barycentric weights b on a triangle of the skin and a
height h above it along the interpolated normals of the skin's points:

    x = sum_k b_k (p_k + h n_k)

The same sum on the moved skin is the image of the node. Images are stretched as the skin is, so
they give directions only. The rachis runs along the polyline of its images in chords of its own
lengths, and every segment keeps its length and turns as its image does (draw_pose). Images of barbs
go along with the frame of their row to where the rachis comes to lie.
"""

from math import sqrt

from featherfx.algebra.vector_kernels import (
    accumulate,
    add,
    combined,
    cross,
    dot,
    length,
    scale,
    store,
    sub,
)
from featherfx.jit.compiled import kernel

# Newton iterations of a foot, and steps from triangle to triangle of the skin
_ITERATIONS, _MAX_STEPS = 4, 60
# a foot is in its triangle if no weight is below that
_OUTSIDE = -1e-6
# m^2, squared length below which a segment has no direction
_NO_LENGTH = 1e-24


@kernel
def average_normals(points, triangles, normals):
    """Unit normals (V, 3) of a skin's points (V, 3), weighted by area."""
    for v in range(points.shape[0]):
        store(normals[v], (0.0, 0.0, 0.0))
    for t in range(triangles.shape[0]):
        a, b, c = triangles[t, 0], triangles[t, 1], triangles[t, 2]
        product = cross(sub(points[b], points[a]), sub(points[c], points[a]))
        for k in range(3):
            accumulate(normals[triangles[t, k]], 1.0, product)
    for v in range(points.shape[0]):
        size = length(normals[v])
        if size > 0.0:
            store(normals[v], scale(1.0 / size, normals[v]))


@kernel
def _foot(x, points, normals, corners):
    """Weights of the second and third corner, and the height, of a point over a triangle."""
    a, b, c = points[corners[0]], points[corners[1]], points[corners[2]]
    na, nb, nc = normals[corners[0]], normals[corners[1]], normals[corners[2]]
    u, v, h = 1.0 / 3.0, 1.0 / 3.0, 0.0
    for _ in range(_ITERATIONS):
        along, aside = sub(b, a), sub(c, a)
        turn, lean = sub(nb, na), sub(nc, na)
        up = add(na, combined(u, turn, v, lean))
        away = sub(sub(x, a), add(combined(u, along, v, aside), scale(h, up)))
        first, second = add(along, scale(h, turn)), add(aside, scale(h, lean))
        volume = dot(cross(first, second), up)
        if abs(volume) < 1e-30:
            break
        u += dot(cross(away, second), up) / volume
        v += dot(cross(first, away), up) / volume
        h += dot(cross(first, second), away) / volume
    return u, v, h


@kernel
def _walk(x, skin, start):
    """Triangle, weights and height of a point's foot, walking from a triangle; the triangle is -1
    if there is none."""
    points, normals, triangles, beside = skin
    triangle, before = start, -1
    for _ in range(_MAX_STEPS):
        u, v, h = _foot(x, points, normals, triangles[triangle])
        w = 1.0 - u - v
        least = min(u, min(v, w))
        if least >= _OUTSIDE:
            return triangle, u, v, h
        k = 0 if least == w else (1 if least == u else 2)
        after = beside[triangle, k]
        if after < 0 or after == before:
            return triangle if least > -0.5 else -1, u, v, h
        before, triangle = triangle, after
    return -1, 0.0, 0.0, 0.0


@kernel
def find_feet(nodes, starts, skin, feet, found):
    """Feet of the nodes (F, n, 1 + 2 m, 3) m of feathers at rest, from triangles starts (F,).

    skin: points, normals (V, 3), triangles and triangles beside (T, 3). Written: feet (Feet) and
    found (F,), 1 where all nodes have one.
    """
    for f in range(nodes.shape[0]):
        near, found[f] = starts[f], 1
        for i in range(nodes.shape[1]):
            for j in range(nodes.shape[2]):
                m = (nodes.shape[2] - 1) // 2
                start = near if j in (0, 1, m + 1) else feet.triangle[f, i, j - 1]
                t, u, v, h = _walk(nodes[f, i, j], skin, start)
                if t < 0:
                    found[f], t = 0, near
                feet.triangle[f, i, j], feet.height[f, i, j] = t, h
                feet.weight[f, i, j, 0], feet.weight[f, i, j, 1] = u, v
                if j == 0:
                    near = t


@kernel
def _image(feet, f, i, j, points, normals, corners):
    """Image of a node on a skin, and the normal at its foot, not of unit length."""
    u, v, h = feet.weight[f, i, j, 0], feet.weight[f, i, j, 1], feet.height[f, i, j]
    w = 1.0 - u - v
    a, b, c = corners[0], corners[1], corners[2]
    up = add(combined(w, normals[a], u, normals[b]), scale(v, normals[c]))
    foot = add(combined(w, points[a], u, points[b]), scale(v, points[c]))
    return add(foot, scale(h, up)), up


@kernel
def draw_images(feet, f, skin, drawn):
    """Images of a feather's nodes on a skin, and the normals at the rachis. skin: points, normals
    and triangles. Written: drawn (DrawnRachis)."""
    points, normals, triangles = skin
    for i in range(drawn.image.shape[0]):
        for j in range(drawn.image.shape[1]):
            corners = triangles[feet.triangle[f, i, j]]
            at, up = _image(feet, f, i, j, points, normals, corners)
            store(drawn.image[i, j], at)
            if j == 0:
                store(drawn.up[i], up)


@kernel
def _step_length(start, way, at, size):
    """Part s of a way at which start + s way is `size` from a point; the larger of two."""
    away = sub(start, at)
    a, b, c = dot(way, way), dot(away, way), dot(away, away) - size * size
    square = b * b - a * c
    if a < _NO_LENGTH:
        return 1.0
    return (sqrt(max(square, 0.0)) - b) / a


@kernel
def draw_rachis(rest, drawn):
    """Rachis of a feather along the polyline of its images, in chords as long as at rest.

    rest: (n, 1 + 2 m, 3) m. Written: drawn.rachis (n, 3); drawn.row and drawn.part (n,), between
    which images each row is, and how far on.
    """
    rows, k = rest.shape[0], 0
    store(drawn.rachis[0], drawn.image[0, 0])
    drawn.row[0], drawn.part[0] = 0, 0.0
    for i in range(1, rows):
        at, size = drawn.rachis[i - 1], length(sub(rest[i, 0], rest[i - 1, 0]))
        while k < rows - 2 and length(sub(drawn.image[k + 1, 0], at)) < size:
            k += 1
        start = drawn.image[k, 0]
        way = sub(drawn.image[k + 1, 0], start)
        part = _step_length(start, way, at, size)
        store(drawn.rachis[i], add(start, scale(part, way)))
        drawn.row[i], drawn.part[i] = k, part


@kernel
def _frame(along, up):
    """Tangent, side and normal, unit vectors."""
    along = scale(1.0 / max(length(along), 1e-300), along)
    side = cross(up, along)
    side = scale(1.0 / max(length(side), 1e-300), side)
    return along, side, cross(along, side)


@kernel
def row_frame(drawn, i):
    """Frame of a row of the drawn rachis."""
    rachis, k, part = drawn.rachis, drawn.row[i], drawn.part[i]
    rows = rachis.shape[0]
    along = sub(rachis[min(i + 1, rows - 1)], rachis[max(i - 1, 0)])
    return _frame(along, combined(1.0 - part, drawn.up[k], part, drawn.up[k + 1]))


@kernel
def _image_frame(drawn, i):
    """Frame of a row of the images."""
    rows = drawn.up.shape[0]
    along = sub(drawn.image[min(i + 1, rows - 1), 0], drawn.image[max(i - 1, 0), 0])
    up = drawn.up[i]
    return _frame(along, (up[0], up[1], up[2]))


@kernel
def _moved(vector, before, after):
    """A vector (3,) that goes with a frame to another one."""
    a, b, c = dot(vector, before[0]), dot(vector, before[1]), dot(vector, before[2])
    return add(combined(a, after[0], b, after[1]), scale(c, after[2]))


@kernel
def find_rest_turns(feet, skin, local, rotations, drawn, turns):
    """Row frames of the drawn feathers at rest, seen from their roots: turns (F, n, 3, 3).

    local: (F, n, 1 + 2 m, 3) m, rest nodes in root frames. rotations: (F, 3, 3) of the roots.
    """
    for f in range(local.shape[0]):
        draw_images(feet, f, skin, drawn)
        draw_rachis(local[f], drawn)
        for i in range(local.shape[1]):
            axes = row_frame(drawn, i)
            for c in range(3):
                column = rotations[f, 0, c], rotations[f, 1, c], rotations[f, 2, c]
                for k in range(3):
                    turns[f, i, k, c] = dot(axes[k], column)


@kernel
def _applied(axes, turn, vector):
    """A vector (3,) in root frames, as the row's frame now has it in the world."""
    a = dot(turn[0], vector)
    b = dot(turn[1], vector)
    c = dot(turn[2], vector)
    return add(combined(a, axes[0], b, axes[1]), scale(c, axes[2]))


@kernel
def _back(root, vector):
    """A vector (3,) seen from a root (3, 3)."""
    return (
        root[0, 0] * vector[0] + root[1, 0] * vector[1] + root[2, 0] * vector[2],
        root[0, 1] * vector[0] + root[1, 1] * vector[1] + root[2, 1] * vector[2],
        root[0, 2] * vector[0] + root[1, 2] * vector[1] + root[2, 2] * vector[2],
    )


@kernel
def _turned_along(vector, before, after):
    """A vector turned by the smallest rotation that takes one direction to another."""
    first, second = dot(before, before), dot(after, after)
    if first < _NO_LENGTH or second < _NO_LENGTH:
        return vector
    size = 1.0 / sqrt(first * second)
    cosine = size * dot(before, after)
    if cosine < -0.99:
        return vector
    axis = scale(size, cross(before, after))
    once = cross(axis, vector)
    return add(vector, add(once, scale(1.0 / (1.0 + cosine), cross(axis, once))))


@kernel
def _piece(frame, rest, posed, image):
    """A posed segment in the world, turned as its image is. frame: axes and turn of its row, and
    the root (3, 3); rest: in root frames; posed, image: in the world."""
    axes, turn, root = frame
    own = _applied(axes, turn, _back(root, posed))
    return _turned_along(own, _applied(axes, turn, rest), image)


@kernel
def draw_pose(rest, turns, posed, root, drawn, made):
    """A posed feather where its images are: segments as long as they are posed.

    rest: (n, 1 + 2 m, 3) m in root frames; turns: (n, 3, 3); posed: RowPoints in the world; root:
    (3, 3); drawn: DrawnRachis. Written: made (RowPoints).
    """
    rows, m = rest.shape[0], (rest.shape[1] - 1) // 2
    nodes, directors = posed
    out, turned = made
    store(out[0, 0], (nodes[0, 0, 0], nodes[0, 0, 1], nodes[0, 0, 2]))
    for i in range(rows):
        axes, imaged = row_frame(drawn, i), _image_frame(drawn, i)
        frame = axes, turns[i], root
        for k in range(2):
            store(turned[i, k], _applied(axes, turns[i], _back(root, directors[i, k])))
        for side in range(2):
            before = 0
            for j in range(1 + side * m, 1 + side * m + m):
                own = sub(nodes[i, j], nodes[i, before])
                at_rest = sub(rest[i, j], rest[i, before])
                image = sub(drawn.image[i, j], drawn.image[i, before])
                piece = _piece(frame, at_rest, own, _moved(image, imaged, axes))
                store(out[i, j], add(out[i, before], piece))
                before = j
        if i + 1 < rows:
            own, at_rest = sub(nodes[i + 1, 0], nodes[i, 0]), sub(rest[i + 1, 0], rest[i, 0])
            way = sub(drawn.rachis[i + 1], drawn.rachis[i])
            store(out[i + 1, 0], add(out[i, 0], _piece(frame, at_rest, own, way)))


@kernel
def _earlier(values, back, out):
    """Values of one feather and their two rates, three (n, J, 3), `back` s earlier: out."""
    now, rate, second = values
    half = 0.5 * back * back
    for i in range(out.shape[0]):
        for j in range(out.shape[1]):
            for k in range(3):
                out[i, j, k] = now[i, j, k] - back * rate[i, j, k] + half * second[i, j, k]


@kernel
def _differences(made, step, out):
    """Values and their rates at the latest of three times, step s apart, latest first."""
    now, rate, second = out
    for i in range(now.shape[0]):
        for j in range(now.shape[1]):
            for k in range(3):
                x, y, z = made[0, i, j, k], made[1, i, j, k], made[2, i, j, k]
                now[i, j, k] = x
                if step > 0.0:
                    rate[i, j, k] = (3.0 * x - 4.0 * y + z) / (2.0 * step)
                    second[i, j, k] = (x - 2.0 * y + z) / (step * step)


@kernel
def follow_skin(feet, own, skins, given, roots, step, room, span):
    """Draw posed feathers on their leaves over a skin that moves, with their rates.

    own: rest (F, n, 1 + 2 m, 3) m in root frames, and turns (F, n, 3, 3). skins: points and normals
    (3, V, 3) at three times, step s apart, the latest first, and triangles (T, 3). given: nodes and
    directors of the feathers in the world, each with two rates; changed in place. roots: rotations
    (F, 3, 3) and their two rates. step: 0 where nothing moves. room: Room. span: of feathers.
    """
    rest, turns = own
    points, normals, triangles = skins
    nodes, directors = given
    turn, turn1, turn2 = roots
    drawn = room.drawn
    for f in range(span[0], span[1]):
        every = nodes[0][f], nodes[1][f], nodes[2][f]
        axes = directors[0][f], directors[1][f], directors[2][f]
        for q in range(3 if step > 0.0 else 1):
            back = q * step
            _earlier(every, back, room.nodes)
            _earlier(axes, back, room.directors)
            for i in range(3):
                for k in range(3):
                    bent = 0.5 * back * back * turn2[f, i, k]
                    room.root[i, k] = turn[f, i, k] - back * turn1[f, i, k] + bent
            draw_images(feet, f, (points[q], normals[q], triangles), drawn)
            draw_rachis(rest[f], drawn)
            posed, made = (room.nodes, room.directors), (room.made[q], room.turned[q])
            draw_pose(rest[f], turns[f], posed, room.root, drawn, made)
        _differences(room.made, step, every)
        _differences(room.turned, step, axes)
