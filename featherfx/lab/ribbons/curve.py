"""The centreline of a ribbon from its curvatures, and the energy of dead loads on it.

    r' = d3,  di' = (c d1 + t c d3) x di  (d1 across the strip, d2 its normal, d3 its tangent)

The strip is cut into N short links. Between two links it turns by half the twist about the tangent,
by the bending angle about its width, and by the other half of the twist: three hinges, second
order in the link length. For hinges with axes a at places p,

    W = - sum of f . x,  dW / d angle_i = - a_i . sum over x beyond i of (x - p_i) x f
    d2W / d angle_i d angle_j = - f . (a_i x (a_j x (x - p_j)))  for i before j

exactly, so gradient and Hessian are those of the discrete energy. N is free of the number of
unknowns; links cost time, not conditioning.

Or it is made of power series:

    R' = R [w]x,  r' = R e_z,  w = (c, 0, t c),  c and t of degree p in the arc length
    n R_n = R_n-1 [w_0]x + R_n-2 [w_1]x + ... + R_n-1-2p [w_2p]x,   r_n = R_n-1 e_z / n

on pieces of an element so short that no term of a series is larger than e^TURN: then nothing is
lost where terms of both signs add up. With the derivatives of the same recurrence by the
coefficients of a piece, gradient and Hessian are exact: a piece moves all beyond it as a rigid
body, by its own derivatives. Source: Charrondiere et al. 2019, sections 3.2 and 3.3.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from itertools import accumulate

import numpy as np
from scipy.special import binom

from featherfx.algebra.types import Array, Indices
from featherfx.algebra.vectors import dots
from featherfx.lab.ribbons.energy import Ribbon, monomials, values_at

LINKS = 8


@dataclass(frozen=True)
class Centreline:
    """A ribbon's centreline in space.

    points: (N + 1, 3) m from clamp to tip. frames: (N + 1, 3, 3) columns
    across the strip, normal to it and along it. joints: (N, 3) m. axes: (N, 3, 3) the three hinge
    axes of every joint, as rows.
    """

    points: Array
    frames: Array
    joints: Array
    axes: Array


def interpolation(ribbon: Ribbon, links: int) -> Array:
    """(links elements, N) weights of the nodes' values in those of the joints."""
    shapes = values_at(ribbon.degree, (np.arange(links) + 0.5) / links)
    weights = np.zeros((ribbon.elements, links, ribbon.nodes))
    every, own = np.arange(ribbon.elements)[:, None, None], ribbon.own_nodes()
    weights[every, np.arange(links)[:, None], own[:, None]] = shapes
    return weights.reshape(-1, ribbon.nodes)


def link_lengths(ribbon: Ribbon, links: int) -> Array:
    """(N,) m, equal within an element."""
    return np.repeat(np.diff(ribbon.stations) / links, links)


def _about(axis: int, angle: Array) -> Array:
    """(N, 3, 3) rotations about an axis."""
    first, second = (axis + 1) % 3, (axis + 2) % 3
    rotation = np.tile(np.eye(3), (len(angle), 1, 1))
    rotation[:, first, first] = rotation[:, second, second] = np.cos(angle)
    rotation[:, second, first] = sine = np.sin(angle)
    rotation[:, first, second] = -sine
    return rotation


def centreline(ribbon: Ribbon, unknowns: Array, frame: Array, links: int) -> Centreline:
    """The curve of given unknowns (curvature, then ruling), clamped at the origin.

    frame: (3, 3) columns across, normal, along at the clamp.
    """
    size = ribbon.nodes
    weights = interpolation(ribbon, links)
    curvature, ruling = weights @ unknowns[:size], weights @ unknowns[size:]
    steps = link_lengths(ribbon, links)
    half = _about(2, 0.5 * steps * curvature * ruling)
    turns = half @ _about(0, steps * curvature) @ half
    frames = np.array(list(accumulate(turns, np.matmul, initial=np.asarray(frame, dtype=float))))
    bends = (frames[:-1] @ half)[:, :, 0]
    axes = np.stack([frames[:-1, :, 2], bends, frames[1:, :, 2]], axis=1)
    before, after = 0.5 * steps[:, None] * axes[:, 0], 0.5 * steps[:, None] * axes[:, 2]
    points = np.concatenate([np.zeros((1, 3)), np.cumsum(before + after, axis=0)])
    return Centreline(points, frames, points[:-1] + before, axes)


def link_masses(ribbon: Ribbon, links: int = LINKS) -> Array:
    """(N + 1,) kg, at the curve's points."""
    step = link_lengths(ribbon, links)
    ends = np.concatenate([[0.0], np.cumsum(step)])
    # exact integrals of the linear width with the hats of the points
    width = ribbon.width_at(ends)
    mass = np.zeros(len(ends))
    mass[:-1] += step * (2.0 * width[:-1] + width[1:]) / 6.0
    mass[1:] += step * (width[:-1] + 2.0 * width[1:]) / 6.0
    return ribbon.surface_density * mass


def work_of_loads(
    ribbon: Ribbon, unknowns: Array, frame: Array, force: Array, links: int = LINKS
) -> tuple[float, Array, Array]:
    """Energy (J) of dead forces (N + 1, 3) N at the curve's points, gradient, Hessian."""
    curve = centreline(ribbon, unknowns, frame, links)
    energy = -float(np.sum(force * curve.points))
    return energy, *slopes_of_loads(ribbon, unknowns, curve, curve.points, force, links)


def slopes_of_loads(
    ribbon: Ribbon,
    unknowns: Array,
    curve: Centreline,
    points: Array,
    force: Array,
    links: int = LINKS,
) -> tuple[Array, Array]:
    """Gradient (U,) and Hessian (U, U) of their energy.

    points: (P, 3) m, the curve's and any that are fixed to its last link. force: (P, 3) N.
    """
    joints = len(curve.joints)
    # sums over the points beyond a joint: those after it
    total = np.cumsum(force[::-1], axis=0)[::-1][1 : joints + 1]
    moment = np.einsum("qm,qn->qmn", force, points)
    lever = np.cumsum(moment[::-1], axis=0)[::-1][1 : joints + 1]
    lever = lever - np.einsum("jm,jn->jmn", total, curve.joints)
    # couple of joint j: sum of (x - p) x f, from lever[m, n] = sum of f_m (x - p)_n
    couple = np.stack(
        [
            lever[:, 2, 1] - lever[:, 1, 2],
            lever[:, 0, 2] - lever[:, 2, 0],
            lever[:, 1, 0] - lever[:, 0, 1],
        ],
        axis=1,
    )
    slope = -np.einsum("jak,jk->ja", curve.axes, couple)
    trace = np.einsum("jkk->j", lever)
    second = trace[:, None, None] * curve.axes - np.einsum("jmn,jam->jan", lever, curve.axes)
    # by the angles it is axes_i . second_j for i before j: of rank 3, so sums of what is before do
    axes, second = curve.axes.reshape(-1, 3), second.reshape(-1, 3)
    jacobian = angle_slopes(ribbon, unknowns, links)
    before = np.cumsum(axes[:, :, None] * jacobian[:, None, :], axis=0)
    half = np.einsum("jku,jk->ju", before, second).T @ jacobian
    own = jacobian.T @ (dots(axes, second)[:, None] * jacobian)
    matrix = half + half.T - own
    # the twist is a product of two unknowns
    size, step = ribbon.nodes, link_lengths(ribbon, links)[:, None]
    weights = interpolation(ribbon, links)
    mixed = weights.T @ (0.5 * step * (slope[:, :1] + slope[:, 2:]) * weights)
    matrix[:size, size:] += mixed
    matrix[size:, :size] += mixed.T
    return jacobian.T @ slope.ravel(), matrix


def slopes_of_points(curve: Centreline, points: Array) -> Array:
    """(P, 3, 3 N), how points move with the hinges' angles; points: as of slopes_of_loads."""
    away = points[:, None, :] - curve.joints[None]
    moves = np.cross(curve.axes[None], away[:, :, None, :])
    beyond = np.arange(len(points))[:, None] > np.arange(len(curve.joints))[None]
    moves *= beyond[:, :, None, None]
    return np.moveaxis(moves.reshape(len(points), -1, 3), 1, 2)


def angle_slopes(ribbon: Ribbon, unknowns: Array, links: int) -> Array:
    """(3 N, U) of the hinges' angles (twist / 2, bend, twist / 2) by the unknowns."""
    size = ribbon.nodes
    weights = interpolation(ribbon, links)
    c, t = weights @ unknowns[:size], weights @ unknowns[size:]
    step = link_lengths(ribbon, links)[:, None]
    by_c = step * np.stack([0.5 * t, np.ones_like(t), 0.5 * t], axis=1)
    by_t = step * np.stack([0.5 * c, np.zeros_like(c), 0.5 * c], axis=1)
    lines = [(by[:, :, None] * weights[:, None, :]).reshape(-1, size) for by in (by_c, by_t)]
    return np.concatenate(lines, axis=1)


# rad, of a piece at most; terms of its series of degree 1, of which the next is below rounding, and
# more for each degree above
MAX_PIECE_TURN, _TERMS, _MORE_TERMS = 1.0, 20, 15
# [e_a]x
_CROSS = np.zeros((3, 3, 3))
for _a, _b, _c in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
    _CROSS[_a, _c, _b], _CROSS[_a, _b, _c] = 1.0, -1.0


@lru_cache
def _twist(degree: int) -> Array:
    """(2 degree + 1, V, V) second derivatives of t c, by the powers of the place, by the values of
    a piece."""
    found, each = np.zeros((2 * degree + 1, 2 * degree + 2, 2 * degree + 2)), degree + 1
    for i in range(each):
        for j in range(each):
            found[i + j, i, each + j] = found[i + j, each + j, i] = 1.0
    return found


@dataclass(frozen=True)
class CurvePieces:
    """length: (P,) m. values: (P, V) coefficients of c, then of t, by powers of the place from 0 to
    1. to_unknowns: (P, V, U) of these values. width: (P, 2) m, at the begin and its growth."""

    length: Array
    values: Array
    to_unknowns: Array
    width: Array


def pieces_of(ribbon: Ribbon, unknowns: Array, least: int = 1) -> CurvePieces:
    """Pieces that turn by TURN at most, whatever the signs of their coefficients; least: of an
    element."""
    shapes = values_at(ribbon.degree, np.linspace(0.0, 1.0, 4 * ribbon.degree - 2))
    nodal = unknowns.reshape(2, -1)[:, ribbon.own_nodes()]
    curvature, ruling = nodal @ shapes.T
    turn = (np.abs(curvature) * np.sqrt(1.0 + ruling**2)).max(axis=1)
    wanted = np.ceil(np.diff(ribbon.stations) * turn / MAX_PIECE_TURN - 1e-9).astype(np.int64)
    counts = np.maximum(wanted, least)
    while True:
        pieces = _cut(ribbon, unknowns, counts)
        c, t = np.abs(pieces.values).reshape(-1, 2, ribbon.degree + 1).sum(axis=2).T
        turn = pieces.length * c * np.sqrt(1.0 + t**2)
        many = np.maximum.reduceat(turn, np.cumsum(counts) - counts) > MAX_PIECE_TURN + 1e-9
        if not many.any():
            return pieces
        counts = np.where(many, 2 * counts, counts)


def _cut(ribbon: Ribbon, unknowns: Array, counts: Indices) -> CurvePieces:
    """So many equal pieces of each element."""
    size, step, own = ribbon.nodes, np.diff(ribbon.stations), ribbon.own_nodes()
    element = np.repeat(np.arange(ribbon.elements), counts)
    fraction = 1.0 / counts[element]
    place = (np.arange(len(element)) - (np.cumsum(counts) - counts)[element]) * fraction
    rows, each = np.arange(len(element))[:, None, None], ribbon.degree + 1
    # of (begin + fraction u)^m the coefficients by powers of u
    power, k = np.arange(each), np.arange(each)[:, None]
    moved_on = binom(power, k) * place[:, None, None] ** np.maximum(power - k, 0)
    lines = moved_on * fraction[:, None, None] ** k @ monomials(ribbon.degree)
    to_unknowns = np.zeros((len(element), 2 * each, 2 * size))
    for first, column in ((0, own[element]), (each, size + own[element])):
        to_unknowns[rows, first + k, column[:, None]] = lines
    length = step[element] * fraction
    begin = ribbon.stations[element] + place * step[element]
    width = ribbon.width_at(np.stack([begin, begin + length], axis=1))
    width[:, 1] -= width[:, 0]
    return CurvePieces(length, to_unknowns @ unknowns, to_unknowns, width)


@dataclass(frozen=True)
class Moved:
    """Motion of pieces, by order of the derivative: none, by one of their values, by two.

    turn: (P, ..., 3, 3) of their frame. end: (P, ..., 3) m, from begin to end, in the frame of the
    begin. moment: (P, ..., 3) kg m, of their mass about the begin, the same.
    """

    turn: Array
    end: Array
    moment: Array


def moved(ribbon: Ribbon, pieces: CurvePieces, orders: int = 2) -> list[Moved]:
    """Pieces, and their first and second derivatives by their values, up to an order."""
    count, h = len(pieces.length), pieces.length
    twist, each = _twist(ribbon.degree), ribbon.degree + 1
    by_one = np.zeros((len(twist), count, 2 * each, 3))
    by_one[range(each), :, range(each), 0] = 1.0
    by_one[..., 2] = np.einsum("kij,pj->kpi", twist, pieces.values)
    spin = np.zeros((len(twist), count, 3))
    spin[:each, :, 0] = pieces.values[:, :each].T
    spin[..., 2] = 0.5 * np.einsum("kpi,pi->kp", by_one[..., 2], pieces.values)
    by_two = np.zeros((*twist.shape, 3))
    by_two[..., 2] = twist
    terms_of = _TERMS + _MORE_TERMS * (ribbon.degree - 1)
    zero, one, two = (np.einsum("...a,aij->...ij", w, _CROSS) for w in (spin, by_one, by_two))
    zero, one = zero * h[:, None, None], one * h[:, None, None, None]
    two = two[:, None] * h[:, None, None, None, None]
    now = [
        [np.broadcast_to(np.eye(3), (count, 3, 3))],
        [np.zeros((count, 2 * each, 3, 3))],
        [np.zeros((count, 2 * each, 2 * each, 3, 3))],
    ][: orders + 1]
    for n in range(1, terms_of):
        terms = [np.zeros_like(known[0]) for known in now]
        for k in range(min(n, len(twist))):
            r0, *more = (known[n - 1 - k] for known in now)
            terms[0] += r0 @ zero[k]
            if more:
                terms[1] += more[0] @ zero[k][:, None] + r0[:, None] @ one[k]
            if len(more) > 1:
                mixed = np.einsum("piab,pjbc->pijac", more[0], one[k])
                terms[2] += more[1] @ zero[k][:, None, None] + r0[:, None, None] @ two[k]
                terms[2] += mixed + np.swapaxes(mixed, 1, 2)
        for known, term in zip(now, terms, strict=True):
            known.append(term / n)
    found = []
    for terms in now:
        powers = np.array(terms)
        power = np.arange(terms_of).reshape(-1, *(1,) * (powers.ndim - 2))
        along = powers[..., 2] / (power + 1)
        wide = (slice(None), *(None,) * (powers.ndim - 3))
        width, wider = pieces.width[:, 0][wide], pieces.width[:, 1][wide]
        mass = along * (width / (power + 2) + wider / (power + 3))
        moment = ribbon.surface_density * (h**2)[wide] * mass.sum(axis=0)
        found.append(Moved(powers.sum(axis=0), h[wide] * along.sum(axis=0), moment))
    return found


def piece_masses(ribbon: Ribbon, pieces: CurvePieces) -> Array:
    """(P,) kg."""
    mean = pieces.width[:, 0] + 0.5 * pieces.width[:, 1]
    return np.asarray(ribbon.surface_density * pieces.length * mean)


def placed(turn: Array, end: Array, frame: Array) -> tuple[Array, Array]:
    """Frames (P + 1, 3, 3) and places (P + 1, 3) m of the ends of pieces, clamped at the origin."""
    frames, places = [np.asarray(frame, float)], [np.zeros(3)]
    for turned, way in zip(turn, end, strict=True):
        places.append(places[-1] + frames[-1] @ way)
        frames.append(frames[-1] @ turned)
    return np.array(frames), np.array(places)


def energy_of_loads(
    ribbon: Ribbon, unknowns: Array, frame: Array, gravity: Array, tip_force: Array
) -> tuple[float, Array, Array]:
    """Energy (J) of weight and of a dead force (N) at the tip, gradient (U,), Hessian (U, U)."""
    pieces = pieces_of(ribbon, unknowns)
    plain, first, second = moved(ribbon, pieces)
    frames, places = placed(plain.turn, plain.end, frame)
    begin, mass, count = frames[:-1], piece_masses(ribbon, pieces), len(pieces.length)
    centre = mass[:, None] * places[:-1] + np.einsum("pab,pb->pa", begin, plain.moment)
    energy = -float(gravity @ centre.sum(axis=0) + tip_force @ places[-1])
    # load beyond each piece, and sum of way from its end times force, in the frame of its end
    beyond = np.append(np.cumsum(mass[:0:-1])[::-1], 0.0)[:, None] * gravity + tip_force
    tensor, levers = np.zeros((3, 3)), np.zeros((count, 3, 3))
    for p in range(count - 1, -1, -1):
        levers[p] = frames[p + 1].T @ tensor
        moment = np.outer(begin[p] @ plain.moment[p], gravity)
        tensor = tensor + moment + np.outer(places[p + 1] - places[p], beyond[p])
    end, moment = (np.einsum("pab,pib->pia", begin, each) for each in (first.end, first.moment))
    turn = np.einsum("pab,pibc->piac", begin, first.turn)
    slope = -(moment @ gravity + np.einsum("pia,pa->pi", end, beyond))
    slope -= np.einsum("piab,pba->pi", turn, levers)
    own = -np.einsum("pijb,pab,a->pij", second.moment, begin, gravity)
    own -= np.einsum("pijb,pab,pa->pij", second.end, begin, beyond)
    own -= np.einsum("pijbc,pab,pca->pij", second.turn, begin, levers)
    # rotation vectors by the values of a piece; couples of what it moves, for pieces before it
    spun = np.einsum("piac,pbc->piab", turn, frames[1:])
    axis = np.stack([spun[..., 2, 1], spun[..., 0, 2], spun[..., 1, 0]], axis=-1)
    swept = np.einsum("piab,pbc->piac", turn, levers)
    couple = np.cross(moment, gravity) + np.cross(end, beyond[:, None])
    couple += np.stack(
        [
            swept[..., 1, 2] - swept[..., 2, 1],
            swept[..., 2, 0] - swept[..., 0, 2],
            swept[..., 0, 1] - swept[..., 1, 0],
        ],
        axis=-1,
    )
    whole = -np.einsum("pia,qja->piqj", axis, couple)
    before = np.arange(count)[:, None] < np.arange(count)[None]
    whole = np.where(before[:, None, :, None], whole, 0.0)
    whole = whole + whole.transpose(2, 3, 0, 1)
    whole[np.arange(count), :, np.arange(count)] += own
    lines = pieces.to_unknowns.reshape(slope.size, -1)
    hessian = lines.T @ whole.reshape(slope.size, slope.size) @ lines
    return energy, lines.T @ slope.ravel(), hessian


def energy_alone(
    ribbon: Ribbon, unknowns: Array, frame: Array, gravity: Array, tip_force: Array
) -> float:
    """Energy (J) of weight and of a dead force (N) at the tip."""
    pieces = pieces_of(ribbon, unknowns)
    (plain,) = moved(ribbon, pieces, 0)
    frames, places = placed(plain.turn, plain.end, frame)
    centre = piece_masses(ribbon, pieces) @ places[:-1]
    centre = centre + np.einsum("pab,pb->a", frames[:-1], plain.moment)
    return -float(gravity @ centre + tip_force @ places[-1])


def series_points(ribbon: Ribbon, unknowns: Array, frame: Array, each: int) -> tuple[Array, Array]:
    """Points (N + 1, 3) m and frames (N + 1, 3, 3) of the centreline, `each` an element or more."""
    (plain,) = moved(ribbon, pieces_of(ribbon, unknowns, each), 0)
    frames, places = placed(plain.turn, plain.end, frame)
    return places, frames
