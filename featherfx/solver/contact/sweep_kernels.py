"""Rounds of solves of feathers that touch, entirely compiled, by a team of threads.

In a round every body that is not done is solved anew from the interval's start, against the planes
of what it touches and with the forces that those felt last. Bodies of one colour do not touch each
other: the threads take them one by one, colour after colour, and wait for those of earlier colours
that a body touches. So no result depends on how many threads there are. What belongs together (an
island) has rounds of its own: it is done when all its contacts are solved, or after so many rounds.
A body that cannot be solved stays where it was last, and the others meet it as they meet a wall.
"""

from math import sqrt

import numpy as np

from featherfx.algebra.vector_kernels import copy_values
from featherfx.algebra.views import forget_tickets, meet, say_done, ticket, viewed, wait_for
from featherfx.jit.compiled import kernel
from featherfx.solver.contact.joint_kernels import choose_forces, find_weights, solve_forces
from featherfx.solver.contact.list_kernels import (
    closed_on_led,
    colour_island,
    colour_some,
    hand_out,
    hand_out_together,
    is_pressed,
    is_shared,
    measure,
    residual,
    share_pinch,
    take_felt,
    update,
)
from featherfx.solver.contact.types import HandoverRules
from featherfx.solver.scratch import SolverScratch, StoredMatrix
from featherfx.solver.step.frame_kernels import advance_feather
from featherfx.solver.step.newton_kernels import MAX_REUSE_ITERATIONS
from featherfx.solver.step.step_control_kernels import scale_settings, start_acceleration

# length of the last step of a feather that has none, but its first acceleration
_BEGUN = -1.0
# contacts, and bodies, that a thread takes at a time
_CONTACTS, _BODIES = 1024, 64
# rounds after which what pinches a body shares the depth that is left
_PATIENCE = 4
# part of what is off that forces solved together may leave, or they are handed on in the next round
_PROGRESS = 0.9
# way of what turns, over that of its nodes; how far a body is expected to go, over that one round
# before, where it was not solved since
_TURNING, _FADING = 2.0, 0.5
# what is off after such a round over that before, beyond which none follows
_WORSE = 4.0
# bodies of an island whose forces are solved together, at most
_MOST_TOGETHER = 32


@kernel
def _take(source, target, f):
    """Copy feather f of a state, by its rows, to another's."""
    for k in range(len(source)):
        copy_values(source[k][f], target[k][f])


@kernel
def _put(nodes, columns, to):
    """Write the nodes (n, 1 + 2 m, 3) of a body to its place on the widest grid; returns how far
    one goes at most, m."""
    ahead, shift, farthest = 1 + columns, (to.shape[1] - nodes.shape[1]) // 2, 0.0
    for i in range(nodes.shape[0]):
        for p in range(nodes.shape[1]):
            q, square = p if p < ahead else p + shift, 0.0
            for k in range(3):
                square += (nodes[i, p, k] - to[i, q, k]) ** 2
                to[i, q, k] = nodes[i, p, k]
            farthest = max(farthest, square)
    return sqrt(farthest)


@kernel
def _handing(beginning, sweep):
    given = sweep.handing
    return HandoverRules(
        given.friction, given.smoothing, given.reach, given.widest, given.columns, beginning
    )


@kernel
def _hand(body, f, planes, beginning, together, sweep):
    """Write the planes of a body's contacts where feather f of its batch finds them. together:
    whether forces are solved together in this round."""
    touch, listed, start, now = sweep.touch, sweep.listed, sweep.start, sweep.now
    handing = _handing(beginning, sweep)
    planes.first[f] = 0
    if together and not beginning:
        planes.first[f + 1] = hand_out_together(
            body, touch, listed, sweep.joint, start, now, handing, planes
        )
    else:
        planes.first[f + 1] = hand_out(
            body, touch, listed, sweep.marks, start, now, handing, planes
        )


@kernel
def _with_matrix(work, kept, f):
    """Work with the matrix that is kept of feather f."""
    own = StoredMatrix(kept.made[f], kept.plain[f], kept.pace[f])
    return SolverScratch(
        now=work.now,
        trial=work.trial,
        around=work.around,
        system=work.system,
        secants=work.secants,
        kept=own,
        spin=work.spin,
        coefficient_rate=work.coefficient_rate,
        vane=work.vane,
        force=work.force,
        stiff=work.stiff,
        axes=work.axes,
        jacobian=work.jacobian,
        beam=work.beam,
        gaps=work.gaps,
        history=work.history,
        closing=work.closing,
    )


@kernel
def _advance(body, thread, frame, together, sweep):
    """Solve one body from the interval's start, with the forces that it feels now. frame:
    StepSettings. together: of _hand. Returns whether it could be solved."""
    batches, marks = sweep.batches, sweep.marks
    g, f = batches.batch[body], batches.place[body]
    own = thread * batches.model.words.shape[0] + g
    model = viewed(batches.model, g)
    old = viewed(batches.old, g)
    new = viewed(batches.new, g)
    path = viewed(batches.path, g)
    loads = viewed(batches.loads, own)
    kept = viewed(batches.kept, g)
    work = _with_matrix(viewed(batches.work, own), kept.matrices, f)
    report = viewed(batches.report, g)
    settings = scale_settings(frame, model.length[f])
    if old.step[f] == 0.0:
        kept.matrices.pace[f] = 0.0
        _hand(body, f, loads.contacts, True, together, sweep)
        start_acceleration(model, loads, f, path, settings, old, work)
        old.step[f] = _BEGUN
    _hand(body, f, loads.contacts, False, together, sweep)
    _take(viewed(batches.rows_old, g), viewed(batches.rows_new, g), f)
    report.steps[f] = report.forced[f] = report.passed[f] = report.slipped[f] = 0.0
    report.error[f] = report.move[f] = 0.0
    before, begins = report.iterations[f], marks.solves[body] == 0
    if begins and kept.hard[f] != 0:
        kept.matrices.pace[f] = 0.0
    advance_feather(model, loads, f, path, new, settings, work, report)
    if begins:
        hard = report.iterations[f] - before > MAX_REUSE_ITERATIONS * max(1.0, report.steps[f])
        kept.hard[f] = 1 if hard else 0
    marks.solves[body] += 1
    if report.status[f] != 0.0:
        marks.mine[body] = 0
        return False
    marks.moves[body] = move = _put(new.points.nodes[f], model.joints.shape[3], sweep.now[body])
    marks.way[body] += _TURNING * move
    # the next try starts from this pose: rates that lead there
    copy_values(new.spin[f], old.spin[f])
    copy_values(new.coefficient_rate[f], old.coefficient_rate[f])
    length = frame.duration / report.steps[f]
    if length >= 0.999 * frame.shortest and not 0.0 < old.proposal[f] <= length:
        # in steps as long as were taken: longer ones would be rejected again
        old.proposal[f] = length
    if together:
        rules = _handing(False, sweep)
        planes = loads.contacts
        island = marks.island
        take_felt(body, sweep.touch, sweep.listed, island, sweep.joint, sweep.now, rules, planes)
    else:
        update(body, sweep.touch, sweep.listed, sweep.now, marks.way)
    first, near = sweep.touching
    marks.moved[body] = 1
    for at in range(first[body], first[body + 1]):
        marks.moved[near[at]] = 1
    return True


@kernel
def _solve(body, thread, sweep):
    """Solve one body: as a feather alone if nothing presses it, before as after.

    Bodies that press each other take the interval in one step: what both feel at its end is one
    impulse, equal and opposite.
    """
    touch, listed, marks = sweep.touch, sweep.listed, sweep.marks
    alone = not is_pressed(body, touch, listed, marks.way)
    if alone and not _advance(body, thread, sweep.alone, False, sweep):
        return
    if alone and not is_pressed(body, touch, listed, marks.way):
        return
    shared = is_shared(body, touch, listed, marks)
    _advance(body, thread, sweep.shared if shared else sweep.step, False, sweep)


@kernel
def _solve_after(body, thread, sweep):
    """Solve one body when all that it touches of earlier colours are solved in this round."""
    (first, near), colours = sweep.touching, sweep.colours
    for at in range(first[body], first[body + 1]):
        other = near[at]
        if 0 <= colours.colour[other] < colours.colour[body]:
            wait_for(colours.done, other, 1)
    _solve(body, thread, sweep)
    say_done(colours.done, body)


@kernel
def _measure(team, size, kind, sweep):
    """All contacts in the pose now."""
    count = sweep.contacts
    while True:
        low = _CONTACTS * ticket(team, kind)
        if low >= count:
            break
        measure(sweep.touch, low, min(low + _CONTACTS, count), sweep.now, sweep.marks.way)


@kernel
def _look(body, number, sweep):
    """Measure how far the contacts of a body are off after so many rounds, and whether it is solved
    again."""
    marks = sweep.marks
    marks.active[body], sweep.handing.reach[body] = 0, marks.moves[body]
    marks.moves[body] *= _FADING
    if marks.mine[body] == 0 or sweep.islands.open[marks.island[body]] == 0:
        return
    if marks.moved[body] != 0:
        marks.moved[body] = 0
        if number >= _PATIENCE:
            share_pinch(body, sweep.touch, sweep.listed, marks.mine)
        found = residual(body, sweep.touch, sweep.listed, marks.way)
        marks.worst[body], marks.open_by[body], marks.depth[body] = found
    again = marks.open_by[body] > 1.0
    if number == 0:
        again = again or marks.fresh[body] != 0
    marks.active[body] = 1 if again else 0


@kernel
def _judge(team, size, kind, number, sweep):
    """Measure how far the contacts of each body are off after so many rounds."""
    bodies = sweep.marks.mine.shape[0]
    while True:
        low = _BODIES * ticket(team, kind)
        if low >= bodies:
            break
        for body in range(low, min(low + _BODIES, bodies)):
            _look(body, number, sweep)


@kernel
def _close(island, number, sweep):
    """End an island that is done after so many rounds."""
    marks, islands, rules = sweep.marks, sweep.islands, sweep.rules
    anew = rules.friction and number == 1 and rules.rounds > 1
    before = islands.worst[island]
    islands.worst[island], islands.rounds[island] = 0.0, number
    low, high = islands.first[island], islands.first[island + 1]
    for at in range(low, high):
        body = islands.bodies[at]
        if marks.mine[body] == 0:
            continue
        worst = marks.open_by[body]
        if number == 0 and marks.fresh[body] != 0:
            worst = np.inf
        elif anew and closed_on_led(body, sweep.touch, sweep.listed, marks.mine):
            worst, marks.active[body] = np.inf, 1
        islands.worst[island] = max(islands.worst[island], worst)
    _join_forces(island, number, before, sweep)


@kernel
def _join_forces(island, number, before, sweep):
    """End the rounds of an island, or choose whether its forces are solved together in the next.
    before: what was off before the last."""
    marks, islands, joint = sweep.marks, sweep.islands, sweep.joint
    low, high, off = islands.first[island], islands.first[island + 1], islands.worst[island]
    were, joint.on[island] = joint.on[island], min(joint.on[island], 0)
    if number >= sweep.rules.rounds or off < 1.0:
        islands.open[island] = 0
        return
    if were > 0 and off > _WORSE * before:
        joint.on[island] = -1
    slow = were > 0 and off > _PROGRESS * before
    if number == 0 or joint.on[island] < 0 or slow or high - low > _MOST_TOGETHER:
        return
    if choose_forces(island, sweep):
        joint.on[island] = 1
        for at in range(low, high):
            marks.active[islands.bodies[at]] = marks.mine[islands.bodies[at]]


@kernel
def _measure_own(body, sweep):
    """Measure the contacts of a body."""
    for at in range(sweep.listed.first[body], sweep.listed.first[body + 1]):
        k = sweep.listed.items[at]
        measure(sweep.touch, k, k + 1, sweep.now, sweep.marks.way)


@kernel
def _solve_together(body, thread, sweep):
    """Solve one body with the forces that were solved together."""
    if sweep.joint.moves[body] != 0:
        _advance(body, thread, sweep.shared, True, sweep)


@kernel
def _solve_alone(island, thread, sweep):
    """All rounds of an island by one thread."""
    islands, colours, number = sweep.islands, sweep.colours, 0
    low, high = islands.first[island], islands.first[island + 1]
    while True:
        if sweep.joint.on[island] > 0:
            for at in range(low, high):
                _measure_own(islands.bodies[at], sweep)
        for at in range(low, high):
            _look(islands.bodies[at], number, sweep)
        _close(island, number, sweep)
        if islands.open[island] == 0:
            return
        number += 1
        if sweep.joint.on[island] > 0:
            for at in range(low, high):
                find_weights(islands.bodies[at], thread, sweep)
            solve_forces(island, sweep)
            for at in range(low, high):
                _solve_together(islands.bodies[at], thread, sweep)
            continue
        most = colour_island(island, sweep.touching, sweep.marks, islands, colours)
        for c in range(most):
            for at in range(low, high):
                if colours.colour[islands.bodies[at]] == c:
                    _solve(islands.bodies[at], thread, sweep)


@kernel
def _any_joint(on):
    """Return whether forces of an island were solved together in the last round."""
    found = False
    for each in on:
        found = found or each > 0
    return found


@kernel
def _join(team, size, thread, kind, count, sweep):
    """Solve the forces of the islands of this round that are solved together; returns the kind of
    tickets to go on with."""
    joint, islands, colours = sweep.joint, sweep.islands, sweep.colours
    while True:
        at = ticket(team, kind)
        if at >= count:
            break
        body = colours.bodies[at]
        if joint.on[sweep.marks.island[body]] > 0:
            find_weights(body, thread, sweep)
    meet(team, size)
    kind = 1 - kind
    if thread == 0:
        forget_tickets(team, 1 - kind)
        for island in range(islands.open.shape[0]):
            if islands.open[island] != 0 and joint.on[island] > 0:
                solve_forces(island, sweep)
    meet(team, size)
    return kind


@kernel
def solve_rounds(thread, team, size, sweep):
    """All rounds of all islands; each thread of a team of this size calls it, with its number."""
    kind, number, islands = 0, 0, sweep.islands
    _measure(team, size, kind, sweep)
    meet(team, size)
    kind = 1
    if thread == 0:
        forget_tickets(team, 0)
    while True:
        at = ticket(team, kind)
        if at >= islands.alone.shape[0]:
            break
        _solve_alone(islands.alone[at], thread, sweep)
    while True:
        meet(team, size)
        kind = 1 - kind
        if thread == 0:
            forget_tickets(team, 1 - kind)
        if _any_joint(sweep.joint.on):
            _measure(team, size, kind, sweep)
            meet(team, size)
            kind = 1 - kind
            if thread == 0:
                forget_tickets(team, 1 - kind)
        _judge(team, size, kind, number, sweep)
        meet(team, size)
        kind = 1 - kind
        if thread == 0:
            forget_tickets(team, 1 - kind)
            for island in range(islands.open.shape[0]):
                if islands.open[island] != 0:
                    _close(island, number, sweep)
            colour_some(sweep.touching, sweep.marks, islands, sweep.colours)
        meet(team, size)
        colours = sweep.colours
        if colours.number[0] == 0:
            return
        number += 1
        count = colours.first[colours.number[0]]
        kind = _join(team, size, thread, kind, count, sweep)
        while True:
            at = ticket(team, kind)
            if at >= count:
                break
            body = colours.bodies[at]
            if sweep.joint.on[sweep.marks.island[body]] > 0:
                _solve_together(body, thread, sweep)
            else:
                _solve_after(body, thread, sweep)
