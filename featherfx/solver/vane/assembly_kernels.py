"""Stiffness of the vane and its barbs in generalised coordinates, added to the band.

Nodes of the barb of row i move with w = 6 + 2 C increments, those of the row and of this side's
coefficients, by their Jacobian J. A block K between neighbouring nodes becomes J^T K J: first K J
along the whole barb for each increment, then dot products with the other barb's J. Both run over
contiguous numbers, axis by axis and node by node, S of them an axis: the m + 1 nodes of the barb,
0 being the rachis point, and zeros up to a multiple of four.
"""

from featherfx.algebra.vec3_kernels import add, cross
from featherfx.jit.compiled import kernel, loop_kernel
from featherfx.mechanics.barb_kernels import add_barb_forces, barb_tensions
from featherfx.mechanics.row_kernels import node_index
from featherfx.solver.vane.pairs_kernels import ALONG, BACK, OWN, SKIP, SLANT, UP, damped_stress


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
    tension, own, along = vane.tension, vane.blocks[i, side, OWN], vane.blocks[i, side, ALONG]
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


@loop_kernel
def _copy_three_times(source, first, second, third):
    for j in range(source.shape[0]):
        first[j] = source[j]
        second[j] = source[j]
        third[j] = source[j]


@kernel
def _tile(jacobian, tiles):
    """Each axis of a barb's Jacobian (w, 3 S) three times over, to tiles (w, 3, 3 S + 2), the
    first number of which is 0."""
    count = jacobian.shape[1] // 3
    for a in range(jacobian.shape[0]):
        for axis in range(3):
            line = tiles[a, axis]
            _copy_three_times(
                jacobian[a, axis * count : axis * count + count],
                line[1:],
                line[1 + count :],
                line[1 + 2 * count :],
            )


@loop_kernel
def _blocks_times(near, far, tiles, product):
    """product[a] = near J + far J(next node) for every increment a of a barb.

    near, far: (3, 3 S) blocks, entry [m, k S + j] = K_km at node j. The last number of an axis is a
    zero, as the first of a tile is, so that nodes beyond a barb's ends have no factor.
    product: (w, 3 S).
    """
    size = near.shape[1]
    n0, n1, n2, f0, f1, f2 = near[0], near[1], near[2], far[0], far[1], far[2]
    for a in range(product.shape[0]):
        x, y, z, line = tiles[a, 0], tiles[a, 1], tiles[a, 2], product[a]
        for s in range(size):
            line[s] = (
                n0[s] * x[s + 1]
                + n1[s] * y[s + 1]
                + n2[s] * z[s + 1]
                + f0[s] * x[s + 2]
                + f1[s] * y[s + 2]
                + f2[s] * z[s + 2]
            )


@loop_kernel
def _three_times(back, near, far, tiles, product):
    """As _blocks_times, with back J(node before) added."""
    size = near.shape[1]
    b0, b1, b2, n0, n1, n2 = back[0], back[1], back[2], near[0], near[1], near[2]
    f0, f1, f2 = far[0], far[1], far[2]
    for a in range(product.shape[0]):
        x, y, z, line = tiles[a, 0], tiles[a, 1], tiles[a, 2], product[a]
        for s in range(size):
            line[s] = (
                b0[s] * x[s]
                + b1[s] * y[s]
                + b2[s] * z[s]
                + n0[s] * x[s + 1]
                + n1[s] * y[s + 1]
                + n2[s] * z[s + 1]
                + f0[s] * x[s + 2]
                + f1[s] * y[s + 2]
                + f2[s] * z[s + 2]
            )


@loop_kernel
def _block_times(block, tiles, product):
    """As _blocks_times without far."""
    size = block.shape[1]
    b0, b1, b2 = block[0], block[1], block[2]
    for a in range(product.shape[0]):
        x, y, z, line = tiles[a, 0], tiles[a, 1], tiles[a, 2], product[a]
        for s in range(size):
            line[s] = b0[s] * x[s + 1] + b1[s] * y[s + 1] + b2[s] * z[s + 1]


@kernel
def _four_dots(g, h, u, v):
    """g.u, g.v, h.u, h.v of four lines: two by two, so that each load serves twice."""
    gu, gv, hu, hv = 0.0, 0.0, 0.0, 0.0
    for s in range(g.shape[0]):
        gu += g[s] * u[s]
        gv += g[s] * v[s]
        hu += h[s] * u[s]
        hv += h[s] * v[s]
    return gu, gv, hu, hv


@kernel
def _resultant(barb, u):
    """Force and moment (6) about the rachis point of forces u (3 S) on a barb's nodes.

    These are the products of u with rows 0 to 5 of the barb's Jacobian (w, 3 S), of which 3 to 5
    hold the nodes' distances x, y, z from that point.
    """
    count = u.shape[0] // 3
    x, y, z = barb[5, count:], barb[3, 2 * count :], barb[4]
    v, w = u[count:], u[2 * count :]
    total, moment = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    for j in range(count):
        force = u[j], v[j], w[j]
        total = add(total, force)
        moment = add(moment, cross((x[j], y[j], z[j]), force))
    return (*total, *moment)


@kernel
def _add_between_rows(rows, columns, row_at, column_at, shift, band):
    """band[row_at + a, column_at + b] += rows[a].columns[b] of a row and one before it.

    rows: Jacobian of the barb, columns: (w, 3 S); coefficients, a and b from 6 on, lie shift
    further on.
    """
    for b in range(columns.shape[0]):
        at = column_at + b + (shift if b >= 6 else 0)
        sums = _resultant(rows, columns[b])
        for a in range(6):
            band[at, row_at + a - at] += sums[a]
    for a in range(6, rows.shape[0], 2):
        to = row_at + a + shift
        for b in range(0, columns.shape[0], 2):
            at = column_at + b + (shift if b >= 6 else 0)
            gu, gv, hu, hv = _four_dots(rows[a], rows[a + 1], columns[b], columns[b + 1])
            band[at, to - at] += gu
            band[at, to - at + 1] += hu
            band[at + 1, to - at - 1] += gv
            band[at + 1, to - at] += hv


@kernel
def _add_within_row(rows, columns, row_at, shift, band):
    """As _add_between_rows within one row, the transpose of the products included."""
    for a in range(0, rows.shape[0], 2):
        to = row_at + a + (shift if a >= 6 else 0)
        for b in range(0, columns.shape[0], 2):
            at = row_at + b + (shift if b >= 6 else 0)
            gu, gv, hu, hv = _four_dots(rows[a], rows[a + 1], columns[b], columns[b + 1])
            if a == b:
                band[at, 0] += 2.0 * gu
                band[at, 1] += gv + hu
                band[at + 1, 0] += 2.0 * hv
                continue
            if a > b:
                low, up = at, to
            else:
                low, up, gv, hu = to, at, hu, gv
            band[low, up - low] += gu
            band[low, up - low + 1] += hu
            band[low + 1, up - low - 1] += gv
            band[low + 1, up - low] += hv


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


@kernel
def add_rows(model, f, damping, signed, work):
    """Stiffness of feather f's vane and barbs to the band: row by row and side by side.

    signed: whether tension's geometric stiffness is whole or only its stabilising part. work: with
    the forces of all that acts, and the barbs' Jacobians.
    """
    rows, count = work.now.rotation.shape[0], work.now.coefficient.shape[2]
    row_size = 6 + 2 * count
    vane, jacobian, band = work.vane, work.jacobian, work.system.band
    blocks, product, tiles = vane.blocks, vane.product, vane.tiles
    for i in range(rows):
        at = i * row_size
        for side in range(2):
            shift = side * count
            barb, own, along = jacobian[i, side], blocks[i, side, OWN], blocks[i, side, ALONG]
            for c in range(count):
                stiffness = model.barb_stiffness[f, side, i, c]
                band[at + 6 + shift + c, 0] += stiffness * (1.0 + damping)
            segment, points = model.segment[f, side, i], work.now.points.nodes
            _add_node_stiffness(i, side, work.stiff, own)
            _add_tension(i, side, segment, signed, points, work.force, vane)
            _tile(barb, tiles)
            _blocks_times(own, along, tiles, product)
            _add_within_row(barb, product, at, shift, band)
            if i + 1 < rows:
                between = blocks[i, side]
                _three_times(between[BACK], between[UP], between[SLANT], tiles, product)
                _add_between_rows(jacobian[i + 1, side], product, at + row_size, at, shift, band)
            if i + 2 < rows:
                _block_times(blocks[i + 1, side, SKIP], tiles, product)
                _add_between_rows(
                    jacobian[i + 2, side], product, at + 2 * row_size, at, shift, band
                )
