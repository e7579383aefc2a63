"""Bodies that touch: in islands, and in colours, so that no two of a colour touch."""

from __future__ import annotations

from featherfx.jit.compiled import kernel


@kernel
def _give_colour(body, low, touching, active, colours):
    """Give an active body the first colour that no active one before it has which it touches;
    returns it. low: where its part of the scratch begins."""
    first, near = touching
    colour, taken_by = colours.colour, colours.taken_by
    for at in range(first[body], first[body + 1]):
        if near[at] < body and active[near[at]] != 0:
            taken_by[low + colour[near[at]]] = body
    own = 0
    while taken_by[low + own] == body:
        own += 1
    colour[body] = own
    return own


@kernel
def colour_island(island, touching, marks, islands, colours):
    """Give the active bodies of an island (sweep_kernels.Marks, Islands) colours, the others -1;
    returns how many colours there are."""
    low, high, most = islands.first[island], islands.first[island + 1], 0
    for at in range(low, high):
        colours.taken_by[at] = -1
    for at in range(low, high):
        body = islands.bodies[at]
        colours.colour[body] = -1
        if marks.active[body] != 0:
            most = max(most, _give_colour(body, low, touching, marks.active, colours) + 1)
    return most


@kernel
def colour_some(touching, marks, islands, colours):
    """Put the active bodies of open islands (sweep_kernels.Marks, Islands) into colours
    (Colours)."""
    bodies, most = colours.colour.shape[0], 0
    for c in range(bodies + 1):
        colours.taken_by[c], colours.first[c] = -1, 0
    colours.first[bodies + 1] = 0
    for body in range(bodies):
        colours.colour[body], colours.done[body] = -1, 0
        if marks.active[body] == 0 or islands.open[marks.island[body]] == 0:
            continue
        own = _give_colour(body, 0, touching, marks.active, colours)
        colours.first[own + 2] += 1
        most = max(most, own + 1)
    for c in range(most):
        colours.first[c + 2] += colours.first[c + 1]
    for body in range(bodies):
        own = colours.colour[body]
        if own >= 0:
            colours.bodies[colours.first[own + 1]] = body
            colours.first[own + 1] += 1
    colours.number[0] = most
