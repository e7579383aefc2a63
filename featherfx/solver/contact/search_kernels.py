"""Which nodes of one vane meet the surface of another, and where.

A vane is a strip of n rows times 2 m + 1 nodes: the trailing barb's end is column 0, the rachis m,
the leading barb's end 2 m. The nearest node is found by boxes around rows, the closest point by
walking over the triangles around it (Ericson 2005, section 5.1.5). Nothing is built or allocated.
"""

from math import sqrt

from featherfx.jit.compiled import kernel

# parts into which the rim between two rows is divided
RIM_PARTS = 4


@kernel
def strip_point(column, columns):
    """Material point of a node of the strip."""
    if column == columns:
        return 0
    return 2 + column - columns if column > columns else 2 + 2 * columns - column


@kernel
def guest_point(c, columns, own):
    """(material point, share of the next row) of column c of a row's guests.

    columns: of the widest grid, which the points are counted on; own: of the feather's.

    The first 2 m + 1 are the strip's nodes. The others lie on the trailing, then on the leading
    rim between this row's node and the next one's, because rims that cross touch between nodes.
    """
    extra = c - 2 * columns - 1
    if extra < 0:
        return strip_point(c, columns), 0.0
    between = RIM_PARTS - 1
    p = 2 + columns + own if extra < between else 2 + own
    return p, (extra % between + 1.0) / RIM_PARTS


@kernel
def guest_place(points, i, p, share, place):
    """Place (3,) of a guest's point in a pose (n, P, 3): row i, material point p, and share of the
    next row."""
    for k in range(3):
        place[k] = points[i, p, k]
        if share > 0.0:
            place[k] += share * (points[i + 1, p, k] - points[i, p, k])


@kernel
def row_boxes(points, present, boxes, bounds):
    """Boxes (n, 6) of the strip's rows, low then high, and of all, bounds (6,); m.

    points: (n, P, 3). present: (n, 2 m + 1). An empty box has a low above its high.
    """
    columns = (present.shape[1] - 1) // 2
    for k in range(3):
        bounds[k], bounds[3 + k] = 1e300, -1e300
    for i in range(points.shape[0]):
        for k in range(3):
            boxes[i, k], boxes[i, 3 + k] = 1e300, -1e300
        for c in range(present.shape[1]):
            if present[i, c] == 0:
                continue
            x = points[i, strip_point(c, columns)]
            for k in range(3):
                boxes[i, k] = min(boxes[i, k], x[k])
                boxes[i, 3 + k] = max(boxes[i, 3 + k], x[k])
        for k in range(3):
            bounds[k] = min(bounds[k], boxes[i, k])
            bounds[3 + k] = max(bounds[3 + k], boxes[i, 3 + k])


@kernel
def box_distance(x, y, z, box):
    """Square of the distance (m^2) of a point from a box (6,)."""
    dx = max(box[0] - x, max(0.0, x - box[3]))
    dy = max(box[1] - y, max(0.0, y - box[4]))
    dz = max(box[2] - z, max(0.0, z - box[5]))
    return dx * dx + dy * dy + dz * dz


@kernel
def boxes_apart(first, second, margin):
    """Whether two boxes (6,) are farther apart than a margin (m) along an axis."""
    for k in range(3):
        if first[k] > second[3 + k] + margin or second[k] > first[3 + k] + margin:
            return True
    return False


@kernel
def nearest_node(x, y, z, points, present, boxes, row, column, limit):
    """(row, column) of the strip's node nearest to a point, -1 if none is nearer than limit (m).

    row, column: first guess, or -1.
    """
    columns = (present.shape[1] - 1) // 2
    best, found_row, found_column = limit * limit, -1, -1
    if row >= 0 and present[row, column] != 0:
        p = points[row, strip_point(column, columns)]
        square = (p[0] - x) ** 2 + (p[1] - y) ** 2 + (p[2] - z) ** 2
        if square < best:
            best, found_row, found_column = square, row, column
    for i in range(points.shape[0]):
        if box_distance(x, y, z, boxes[i]) >= best:
            continue
        for c in range(present.shape[1]):
            if present[i, c] == 0:
                continue
            p = points[i, strip_point(c, columns)]
            square = (p[0] - x) ** 2 + (p[1] - y) ** 2 + (p[2] - z) ** 2
            if square < best:
                best, found_row, found_column = square, i, c
    return found_row, found_column


@kernel
def closest_weights(x, y, z, a, b, c):
    """Weights of corners a, b, c (3,) of the point of a triangle closest to (x, y, z)."""
    ux, uy, uz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    vx, vy, vz = c[0] - a[0], c[1] - a[1], c[2] - a[2]
    px, py, pz = x - a[0], y - a[1], z - a[2]
    d1, d2 = ux * px + uy * py + uz * pz, vx * px + vy * py + vz * pz
    if d1 <= 0.0 and d2 <= 0.0:
        return 1.0, 0.0, 0.0
    px, py, pz = x - b[0], y - b[1], z - b[2]
    d3, d4 = ux * px + uy * py + uz * pz, vx * px + vy * py + vz * pz
    if d3 >= 0.0 and d4 <= d3:
        return 0.0, 1.0, 0.0
    vc = d1 * d4 - d3 * d2
    if vc <= 0.0 and d1 >= 0.0 and d3 <= 0.0:
        t = d1 / (d1 - d3)
        return 1.0 - t, t, 0.0
    px, py, pz = x - c[0], y - c[1], z - c[2]
    d5, d6 = ux * px + uy * py + uz * pz, vx * px + vy * py + vz * pz
    if d6 >= 0.0 and d5 <= d6:
        return 0.0, 0.0, 1.0
    vb = d5 * d2 - d1 * d6
    if vb <= 0.0 and d2 >= 0.0 and d6 <= 0.0:
        t = d2 / (d2 - d6)
        return 1.0 - t, 0.0, t
    va = d3 * d6 - d5 * d4
    if va <= 0.0 and d4 - d3 >= 0.0 and d5 - d6 >= 0.0:
        t = (d4 - d3) / ((d4 - d3) + (d5 - d6))
        return 0.0, 1.0 - t, t
    total = va + vb + vc
    return va / total, vb / total, vc / total


@kernel
def triangle_corners(side, i, j, half):
    """(row, barb node) of the corners of triangle A or B of a cell, counted as in cell_stiffness.

    Seen from dorsal the corners run clockwise on the leading vane of a feather that is not
    mirrored; `side_normal` orients all alike.
    """
    if half == 0:
        return i, j, i, j + 1, i + 1, j
    return i, j + 1, i + 1, j + 1, i + 1, j


@kernel
def side_normal(side, a, b, c):
    """Unit normal of a triangle, the same way on both vanes (dorsal unless mirrored)."""
    ux, uy, uz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    vx, vy, vz = c[0] - a[0], c[1] - a[1], c[2] - a[2]
    sign = -1.0 if side == 0 else 1.0
    nx = sign * (uy * vz - uz * vy)
    ny = sign * (uz * vx - ux * vz)
    nz = sign * (ux * vy - uy * vx)
    size = sqrt(nx * nx + ny * ny + nz * nz)
    inverse = 1.0 / size if size > 0.0 else 0.0
    return nx * inverse, ny * inverse, nz * inverse


@kernel
def barb_point(side, node, columns):
    """Material point of a barb's node; 0 is the rachis."""
    return 0 if node == 0 else 2 + side * columns + node


@kernel
def _around_node(x, y, z, points, exists, row, column, best, place, weight):
    """Closest point of the triangles around a node, if closer than best (m^2); returns the square.

    Written where one is closer: place (4,) side, i, j, half; weight (3,).
    """
    columns = exists.shape[2]
    for di in range(2):
        i = row - 1 + di
        if i < 0 or i >= exists.shape[1]:
            continue
        for dc in range(2):
            c = column - 1 + dc
            if c < 0 or c >= 2 * columns:
                continue
            side = 0 if c >= columns else 1
            j = c - columns if c >= columns else columns - 1 - c
            for half in range(2):
                if exists[side, i, j, half] == 0:
                    continue
                ia, na, ib, nb, ic, nc = triangle_corners(side, i, j, half)
                a = points[ia, barb_point(side, na, columns)]
                b = points[ib, barb_point(side, nb, columns)]
                d = points[ic, barb_point(side, nc, columns)]
                wa, wb, wc = closest_weights(x, y, z, a, b, d)
                square = 0.0
                square += (wa * a[0] + wb * b[0] + wc * d[0] - x) ** 2
                square += (wa * a[1] + wb * b[1] + wc * d[1] - y) ** 2
                square += (wa * a[2] + wb * b[2] + wc * d[2] - z) ** 2
                if square < best:
                    best = square
                    place[0], place[1], place[2], place[3] = side, i, j, half
                    weight[0], weight[1], weight[2] = wa, wb, wc
    return best


@kernel
def closest_point(x, y, z, points, exists, row, column, place, weight):
    """Closest point of a strip, walking from a node; returns the square of its distance (m^2).

    points: (n, P, 3). exists: (2, n - 1, m, 2). Written: place (4,) side, i, j, half of its
    triangle (side -1 where the node has none) and weight (3,) of its corners.
    """
    columns = exists.shape[2]
    best = 1e300
    place[0] = -1
    for _ in range(points.shape[0] + columns):
        better = _around_node(x, y, z, points, exists, row, column, best, place, weight)
        if place[0] < 0 or better >= best:
            break
        best = better
        side = place[0]
        ia, na, ib, nb, ic, nc = triangle_corners(side, place[1], place[2], place[3])
        row, node = ia, na
        if weight[1] > weight[0] and weight[1] >= weight[2]:
            row, node = ib, nb
        elif weight[2] > weight[0]:
            row, node = ic, nc
        column = columns + node if side == 0 else columns - node
    return best
