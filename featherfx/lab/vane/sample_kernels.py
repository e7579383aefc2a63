"""Energy, gradient and stiffness of a plane membrane at its strain points.

    W = sum over points of g (E_vv e_vv^2 + E_ww e_ww^2 + E_vw (2 e_vw)^2) / 2  +  g k / 2592 l^3

g volume that a point stands for. The last term is the compression guard of guard_kernels.py,
k its modulus, l = 1 - J the area that is lost, 0 at least. In the plane J = a x c has its sign and
is bilinear in the nodes, so that its derivatives need no rounding. The strains are those of
vane_membrane_kernels.py and barb_kernels.py, taken of the images a = F v and c = F w of the
unit vectors along and across the barbs, so any element serves whose a and c are linear in its
nodes. Second variations: da.da of e_vv, dc.dc of e_ww, 2 da.dc of 2 e_vw, times their stresses.
The second variation of J takes the guard's pressure dW/dJ / g = -3 k / 2592 l^2.

The stresses of the second variation are given apart from those of the gradient. Newton's
iterations take there what the last iteration predicted to first order, as if stresses were
unknowns of their own: an iterate that stretches stiff barbs too far then does not spoil the
stiffness. Source: Magisano, Leonetti, Garcea 2017 (mixed integration points).

Segments of barbs that keep their length: excess strain and its gradient.

The strain is that of barb_kernels.py.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from featherfx.jit.compiled import kernel
from featherfx.lab.nodal.barb_kernels import stretch_gradient, stretch_strain
from featherfx.mechanics.vane_membrane_kernels import membrane_gradient, membrane_strain

Array = NDArray[np.float64]


class Elements(NamedTuple):
    """M elements of K nodes and Q strain points.

    nodes: (M, K). along, across: (M, Q, K) 1/m, derivatives of the nodes' functions along and
    across the barbs. volume: (M, Q) m^3. moduli: (M, 3) Pa, along the barbs, across them, shear.
    guard: Pa, k / 2592.
    """

    nodes: NDArray[np.int64]
    along: Array
    across: Array
    volume: Array
    moduli: Array
    guard: float


@kernel
def images(positions, nodes, along, across, point):
    """a and c, written to point (3, 3): rows origin (zero), a, c.

    positions: (N, 2). nodes: (K,) of an element. along, across: (K,) derivatives of the node
    functions along and across the barbs.
    """
    for k in range(3):
        for axis in range(3):
            point[k, axis] = 0.0
    for i in range(nodes.shape[0]):
        for axis in range(2):
            x = positions[nodes[i], axis]
            point[1, axis] += along[i] * x
            point[2, axis] += across[i] * x


@kernel
def point_strains(point, unit, strain):
    """(e_vv, e_ww, 2 e_vw), written to strain (3,). unit: (1, 0, 1)."""
    strain[0] = stretch_strain(point[0], point[1], 1.0)
    strain[1], strain[2] = membrane_strain(point[0], point[1], point[2], unit)


@kernel
def point_gradients(point, unit, gradient, line, table):
    """Gradients of the strains by (a, c), written to table (3, 2, 2): strain, vector, axis.

    gradient: (2, 3, 3) and line: (6,), scratch.
    """
    stretch_gradient(point[0], point[1], 1.0, line)
    membrane_gradient(point[0], point[1], point[2], unit, gradient)
    for axis in range(2):
        table[0, 0, axis] = line[3 + axis]
        table[0, 1, axis] = 0.0
        for s in range(2):
            table[1 + s, 0, axis] = gradient[s, 1, axis]
            table[1 + s, 1, axis] = gradient[s, 2, axis]


@kernel
def area_ratio(point):
    """J of a and c."""
    return point[1, 0] * point[2, 1] - point[1, 1] * point[2, 0]


@kernel
def area_slope(along, across, point, axis):
    """dJ by an axis of a node whose functions have these derivatives."""
    other = 1 - axis
    sign = 1.0 if axis == 0 else -1.0
    return sign * (along * point[2, other] - across * point[1, other])


@kernel
def sample_pressures(positions, step, elements, point, pressure):
    """The guard's pressure at `positions`, changed by `step` (N, 2) to first order, to pressure
    (M, Q), Pa; point: (3, 3), scratch."""
    nodes, along, across, _, _, guard = elements
    for m in range(nodes.shape[0]):
        for q in range(along.shape[1]):
            images(positions, nodes[m], along[m, q], across[m, q], point)
            loss, change = max(1.0 - area_ratio(point), 0.0), 0.0
            for i in range(nodes.shape[1]):
                for axis in range(2):
                    slope = area_slope(along[m, q, i], across[m, q, i], point, axis)
                    change += slope * step[nodes[m, i], axis]
            pressure[m, q] = -3.0 * guard * loss * max(loss - 2.0 * change, 0.0)


@kernel
def sample_strains(positions, elements, unit, point, strain):
    """Strains of all points, written to strain (M, Q, 3).

    positions: (N, 2) m. point: (3, 3), scratch.
    """
    nodes, along, across, _, _, _ = elements
    for m in range(nodes.shape[0]):
        for q in range(along.shape[1]):
            images(positions, nodes[m], along[m, q], across[m, q], point)
            point_strains(point, unit, strain[m, q])


@kernel
def predicted_strains(positions, step, elements, unit, scratch, strain):
    """Strains at `positions` plus their linear change by `step` (N, 2), to strain (M, Q, 3).

    scratch: point (3, 3), change (3, 3), gradient (2, 3, 3), line (6,), table (3, 2, 2).
    """
    nodes, along, across, _, _, _ = elements
    point, change, gradient, line, table = scratch
    for m in range(nodes.shape[0]):
        for q in range(along.shape[1]):
            images(positions, nodes[m], along[m, q], across[m, q], point)
            images(step, nodes[m], along[m, q], across[m, q], change)
            point_strains(point, unit, strain[m, q])
            point_gradients(point, unit, gradient, line, table)
            for s in range(3):
                for vector in range(2):
                    for axis in range(2):
                        strain[m, q, s] += table[s, vector, axis] * change[1 + vector, axis]


@kernel
def _add_guard(own, point, stiffness, pressure, forces, block):
    """Adds the guard of one point to forces (N, 2) and block (2 K, 2 K); returns its energy (J).

    own: nodes (K,) and their derivatives along and across (K,). point: as of images. stiffness: J.
    pressure: J, of the second variation of J.
    """
    nodes, along, across = own
    count, loss = nodes.shape[0], 1.0 - area_ratio(point)
    for i in range(count if pressure != 0.0 else 0):
        for j in range(count):
            value = pressure * (along[i] * across[j] - across[i] * along[j])
            block[2 * i, 2 * j + 1] += value
            block[2 * j + 1, 2 * i] += value
    if loss <= 0.0:
        return 0.0
    for a in range(2 * count):
        by_a = area_slope(along[a // 2], across[a // 2], point, a % 2)
        forces[nodes[a // 2], a % 2] -= 3.0 * stiffness * loss * loss * by_a
        for b in range(2 * count):
            by_b = area_slope(along[b // 2], across[b // 2], point, b % 2)
            block[a, b] += 6.0 * stiffness * loss * by_a * by_b
    return stiffness * loss * loss * loss


@kernel
def sample_system(positions, elements, geometric, unit, scratch, forces, blocks):
    """Energy; gradient to forces (N, 2), zero before; stiffness to blocks (M, 2 K, 2 K).

    geometric: (M, Q, 4) Pa, stresses and the guard's pressure of the second variation. scratch: as
    in predicted_strains, then strain (3,) and lever (2 K, 3).
    """
    nodes, along, across, volume, moduli, guard = elements
    point, _, gradient, line, table, strain, lever = scratch
    energy = 0.0
    count = nodes.shape[1]
    for m in range(nodes.shape[0]):
        for i in range(2 * count):
            for j in range(2 * count):
                blocks[m, i, j] = 0.0
        for q in range(along.shape[1]):
            images(positions, nodes[m], along[m, q], across[m, q], point)
            point_strains(point, unit, strain)
            point_gradients(point, unit, gradient, line, table)
            g = volume[m, q]
            for s in range(3):
                energy += 0.5 * g * moduli[m, s] * strain[s] * strain[s]
                for i in range(count):
                    for axis in range(2):
                        value = along[m, q, i] * table[s, 0, axis]
                        value += across[m, q, i] * table[s, 1, axis]
                        lever[2 * i + axis, s] = value
                        forces[nodes[m, i], axis] += g * moduli[m, s] * strain[s] * value
            for i in range(2 * count):
                for s in range(3):
                    stiff = g * moduli[m, s] * lever[i, s]
                    for j in range(2 * count):
                        blocks[m, i, j] += stiff * lever[j, s]
            for i in range(count):
                av, aw = along[m, q, i], across[m, q, i]
                by_along = g * (geometric[m, q, 0] * av + geometric[m, q, 2] * aw)
                by_across = g * (geometric[m, q, 1] * aw + geometric[m, q, 2] * av)
                for j in range(count):
                    value = by_along * along[m, q, j] + by_across * across[m, q, j]
                    blocks[m, 2 * i, 2 * j] += value
                    blocks[m, 2 * i + 1, 2 * j + 1] += value
            if guard > 0.0:
                own = (nodes[m], along[m, q], across[m, q])
                pressure = g * geometric[m, q, 3]
                energy += _add_guard(own, point, g * guard, pressure, forces, blocks[m])
    return energy


@kernel
def chain_system(positions, chains, inverse, line, ends, excess, table):
    """e to excess (S,) and its gradient by both ends to table (S, 4): x, y of one, of the other.

    positions: (N, 2) m. chains: (S, 2). inverse: (S,) 1/m. line: (6,) and ends: (2, 3), scratch.
    """
    for s in range(chains.shape[0]):
        for end in range(2):
            ends[end, 2] = 0.0
            for axis in range(2):
                ends[end, axis] = positions[chains[s, end], axis]
        excess[s] = stretch_strain(ends[0], ends[1], inverse[s])
        stretch_gradient(ends[0], ends[1], inverse[s], line)
        for axis in range(2):
            table[s, axis], table[s, 2 + axis] = line[axis], line[3 + axis]
