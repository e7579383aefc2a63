"""Stresses of damped strains at the end of a step, and the history that they depend on.

A material whose loss hardly depends on the frequency (solver/damping) is a Maxwell model of B
branches, springs in series with dashpots, and a dashpot of a time t alone. Of a strain s with the
stiffness k at rest,

    stress = k (s + t ds/dt + sum_i g_i (s - v_i)),      dv_i/dt = (s - v_i) / t_i

v_i the strain of dashpot i, g_i its spring over k, t_i its time. ds/dt is the backward difference
over two steps, c / h (s - (a s_0 - b s_1) / c). Where s changes evenly from s_0 to s over a step of
h, the branches are solved exactly:

    s - v_i = p_i (s - s_0) + a_i (s_0 - v_i0),      a_i = exp(-h / t_i),  p_i = (1 - a_i) t_i / h

so that at the end of the step, with no unknown beside those of s,

    stress = k (s + q (s - r)),      q = t c / h + sum g_i p_i

Branches are second order in h, and r lies between strains of before, as p_i >= a_i. To a vibration
of phase w a step a branch gives k g p (1 - z) / (1 - a z), z = exp(-i w), whose imaginary part has
the sign of p (1 - a) sin(w): it takes energy at every length of step (derived here).
"""

from math import exp, expm1

from featherfx.algebra.vector_kernels import copy_values
from featherfx.algebra.views import shaped
from featherfx.jit.compiled import kernel
from featherfx.solver.step.strain_kernels import copy_strains, strains_at


@kernel
def _decay(h, time):
    """Return a and p of a branch of a time (s) over a step of h (s)."""
    if h <= 0.0:
        return 1.0, 1.0
    return exp(-h / time), -expm1(-h / time) * time / h


@kernel
def _difference_weights(h, before):
    """(a, b, c) of the backward difference; before: s, of the last step, 0 for the one-step one."""
    if before <= 0.0:
        return 1.0, 0.0, 1.0
    r = h / before
    return 1.0 + r, r * r / (1.0 + r), (1.0 + 2.0 * r) / (1.0 + r)


@kernel
def difference_rate(h, before):
    """Return c / h of the backward difference, 1/s."""
    return _difference_weights(h, before)[2] / h


@kernel
def damping_over(model, f, part, h, before):
    """Return q of the rachis (part 0) or the vane (1) of feather f over a step of h (s).

    before: s, of the step before it, 0 for a difference over one step.
    """
    total = model.retardation[f, part] * difference_rate(h, before)
    for i in range(model.relaxation_time.shape[2]):
        _, passed = _decay(h, model.relaxation_time[f, part, i])
        total += model.relaxation_weight[f, part, i] * passed
    return total


@kernel
def set_reference(model, f, part, steps, span, history, reference):
    """Set r of strains of part 0 or 1.

    steps: (h, before) of damping_over. history: (2 + B, ...), strains at the step's start, at that
    of the last one, and of the dashpots. reference: (...). span: first and last of those that are
    set, in order.
    """
    (first, last), (h, before), count = span, steps, reference.size
    past, out = shaped(history, (history.shape[0], count)), shaped(reference, (count,))
    start, out = past[0, first:last], out[first:last]
    _, b, c = _difference_weights(h, before)
    whole = damping_over(model, f, part, h, before)
    own = model.retardation[f, part] * (c / h) / whole if whole > 0.0 else 1.0
    copy_values(start, out)
    _move(-own * b / c, start, past[1, first:last], out)
    for i in range(model.relaxation_time.shape[2] if whole > 0.0 else 0):
        decayed, _ = _decay(h, model.relaxation_time[f, part, i])
        pull = model.relaxation_weight[f, part, i] * decayed / whole
        _move(pull, start, past[2 + i, first:last], out)


@kernel
def _move(part, start, end, out):
    """Add a part of the way from start to end to out, all (.,)."""
    for k in range(out.size):
        out[k] += part * (end[k] - start[k])


@kernel
def relax(model, f, part, h, span, now, history, out):
    """Set the strains of dashpots at the end of a step of h (s) that ends with strains now, in out,
    which may be the history; others as in set_reference."""
    count = now.size
    past, end = shaped(history, (history.shape[0], count)), shaped(now, (count,))
    to, (first, last) = shaped(out, (history.shape[0], count)), span
    for i in range(model.relaxation_time.shape[2]):
        decayed, passed = _decay(h, model.relaxation_time[f, part, i])
        for k in range(first, last):
            start = past[0, k]
            lag = passed * (end[k] - start) + decayed * (start - past[2 + i, k])
            to[2 + i, k] = end[k] - lag


@kernel
def _set_whole_reference(model, f, part, steps, history, reference):
    set_reference(model, f, part, steps, (0, reference.size), history, reference)


@kernel
def set_reference_strains(model, f, steps, history, reference):
    """As set_reference, of all strains of feather f."""
    _set_whole_reference(model, f, 0, steps, history.rachis, reference.rachis)
    _set_whole_reference(model, f, 1, steps, history.barb, reference.barb)
    _set_whole_reference(model, f, 1, steps, history.cell, reference.cell)
    _set_whole_reference(model, f, 1, steps, history.hinge, reference.hinge)
    _set_whole_reference(model, f, 1, steps, history.twist, reference.twist)


@kernel
def _relax_whole(model, f, part, h, now, history, out):
    relax(model, f, part, h, (0, now.size), now, history, out)


@kernel
def relax_strains(model, f, h, now, history, out):
    """As relax, of all strains of feather f."""
    _relax_whole(model, f, 0, h, now.rachis, history.rachis, out.rachis)
    _relax_whole(model, f, 1, h, now.barb, history.barb, out.barb)
    _relax_whole(model, f, 1, h, now.cell, history.cell, out.cell)
    _relax_whole(model, f, 1, h, now.hinge, history.hinge, out.hinge)
    _relax_whole(model, f, 1, h, now.twist, history.twist, out.twist)


@kernel
def relax_fully(history):
    """Put the dashpots of a feather where its strains are."""
    for i in range(1, history.rachis.shape[0]):
        copy_strains(strains_at(history, 0), strains_at(history, i))
