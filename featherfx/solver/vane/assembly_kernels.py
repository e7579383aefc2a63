"""Stiffness of the vane and its barbs in generalised coordinates, added to the band.

Nodes of the barb of row i move with w = 6 + 2 C increments, those of the row and of this side's
coefficients, by their Jacobian J. A block K between neighbouring nodes becomes J^T K J: first K J
along the whole barb for each increment, then dot products with the other barb's J. Both run over
contiguous numbers, axis by axis and node by node, S of them an axis: the m + 1 nodes of the barb,
0 being the rachis point, and zeros up to a multiple of four.
"""

from featherfx.algebra.vector_kernels import add, combined, cross, scale
from featherfx.algebra.views import COUNT as LANES
from featherfx.algebra.views import increase, lane, load, put, spread, totals
from featherfx.jit.compiled import kernel, loop_kernel, shared_kernel
from featherfx.mechanics.barb_kernels import add_barb_forces, barb_tensions, node_index
from featherfx.solver.vane.line_kernels import (
    PAIR_ALONG,
    PAIR_BACK,
    PAIR_OWN,
    PAIR_SKIP,
    PAIR_SLANT,
    PAIR_UP,
    damped_stress,
)


@kernel
def _add_node_stiffness(i, side, stiff, own):
    """Inertia, air and grips of the barb's nodes (n, 1 + 2 m, 6), added to own (3, 3 S), halved."""
    count, columns = own.shape[1] // 3, stiff.shape[1] // 2
    for j in range(1, columns + 1):
        s = stiff[i, node_index(side, j, columns)]
        for k in range(3):
            own[k, k * count + j] += 0.5 * s[k]
        xy, xz, yz = 0.5 * s[3], 0.5 * s[4], 0.5 * s[5]
        own[0, count + j] += xy
        own[1, j] += xy
        own[0, 2 * count + j] += xz
        own[2, j] += xz
        own[1, 2 * count + j] += yz
        own[2, count + j] += yz


@kernel
def _add_tension(i, side, segment, signed, points, force, vane):
    """Geometric stiffness of the barb's tension: T / l |turn of each segment|^2.

    segment: m, their length. points, force: nodes, (n, 1 + 2 m, 3).
    """
    if not segment > 0.0:
        return
    tension, own, along = (
        vane.tension,
        vane.blocks[i, side, PAIR_OWN],
        vane.blocks[i, side, PAIR_ALONG],
    )
    columns, count = tension.shape[0], own.shape[1] // 3
    barb = slice(1 + side * columns, 1 + (side + 1) * columns)
    barb_tensions(points[i, 0], points[i, barb], force[i, barb], tension)
    for j in range(columns):
        value = tension[j] / segment
        if value < 0.0 and not signed:
            continue
        for k in range(3):
            own[k, k * count + j] += 0.5 * value
            own[k, k * count + j + 1] += 0.5 * value
            along[k, k * count + j] -= value


@kernel
def _three(line, size, j):
    """Four nodes' vectors from node j on, of a line (3 S), axis by axis."""
    return load(line, j), load(line, size + j), load(line, 2 * size + j)


@kernel
def _put_three(line, size, j, vector):
    put(line, j, vector[0])
    put(line, size + j, vector[1])
    put(line, 2 * size + j, vector[2])


@kernel
def _block(lines, size, j):
    """Four nodes' blocks K from node j on; lines (3, 3 S), entry [m, k S + j] = K_km."""
    return _three(lines[0], size, j), _three(lines[1], size, j), _three(lines[2], size, j)


@kernel
def _times(block, x):
    """K x."""
    both = combined(x[0], block[0], x[1], block[1])
    return add(both, scale(x[2], block[2]))


@loop_kernel
def _push_own(near, far, barb, product):
    """product[a] = near J + far J(next node) for every increment a of a barb.

    near, far: (3, 3 S) blocks, far zero where there is no next node. barb: J, (w, 3 S), of which
    rows 0 to 2 are shifts of all nodes. product: (w, 3 S).
    """
    wide, size = barb.shape[0], barb.shape[1] // 3
    for j in range(0, size, LANES):
        k, f = _block(near, size, j), _block(far, size, j)
        _put_three(product[0], size, j, add(k[0], f[0]))
        _put_three(product[1], size, j, add(k[1], f[1]))
        _put_three(product[2], size, j, add(k[2], f[2]))
        for a in range(3, wide):
            x, y = _three(barb[a], size, j), _three(barb[a], size, j + 1)
            _put_three(product[a], size, j, add(_times(k, x), _times(f, y)))


@loop_kernel
def _push_next(back, near, far, barb, product):
    """As _push_own, with back J(node before) added."""
    wide, size = barb.shape[0], barb.shape[1] // 3
    for j in range(0, size, LANES):
        b, k, f = _block(back, size, j), _block(near, size, j), _block(far, size, j)
        _put_three(product[0], size, j, add(b[0], add(k[0], f[0])))
        _put_three(product[1], size, j, add(b[1], add(k[1], f[1])))
        _put_three(product[2], size, j, add(b[2], add(k[2], f[2])))
        for a in range(3, wide):
            x, y = _three(barb[a], size, j), _three(barb[a], size, j + 1)
            both = add(_times(k, x), _times(f, y))
            _put_three(product[a], size, j, add(both, _times(b, _three(barb[a], size, j - 1))))


@loop_kernel
def _push_far(block, barb, product):
    """As _push_own without far."""
    wide, size = barb.shape[0], barb.shape[1] // 3
    for j in range(0, size, LANES):
        k = _block(block, size, j)
        for a in range(3):
            _put_three(product[a], size, j, _three(block[a], size, j))
        for a in range(3, wide):
            _put_three(product[a], size, j, _times(k, _three(barb[a], size, j)))


@loop_kernel
def _add_resultants(barb, product, b, band, at, to):
    """Forces and moments (6) about the rachis point of columns b and b + 1 of product (w, 3 S),
    added to band from at and from to on.

    These are the products with rows 0 to 5 of the barb's Jacobian (w, 3 S), of which 3 to 5 hold
    the nodes' distances x, y, z from that point.
    """
    size, none = barb.shape[1] // 3, spread(0.0)
    f, g, m, n = (none, none, none), (none, none, none), (none, none, none), (none, none, none)
    for j in range(0, size, LANES):
        arm = load(barb[5], size + j), load(barb[3], 2 * size + j), load(barb[4], j)
        u, v = _three(product[b], size, j), _three(product[b + 1], size, j)
        f, g = add(f, u), add(g, v)
        m, n = add(m, cross(arm, u)), add(n, cross(arm, v))
    put(band, at, load(band, at) + totals(f[0], f[1], f[2], m[0]))
    put(band, to, load(band, to) + totals(g[0], g[1], g[2], n[0]))
    rest = totals(m[1], m[2], n[1], n[2])
    increase(band, at + 4, lane(rest, 0))
    increase(band, at + 5, lane(rest, 1))
    increase(band, to + 4, lane(rest, 2))
    increase(band, to + 5, lane(rest, 3))


@loop_kernel
def _add_dots(g, h, u, v, band, at, to):
    """g.u and h.u, added to band at and after at, g.v and h.v to and after to."""
    gu, hu, gv, hv = spread(0.0), spread(0.0), spread(0.0), spread(0.0)
    for s in range(0, g.shape[0], LANES):
        a, b, c, d = load(g, s), load(h, s), load(u, s), load(v, s)
        gu, hu = gu + a * c, hu + b * c
        gv, hv = gv + a * d, hv + b * d
    sums = totals(gu, hu, gv, hv)
    increase(band, at, lane(sums, 0))
    increase(band, at + 1, lane(sums, 1))
    increase(band, to, lane(sums, 2))
    increase(band, to + 1, lane(sums, 3))


@loop_kernel
def _add_four_dots(barb, a, u, v, band, at, to):
    """As _add_dots, of four rows of barb from a on."""
    g, h, k, q = barb[a], barb[a + 1], barb[a + 2], barb[a + 3]
    gu, hu, ku, qu = spread(0.0), spread(0.0), spread(0.0), spread(0.0)
    gv, hv, kv, qv = spread(0.0), spread(0.0), spread(0.0), spread(0.0)
    for s in range(0, u.shape[0], LANES):
        x, y = load(u, s), load(v, s)
        w = load(g, s)
        gu, gv = gu + w * x, gv + w * y
        w = load(h, s)
        hu, hv = hu + w * x, hv + w * y
        w = load(k, s)
        ku, kv = ku + w * x, kv + w * y
        w = load(q, s)
        qu, qv = qu + w * x, qv + w * y
    put(band, at, load(band, at) + totals(gu, hu, ku, qu))
    put(band, to, load(band, to) + totals(gv, hv, kv, qv))


@kernel
def _add_products(barb, product, band, first, stride, shift):
    """band[first + b stride + a] += barb[a].product[b], lines (w, 3 S); coefficients, a and b from
    6 on, lie shift further on."""
    wide = barb.shape[0]
    for b in range(0, wide, 2):
        at = first + (b + (shift if b >= 6 else 0)) * stride
        _add_resultants(barb, product, b, band, at, at + stride)
        u, v = product[b], product[b + 1]
        for a in range(6, wide - 2, 4):
            place = at + a + shift
            _add_four_dots(barb, a, u, v, band, place, place + stride)
        if wide % 4 == 0:
            place = at + wide - 2 + shift
            _add_dots(barb[wide - 2], barb[wide - 1], u, v, band, place, place + stride)


@kernel
def _add_within_row(sums, band, first, stride, shift):
    """Add what _add_products found for one row, sums (w, w), and its transpose, to band as
    there."""
    wide = sums.shape[0]
    for b in range(wide):
        at = first + (b + (shift if b >= 6 else 0)) * stride
        for a in range(b, wide):
            to = at + a + (shift if a >= 6 else 0)
            increase(band, to, sums[b, a] + sums[a, b])


@kernel
def subtract_barb_forces(model, f, damping, pose, reference, force, axes, right):
    """Forces of all barbs and on their nodes, projected, to the right-hand side.

    force: (n, 1 + 2 m, 3), of all that acts. axes: (2, n, m, 6) of pose_kernels.joint_axes.
    """
    rows, count = pose.rotation.shape[0], pose.coefficient.shape[2]
    columns, row_size, nodes = axes.shape[2], 6 + 2 * count, pose.points.nodes
    for side in range(2):
        barb = slice(1 + side * columns, 1 + (side + 1) * columns)
        for i in range(rows):
            at = i * row_size
            first = at + 6 + side * count
            add_barb_forces(
                axes[side, i],
                model.shapes,
                nodes[i, 0],
                nodes[i, barb],
                force[i, barb],
                right[at:],
                right[first : first + count],
            )
            strain, before = pose.strains.barb[side, i], reference.barb[side, i]
            stiffness = model.barb_stiffness[f, side, i]
            for c in range(count):
                right[first + c] -= damped_stress(stiffness[c], strain[c], before[c], damping)


@shared_kernel(None)
def add_rows(model, f, damping, signed, work):
    """Stiffness of feather f's vane and barbs to the band: row by row and side by side.

    signed: whether tension's geometric stiffness is whole or only its stabilising part. work: with
    the forces of all that acts, and the barbs' Jacobians.
    """
    rows, count = work.now.rotation.shape[0], work.now.coefficient.shape[2]
    row_size = 6 + 2 * count
    vane, jacobian, band = work.vane, work.jacobian, work.system.band
    blocks, product, sums = vane.blocks, vane.product, vane.sums
    stride = band.shape[1] - 1
    for i in range(rows):
        at = i * row_size
        for side in range(2):
            shift = side * count
            barb, own, along = (
                jacobian[i, side],
                blocks[i, side, PAIR_OWN],
                blocks[i, side, PAIR_ALONG],
            )
            for c in range(count):
                stiffness = model.barb_stiffness[f, side, i, c]
                band[at + 6 + shift + c, 0] += stiffness * (1.0 + damping)
            segment, points = model.segment[f, side, i], work.now.points.nodes
            _add_node_stiffness(i, side, work.stiff, own)
            _add_tension(i, side, segment, signed, points, work.force, vane)
            _push_own(own, along, barb, product)
            sums[:] = 0.0
            _add_products(barb, product, sums, 0, sums.shape[0], 0)
            _add_within_row(sums, band, at * (stride + 1), stride, shift)
            # entry (at + row_size + a, at + b) of the band
            first = at * (stride + 1) + row_size
            if i + 1 < rows:
                between = blocks[i, side]
                _push_next(between[PAIR_BACK], between[PAIR_UP], between[PAIR_SLANT], barb, product)
                _add_products(jacobian[i + 1, side], product, band, first, stride, shift)
            if i + 2 < rows:
                _push_far(blocks[i + 1, side, PAIR_SKIP], barb, product)
                beyond = first + row_size
                _add_products(jacobian[i + 2, side], product, band, beyond, stride, shift)
