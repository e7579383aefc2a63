"""Stencils of points, rachis and barbs in the nodal kinematics, added to the band.

Every stencil gives the gradients of its strains (lines), the stiffnesses that weigh their outer
products and the stresses that weigh their sum; they go straight to the band, block by block.

Geometric stiffness of the barbs' stretch, the membrane and the rachis is that of the stress on
which the last two iterates agree (the smaller one, or none where they differ in sign). That of an
iterate alone may be thousands of times the true one, because a move may stretch stiff barbs, and
Newton then stalls; left out, it converges slowly or not at all where tension carries load.
"""

from featherfx.jit.compiled import kernel
from featherfx.lab.nodal.barb_kernels import (
    begin_barb,
    begin_twist,
    bend_gradient,
    carried_gradient,
    clamp_gradient,
    stretch_gradient,
)
from featherfx.lab.nodal.energy_kernels import bend_nodes, sections
from featherfx.mechanics.barb_kernels import (
    add_director_stiffness,
    node_index,
    subtract_couple_moments,
    subtract_director_moments,
)
from featherfx.mechanics.rachis_kernels import (
    rachis_geometric_stiffness,
    rachis_gradient,
    rachis_stabilising_stiffness,
)


@kernel
def agreed(now, before):
    """The smaller of two stresses of one sign, else 0."""
    if now > 0.0 and before > 0.0:
        return min(now, before)
    if now < 0.0 and before < 0.0:
        return max(now, before)
    return 0.0


@kernel
def _add_four(first, nodes, element, band):
    """band += sum of weight lines lines^T over the four lines from first on."""
    weight, slots = element.weight[first:], element.slots
    d, e = element.lines[first], element.lines[first + 1]
    f, g = element.lines[first + 2], element.lines[first + 3]
    for b in range(nodes):
        column = slots[b]
        for y in range(3 if column >= 0 else 0):
            k = 3 * b + y
            p, q, r, s = weight[0] * d[k], weight[1] * e[k], weight[2] * f[k], weight[3] * g[k]
            into = band[column + y]
            for a in range(nodes):
                at, c = slots[a] - column - y, 3 * a
                if at >= 0:
                    for x in range(3):
                        into[at + x] += (p * d[c + x] + q * e[c + x]) + (
                            r * f[c + x] + s * g[c + x]
                        )
                elif slots[a] == column:
                    for x in range(y, 3):
                        into[at + x] += (p * d[c + x] + q * e[c + x]) + (
                            r * f[c + x] + s * g[c + x]
                        )


@kernel
def add_element(count, nodes, element, system):
    """band += sum of weight lines lines^T over count lines of a stencil of some nodes.

    Taken four at a time, so the lines after them have to be finite; their weights are set to 0.
    """
    for first in range(0, count, 4):
        for k in range(count, first + 4):
            element.weight[k] = 0.0
        _add_four(first, nodes, element, system.band)


@kernel
def add_stress(stress, line, nodes, element, right):
    """right -= stress line."""
    for a in range(nodes):
        at = element.slots[a]
        if at >= 0:
            for x in range(3):
                right[at + x] -= stress * line[3 * a + x]


@kernel
def add_isotropic(first, second, stiffness, band):
    """Stiffness times |dx_2 - dx_1|^2 / 2 of the points with these slots."""
    for x in range(3):
        if first >= 0:
            band[first + x, 0] += stiffness
        if second >= 0:
            band[second + x, 0] += stiffness
        if first >= 0 and second >= 0:
            if first == second:
                band[first + x, 0] -= 2.0 * stiffness
            else:
                band[min(first, second) + x, abs(first - second)] -= stiffness


@kernel
def add_nodes(slot, work):
    """Inertia, gravity, air and grips."""
    force, stiff = work.force, work.stiff
    band, right = work.system.band, work.system.right
    for i in range(slot.shape[0]):
        for p in range(slot.shape[1]):
            at = slot[i, p]
            if at < 0:
                continue
            for k in range(3):
                right[at + k] -= force[i, p, k]
                band[at + k, 0] += stiff[i, p, k]
            band[at, 1] += stiff[i, p, 3]
            band[at, 2] += stiff[i, p, 4]
            band[at + 1, 1] += stiff[i, p, 5]


@kernel
def add_directors(rotary_inertia, inertia, couple, frame_slot, work):
    """Rotary inertia of the rachis, and dead loads. inertia: 1/s^2. couple: as of Loads."""
    directors, target = work.now.points.directors, work.around.target.directors
    band, right = work.system.band, work.system.right
    for i in range(frame_slot.shape[0]):
        at = frame_slot[i]
        if at >= 0:
            subtract_director_moments(i, rotary_inertia, inertia, directors, target, right[at:])
            subtract_couple_moments(i, couple, directors, right[at:])
            add_director_stiffness(i, rotary_inertia, inertia, directors, at, band)


@kernel
def add_rachis(model, nodal, f, damping, signed, work):
    """Stretch, shear, twist and bending of the rachis."""
    pose, before, reference, slot = work.now, work.before, work.around.reference, nodal.slot[f]
    element, system = work.element, work.system
    beam, matrix, slots = element.beam, element.matrix, element.slots
    nodes, frame_slot = pose.points.nodes, nodal.frame_slot[f]
    for i in range(pose.halfway.shape[0]):
        for a in range(2):
            slots[2 * a], slots[2 * a + 1] = slot[i + a, 0], frame_slot[i + a]
        start, end, length = nodes[i, 0], nodes[i + 1, 0], model.length[f, i]
        rachis_gradient(start, end, length, pose.halfway[i], pose.rachis[i], beam)
        for k in range(6):
            at = 6 * i + k
            stiffness = model.rachis_stiffness[f, i, k]
            strain = pose.strains[at]
            stress = stiffness * (strain + damping * (strain - reference[at]))
            element.stress[k] = stiffness * agreed(strain, before[at])
            element.weight[k] = stiffness * (1.0 + damping)
            for a in range(12):
                element.lines[k, a] = beam[k, a]
            add_stress(stress, beam[k], 4, element, system.right)
        add_element(6, 4, element, system)
        for a in range(12):
            for b in range(12):
                matrix[a, b] = 0.0
        halfway, stress = pose.halfway[i], element.stress
        if signed:
            rachis_geometric_stiffness(start, end, length, halfway, pose.rachis[i], stress, matrix)
        else:
            rachis_stabilising_stiffness(start, end, length, halfway, stress, matrix)
        for a in range(12):
            for b in range(a + 1):
                row, column = slots[a // 3], slots[b // 3]
                if row >= 0 and column >= 0:
                    row, column = row + a % 3, column + b % 3
                    system.band[min(row, column), abs(row - column)] += matrix[a, b]


@kernel
def add_stretch(nodal, f, damping, signed, work):
    """Stretch of all barb segments."""
    pose, before, reference, price = work.now, work.before, work.around.reference, work.multiplier
    element, system = work.element, work.system
    columns = price.shape[2]
    at, _, _, _ = sections(price.shape[1], columns)
    for side in range(2):
        for i in range(price.shape[1]):
            for j in range(columns):
                stiffness = nodal.stretch_stiffness[f, side, i, j]
                if stiffness > 0.0:
                    p, q = node_index(side, j, columns), node_index(side, j + 1, columns)
                    inverse = nodal.stretch_inverse[f, side, i, j]
                    element.slots[0], element.slots[1] = nodal.slot[f, i, p], nodal.slot[f, i, q]
                    stretch_gradient(
                        pose.points.nodes[i, p], pose.points.nodes[i, q], inverse, element.lines[0]
                    )
                    strain, extra = pose.strains[at], price[side, i, j]
                    rate = damping * (strain - reference[at])
                    element.weight[0] = stiffness * (1.0 + damping)
                    add_element(1, 2, element, system)
                    add_stress(
                        stiffness * (strain + rate) + extra,
                        element.lines[0],
                        2,
                        element,
                        system.right,
                    )
                    tension = agreed(stiffness * strain + extra, stiffness * before[at] + extra)
                    if tension > 0.0 or signed:
                        add_isotropic(
                            element.slots[0],
                            element.slots[1],
                            tension * inverse * inverse,
                            system.band,
                        )
                at += 1


@kernel
def _clamp(model, nodal, f, side, i, work):
    """Stencil of a barb's clamp; returns its points."""
    pose, element = work.now, work.element
    columns, slot = model.joints.shape[3], nodal.slot[f]
    p = node_index(side, 1, columns)
    clamp_gradient(
        pose.rotation[i],
        model.clamp[f, side, i],
        pose.points.nodes[i, 0],
        pose.points.nodes[i, p],
        element.frame,
        element.turns,
        element.lines,
    )
    slots = element.slots
    slots[0], slots[1], slots[2] = slot[i, 0], nodal.frame_slot[f, i], slot[i, p]
    return 3


@kernel
def _bend(nodal, f, side, i, j, work):
    """Stencil of a barb's bend in a section that follows the vane; returns its points."""
    points, element = work.now.points.nodes, work.element
    nodes, slot = element.nodes, nodal.slot[f]
    rows, columns = points.shape[0], points.shape[1] // 2
    bend_nodes(side, i, j, rows, columns, nodes)
    for a in range(5):
        element.slots[a] = slot[nodes[a, 0], nodes[a, 1]]
    bend_gradient(
        points[nodes[0, 0], nodes[0, 1]],
        points[nodes[1, 0], nodes[1, 1]],
        points[nodes[2, 0], nodes[2, 1]],
        points[nodes[3, 0], nodes[3, 1]],
        points[nodes[4, 0], nodes[4, 1]],
        element.frame,
        element.turns,
        element.lines,
    )
    return 5


@kernel
def _add_bend(at, stiffness, count, damping, work):
    """Add the stencil of the two turns from strain at on."""
    strains, reference = work.now.strains, work.around.reference
    element, system = work.element, work.system
    for d in range(2):
        strain = strains[at + d]
        stress = stiffness[d] * (strain + damping * (strain - reference[at + d]))
        element.weight[d] = stiffness[d] * (1.0 + damping)
        add_stress(stress, element.lines[d], count, element, system.right)
    add_element(2, count, element, system)


@kernel
def _add_carried(model, nodal, f, side, i, at, damping, work):
    """Bending of one barb in a section that is carried along it; at: its first strain."""
    pose, element = work.now, work.element
    columns, row, slots = model.joints.shape[3], pose.points.nodes[i], element.slots
    begin_barb(pose.rotation[i], model.clamp[f, side, i], element.frame)
    begin_twist(element.frame, element.lines)
    slots[0], slots[1] = nodal.slot[f, i, 0], nodal.frame_slot[f, i]
    length = 0.0
    for j in range(columns):
        p, q = node_index(side, j, columns), node_index(side, j + 1, columns)
        slots[2 + j] = nodal.slot[f, i, q]
        length = carried_gradient(
            j, length, row[p], row[q], element.frame, element.turns, element.lines
        )
        stiffness = nodal.bend_stiffness[f, side, i, j]
        _add_bend(at + 2 * j, stiffness, j + 3, damping, work)


@kernel
def add_turns(model, nodal, f, damping, work):
    """Bending of all barbs, and their clamps."""
    rows, columns = work.now.rotation.shape[0], model.joints.shape[3]
    _, at, _, _ = sections(rows, columns)
    for side in range(2):
        for i in range(rows):
            if nodal.carried:
                if nodal.present[f, side, i]:
                    _add_carried(model, nodal, f, side, i, at, damping, work)
                at += 2 * columns
                continue
            for j in range(columns):
                stiffness = nodal.bend_stiffness[f, side, i, j]
                if stiffness[0] > 0.0 or stiffness[1] > 0.0:
                    if j == 0:
                        count = _clamp(model, nodal, f, side, i, work)
                    else:
                        count = _bend(nodal, f, side, i, j, work)
                    _add_bend(at, stiffness, count, damping, work)
                at += 2
