"""The centreline of a ribbon from its curvatures, and the energy of dead loads on it.

    r' = d3,  di' = (c d1 + t c d3) x di  (d1 across the strip, d2 its normal, d3 its tangent)

The strip is cut into N short links. Between two links it turns by half the twist about the tangent,
by the bending angle about its width, and by the other half of the twist: three hinges, second
order in the link length. For hinges with axes a at places p,

    W = - sum of f . x,  dW / d angle_i = - a_i . sum over x beyond i of (x - p_i) x f
    d2W / d angle_i d angle_j = - f . (a_i x (a_j x (x - p_j)))  for i before j

exactly, so gradient and Hessian are those of the discrete energy. N is free of the number of
unknowns; links cost time, not conditioning.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import accumulate

import numpy as np
from numpy.typing import NDArray

from featherfx.lab.ribbons.energy import Ribbon

Array = NDArray[np.float64]

LINKS = 8


@dataclass(frozen=True)
class Curve:
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
    """(N, elements + 1) weights of the stations' values in those of the joints."""
    place = (np.arange(links * ribbon.elements) + 0.5) / links
    low = place.astype(np.int64)
    weights = np.zeros((len(place), ribbon.elements + 1))
    rows = np.arange(len(place))
    weights[rows, low] = 1.0 - (place - low)
    weights[rows, low + 1] = place - low
    return weights


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


def centreline(ribbon: Ribbon, unknowns: Array, frame: Array, links: int = LINKS) -> Curve:
    """The curve of given unknowns (curvature, then ruling), clamped at the origin.

    frame: (3, 3) columns across, normal, along at the clamp.
    """
    size = ribbon.elements + 1
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
    return Curve(points, frames, points[:-1] + before, axes)


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
    ribbon: Ribbon, unknowns: Array, curve: Curve, points: Array, force: Array, links: int = LINKS
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
    own = jacobian.T @ (np.einsum("jk,jk->j", axes, second)[:, None] * jacobian)
    matrix = half + half.T - own
    # the twist is a product of two unknowns
    size, step = ribbon.elements + 1, link_lengths(ribbon, links)[:, None]
    weights = interpolation(ribbon, links)
    mixed = weights.T @ (0.5 * step * (slope[:, :1] + slope[:, 2:]) * weights)
    matrix[:size, size:] += mixed
    matrix[size:, :size] += mixed.T
    return jacobian.T @ slope.ravel(), matrix


def slopes_of_points(curve: Curve, points: Array) -> Array:
    """(P, 3, 3 N), how points move with the hinges' angles; points: as of slopes_of_loads."""
    away = points[:, None, :] - curve.joints[None]
    moves = np.cross(curve.axes[None], away[:, :, None, :])
    beyond = np.arange(len(points))[:, None] > np.arange(len(curve.joints))[None]
    moves *= beyond[:, :, None, None]
    return np.moveaxis(moves.reshape(len(points), -1, 3), 1, 2)


def angle_slopes(ribbon: Ribbon, unknowns: Array, links: int) -> Array:
    """(3 N, U) of the hinges' angles (twist / 2, bend, twist / 2) by the unknowns."""
    size = ribbon.elements + 1
    weights = interpolation(ribbon, links)
    c, t = weights @ unknowns[:size], weights @ unknowns[size:]
    step = link_lengths(ribbon, links)[:, None]
    by_c = step * np.stack([0.5 * t, np.ones_like(t), 0.5 * t], axis=1)
    by_t = step * np.stack([0.5 * c, np.zeros_like(c), 0.5 * c], axis=1)
    lines = [(by[:, :, None] * weights[:, None, :]).reshape(-1, size) for by in (by_c, by_t)]
    return np.concatenate(lines, axis=1)
