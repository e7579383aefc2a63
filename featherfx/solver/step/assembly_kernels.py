"""Gradient and Hessian of step_energy in generalised coordinates, as a band.

Forces of membrane, bending across barbs and twist on the nodes of a vane, and their stiffness.

A strain with stress s and stiffness k, whose gradient by node p is g_p, gives the force s g_p and,
for every pair of its nodes, the block k g_p g_q^T. Blocks are kept row by row and side by side: the
few kinds of pairs in line_kernels are all that triangles, hinges and twist couple.
"""

from featherfx.algebra.vector_kernels import accumulate
from featherfx.algebra.views import increase, load, put, spread
from featherfx.jit.compiled import kernel, loop_kernel, shared_kernel
from featherfx.mechanics.barb_kernels import (
    add_director_stiffness,
    subtract_couple_moments,
    subtract_director_moments,
)
from featherfx.mechanics.contact_kernels import add_contact_forces, add_contact_stiffness, press
from featherfx.mechanics.guard_kernels import (
    add_turn_guard_stiffness,
    add_turn_guard_stress,
    is_pressed,
)
from featherfx.mechanics.node_kernels import add_dead_forces, add_grip_forces, node_forces
from featherfx.mechanics.rachis_kernels import (
    rachis_geometric_stiffness,
    rachis_gradient,
    rachis_stabilising_stiffness,
)
from featherfx.mechanics.ribbon_kernels import add_curl_stiffness, add_curl_stress
from featherfx.mechanics.vane_hook_kernels import all_hold, hinge_hold, row_of_gaps, twist_hold
from featherfx.solver.step.active_contact_kernels import followed_contacts
from featherfx.solver.step.pose_kernels import barb_jacobians, joint_axes
from featherfx.solver.types import FORCES_ONLY, WHOLE_STIFFNESS
from featherfx.solver.vane.assembly_kernels import add_rows, subtract_barb_forces
from featherfx.solver.vane.cell_kernels import Strip, fill_strip
from featherfx.solver.vane.hinge_kernels import (
    Hinges,
    Twists,
    add_crushed_hinges,
    fill_hinges,
    fill_twists,
)
from featherfx.solver.vane.line_kernels import (
    add_lines_to_nodes,
    damped_stress,
    lanes,
    nodes_to_lines,
)
from featherfx.solver.vane.sum_kernels import add_blocks, add_forces


@kernel
def _add_rachis_node(stiff, at, band):
    """Inertia, air and grips of a rachis node, stiff (6,)."""
    for k in range(3):
        band[at + k, 0] += stiff[k]
    band[at, 1] += stiff[3]
    band[at, 2] += stiff[4]
    band[at + 1, 1] += stiff[5]


@kernel
def _subtract_rachis_forces(model, f, i, damping, pose, reference, beam, right):
    """Stress of the rachis element between rows i and i + 1, and its forces to the right-hand side.

    Stretch, shear, twist and bending. reference: (6,). Written: gradient and stress of beam.
    """
    row_size = right.shape[0] // pose.rotation.shape[0]
    at, gradient, stress, strain = i * row_size, beam.gradient, beam.stress, pose.strains.rachis[i]
    start, end, halfway = pose.centre[i], pose.centre[i + 1], pose.halfway[i]
    rachis_gradient(start, end, model.length[f, i], halfway, pose.rachis[i], gradient)
    for k in range(6):
        stiffness = model.rachis_stiffness[f, i, k]
        stress[k] = damped_stress(stiffness, strain[k], reference[k], damping)
    add_curl_stress(model, f, i, strain, stress)
    add_turn_guard_stress(model, f, i, strain, stress)
    for k in range(6):
        for a in range(6):
            right[at + a] -= stress[k] * gradient[k, a]
            right[at + row_size + a] -= stress[k] * gradient[k, 6 + a]


@loop_kernel
def _set_squares(stiffness, factor, gradient, matrix):
    """matrix (12, 12) = sum of factor k g g^T over six strains, gradient (6, 12)."""
    for a in range(12):
        x, y, z = spread(0.0), spread(0.0), spread(0.0)
        for k in range(6):
            scaled, g = factor * stiffness[k] * gradient[k, a], gradient[k]
            x, y, z = x + scaled * load(g, 0), y + scaled * load(g, 4), z + scaled * load(g, 8)
        put(matrix[a], 0, x)
        put(matrix[a], 4, y)
        put(matrix[a], 8, z)


@kernel
def _add_rachis_stiffness(model, f, i, damping, wanted, pose, beam, band):
    """Stiffness of the same element, whose gradient and stress are in beam."""
    row_size = band.shape[1] // 3
    at, gradient, matrix, stress = i * row_size, beam.gradient, beam.matrix, beam.stress
    start, end, halfway = pose.centre[i], pose.centre[i + 1], pose.halfway[i]
    length, stiffness = model.length[f, i], model.rachis_stiffness[f, i]
    _set_squares(stiffness, 1.0 + damping, gradient, matrix)
    strain = pose.strains.rachis[i]
    add_curl_stiffness(model, f, i, strain, wanted == WHOLE_STIFFNESS, gradient, matrix)
    add_turn_guard_stiffness(model, f, i, strain, gradient, matrix)
    if wanted == WHOLE_STIFFNESS:
        rachis_geometric_stiffness(start, end, length, halfway, pose.rachis[i], stress, matrix)
    else:
        rachis_stabilising_stiffness(start, end, length, halfway, stress, matrix)
    stride = band.shape[1] - 1
    for a in range(12):
        to = at + a if a < 6 else at + row_size + a - 6
        for b in range(a + 1):
            column = at + b if b < 6 else at + row_size + b - 6
            increase(band, column * stride + to, matrix[a, b])


@kernel
def _add_inertia(inertia, mass, stiff):
    """Inertia (1/s^2) times the masses, added to the stiffnesses (n, 1 + 2 m, 6) of the nodes."""
    for i in range(mass.shape[0]):
        for p in range(mass.shape[1]):
            for k in range(3):
                stiff[i, p, k] += inertia * mass[i, p]


@kernel
def _hold_root(wanted, system):
    """Take the six coordinates of row 0 out of the system: their increment is zero."""
    band = system.band
    for a in range(6):
        system.right[a] = 0.0
        if wanted == FORCES_ONLY:
            continue
        for d in range(band.shape[1]):
            band[a, d] = 0.0
        band[a, 0] = 1.0


@kernel
def _add_contacts(model, contacts, f, fraction, work):
    """Forces of contacts, and the stiffnesses of those that are not followed."""
    points = work.now.points.nodes
    add_contact_forces(contacts, f, fraction, points, work.force)
    _, last = followed_contacts(model, contacts, f)
    for c in range(last, contacts.first[f + 1]):
        presses = press(contacts, c, fraction, points) > 0.0
        add_contact_stiffness(contacts, c, presses, fraction, points, work.stiff)


@kernel
def _add_nodes(model, loads, f, fraction, factors, shift, work):
    """Forces and stiffnesses of single nodes to work.force and work.stiff."""
    points, around = work.now.points.nodes, work.around
    node_forces(model, loads, f, factors, points, around, work.force, work.stiff)
    if shift > 0.0:
        _add_inertia(shift * factors.inertia, model.mass[f], work.stiff)
    add_grip_forces(loads, f, fraction, points, work.force, work.stiff)
    add_dead_forces(loads, f, fraction, work.force)
    _add_contacts(model, loads.contacts, f, fraction, work)


@kernel
def _add_vane(model, f, damping, wanted, work):
    """Forces of barbs and vane, and their stiffness where it is wanted."""
    pose, reference, system = work.now, work.around.reference, work.system
    joint_axes(model.shapes, pose, work.axes)
    add_vane_forces(model, f, damping, wanted, pose, work.around, work.vane, work.force)
    subtract_barb_forces(model, f, damping, pose, reference, work.force, work.axes, system.right)
    if wanted == FORCES_ONLY:
        return
    add_crushed_hinges(model, f, damping, pose.strains, work.around, work.vane)
    barb_jacobians(model.shapes, pose, work.axes, work.jacobian)
    add_rows(model, f, damping, wanted == WHOLE_STIFFNESS, work)


@shared_kernel(None)
def assemble(model, loads, f, fraction, factors, wanted, shift, work):
    """Hessian of step_energy at the pose work.now to work.system.band, minus gradient to right.

    fraction: of the frame, for the grips. factors: of the integrator.
    wanted: WHOLE_STIFFNESS, with the geometric stiffness of compression: then the Hessian may be
    indefinite, but Newton converges where a vane wrinkles; STABILISING, without; FORCES_ONLY: right
    alone, the band stays as it is. shift: inertia that is added to the Hessian alone, as a part of
    the integrator's. Contacts that are followed (active_contact_kernels) are not in it.
    """
    pose, system, strains = work.now, work.system, work.around.reference
    rows, row_size = pose.rotation.shape[0], system.band.shape[1] // 3
    if wanted != FORCES_ONLY:
        system.band[:] = 0.0
    system.right[:] = 0.0
    _add_nodes(model, loads, f, fraction, factors, shift, work)
    if model.joints.shape[3] > 0:
        _add_vane(model, f, factors.vane_damping, wanted, work)
    rotary, directors, target = model.rotary_inertia[f], pose.points.directors, work.around.target
    for i in range(rows):
        at, inertia = i * row_size, factors.inertia
        accumulate(system.right[at:], -1.0, work.force[i, 0])
        subtract_director_moments(
            i, rotary, inertia, directors, target.directors, system.right[at + 3 :]
        )
        subtract_couple_moments(i, loads.couple[f], directors, system.right[at + 3 :])
        if wanted != FORCES_ONLY:
            _add_rachis_node(work.stiff[i, 0], at, system.band)
            shifted = (1.0 + shift) * inertia
            add_director_stiffness(i, rotary, shifted, directors, at + 3, system.band)
    for i in range(rows - 1):
        damping, reference = factors.rachis_damping, strains.rachis[i]
        _subtract_rachis_forces(model, f, i, damping, pose, reference, work.beam, system.right)
        if wanted != FORCES_ONLY:
            _add_rachis_stiffness(model, f, i, damping, wanted, pose, work.beam, system.band)
    if model.held[f]:
        _hold_root(wanted, system)


@kernel
def _left(stiffness, gaps, side, i, held, left):
    """(m,) stiffness of the hinges on row i's barb that open gaps leave: to left, or as it is where
    all gaps hold (held)."""
    if held:
        return stiffness
    for j in range(stiffness.shape[0]):
        left[j] = stiffness[j] * hinge_hold(gaps, side, i, j)
    return left


@kernel
def _left_twist(stiffness, gaps, side, i, held, left):
    """As _left, of the cells between rows i and i + 1."""
    if held:
        return stiffness
    for j in range(stiffness.shape[0]):
        left[j] = stiffness[j] * twist_hold(gaps, side, i, j)
    return left


@loop_kernel
def _fill_cells(model, place, damping, wanted, state, vane, cells):
    """The cells of a strip. place: feather, side and the row below them. state: strains, their
    reference, gaps, whether all hold and whether any triangle feels its guard."""
    (f, side, i), (strains, reference, gaps, held, pressed) = place, state
    strip = Strip(
        rest=model.cell_rest[f, side, i],
        stiffness=model.cell_stiffness[f, side, i],
        guard=model.cell_guard[f],
        pressed=pressed,
        strains=strains.cell[side, i],
        reference=reference.cell[side, i],
        held=held,
        gaps=row_of_gaps(model.hooks, f, side, i, gaps),
    )
    fill_strip(i, side, strip, damping, wanted, vane, cells)
    stiffness = model.twist_stiffness[f, side, i]
    twists = Twists(
        rest=model.twist_rest[f, side, i],
        stiffness=_left_twist(stiffness, gaps, side, i, held, vane.cells.left),
        twist=strains.twist[side, i],
        reference=reference.twist[side, i],
    )
    fill_twists(i, side, twists, damping, vane, cells)


@loop_kernel
def _fill_folds(model, place, damping, state, vane, cells):
    """As _fill_cells, the hinges on the row of a place."""
    (f, side, i), (strains, reference, gaps, held, _) = place, state
    hinges = Hinges(
        rest=model.hinge_rest[f, side, i],
        stiffness=_left(model.hinge_stiffness[f, side, i], gaps, side, i, held, vane.cells.left),
        angle=strains.hinge[side, i],
        openness=strains.openness[side, i],
        reference=reference.hinge[side, i],
    )
    fill_hinges(i, side, hinges, damping, vane, cells)


@shared_kernel(None)
def add_vane_forces(model, f, damping, wanted, pose, around, vane, force):
    """Membrane, hinges and twist of feather f: forces added to force (n, 1 + 2 m, 3), stiffness to
    vane.blocks.

    Row by row: first the cells above it and the hinges on the next one, then the sums at its own
    nodes, for which two strips and three rows of hinges are kept.

    around: StepEnvironment. wanted: FORCES_ONLY leaves the blocks as they are, STABILISING leaves
    out what of the geometric stiffness may be indefinite.
    """
    rows, strains, gaps = pose.rotation.shape[0], pose.strains, around.gaps
    held = all_hold(model, f, strains.cell, gaps)
    pressed = is_pressed(model.cell_guard[f], strains.cell)
    state = strains, around.reference, gaps, held, pressed
    nodes_to_lines(pose.points.nodes, vane.nodes)
    vane.pull[:] = 0.0
    strips, hinges, count = vane.cells.strips, vane.cells.hinges, lanes(strains.hinge.shape[2] + 1)
    for side in range(2):
        strips[1], hinges[:] = 0.0, 0.0
        if wanted != FORCES_ONLY:
            vane.blocks[0, side] = 0.0
        for i in range(rows):
            above, high = strips[i % 2], hinges[(i + 1) % 3]
            if i + 1 < rows:
                if wanted != FORCES_ONLY:
                    vane.blocks[i + 1, side] = 0.0
                _fill_cells(model, (f, side, i), damping, wanted, state, vane, above)
            else:
                above[:] = 0.0
            if i + 2 < rows:
                _fill_folds(model, (f, side, i + 1), damping, state, vane, high)
            else:
                high[:] = 0.0
            below, low, own = strips[(i + 1) % 2], hinges[(i + 2) % 3], hinges[i % 3]
            add_forces(count, below, above, low, own, high, vane.pull[i, side])
            if wanted != FORCES_ONLY:
                add_blocks(count, below, above, low, own, high, vane.blocks[i, side])
    add_lines_to_nodes(vane.pull, force)
