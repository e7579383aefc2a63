"""Planar networks under large strain: Newton's method from one shear to the next.

    E = sum over segments of EA l / 2 (L / l - 1)^2 + sum over bend triplets of EI / r turn^2

L length of a segment, turn the change of the angle between a triplet's segments; for small strain
that is network.py. Houghton 2020, section 7.1, leaves it as work to do.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy import sparse

from featherfx.errors import SimulationError
from featherfx.lab.networks.layouts import Layout
from featherfx.lab.networks.network import Array, Indices, factor_of

# iterations, halvings of a step, and a step over the width that is the last
ITERATIONS, HALVINGS, CLOSE = 200, 20, 1e-9
# share of the diagonal that keeps the matrix regular; it only shortens steps
GROUND = 1e-9


class _Pose(NamedTuple):
    """energy: J. gradient: (2 N,) N. matrix: (2 N, 2 N) N/m, without what compression takes off."""

    energy: float
    gradient: Array
    matrix: sparse.csr_array


def sheared_energies(layout: Layout, shears: Array) -> Array:
    """(n,) J, at rest, with the held nodes moved along x by shears (n,) times their height.

    Raises SimulationError where a shear has no rest.
    """
    free = np.setdiff1d(np.arange(layout.network.nodes), layout.held)
    inner = (2 * free[:, None] + np.arange(2)).ravel()
    moved, last, found = np.zeros(2 * layout.network.nodes), 0.0, []
    for shear in shears:
        moved[::2] += (shear - last) * layout.places[:, 1]
        moved, energy = _rest(layout, moved, inner)
        last = float(shear)
        found.append(energy)
    return np.array(found)


def _rest(layout: Layout, moved: Array, inner: Indices) -> tuple[Array, float]:
    pose = _pose(layout, moved)
    for _ in range(ITERATIONS):
        matrix = pose.matrix[inner][:, inner]
        ground = sparse.diags_array(GROUND * matrix.diagonal() + 1e-300)
        step = np.zeros_like(moved)
        step[inner] = -factor_of(matrix + ground).solve(pose.gradient[inner])
        slope = float(pose.gradient @ step)
        share = 1.0
        for _ in range(HALVINGS):
            trial = _pose(layout, moved + share * step)
            if trial.energy <= pose.energy + 1e-4 * share * slope + 1e-15 * pose.energy:
                break
            share *= 0.5
        moved, pose = moved + share * step, trial
        if np.abs(share * step).max() < CLOSE * layout.size.max():
            return moved, pose.energy
    raise SimulationError("network", 0.0, f"no rest in {ITERATIONS} iterations")


def _pose(layout: Layout, moved: Array) -> _Pose:
    network = layout.network
    each = np.arange(len(network.ends))
    shape = (len(each), network.nodes)
    ones = np.ones(len(each))
    difference = sparse.csr_array((ones, (each, network.ends[:, 1])), shape=shape)
    difference -= sparse.csr_array((ones, (each, network.ends[:, 0])), shape=shape)
    to_spans = sparse.kron(difference, np.eye(2)).tocsr()
    span = network.span + (to_spans @ moved).reshape(-1, 2)
    rest, length = np.linalg.norm(network.span, axis=1), np.linalg.norm(span, axis=1)
    along = span / length[:, None]
    aside = np.stack([-along[:, 1], along[:, 0]], axis=1)
    pull = network.stretch * (length / rest - 1.0)
    # compressed segments would make the matrix indefinite; without that part steps still descend
    stiff = (network.stretch / rest)[:, None, None] * along[:, :, None] * along[:, None]
    stiff += np.maximum(pull / length, 0.0)[:, None, None] * aside[:, :, None] * aside[:, None]
    first, second = network.pairs.T
    turn = _angle(span[first], span[second]) - _angle(network.span[first], network.span[second])
    hinge = np.arange(len(turn))
    by_span = (aside / length[:, None]).ravel()
    rows, columns, values = [], [], []
    for segment, sign in ((second, 1.0), (first, -1.0)):
        for axis in range(2):
            rows.append(hinge)
            columns.append(2 * segment + axis)
            values.append(sign * by_span[2 * segment + axis])
    place = (np.concatenate(rows), np.concatenate(columns))
    turns = sparse.csr_array((np.concatenate(values), place), shape=(len(hinge), 2 * len(each)))
    weight = 2.0 * network.bend / network.reach
    energy = 0.5 * float(network.stretch @ (rest * (length / rest - 1.0) ** 2))
    energy += 0.5 * float(weight @ turn**2)
    force = (pull[:, None] * along).ravel() + turns.T @ (weight * turn)
    index = np.arange(len(each) + 1)
    blocks = sparse.bsr_array((stiff, index[:-1], index), shape=(2 * len(each),) * 2)
    whole = blocks.tocsr() + turns.T @ sparse.diags_array(weight) @ turns
    return _Pose(energy, to_spans.T @ force, (to_spans.T @ whole @ to_spans).tocsr())


def _angle(one: Array, other: Array) -> Array:
    cross = one[:, 0] * other[:, 1] - one[:, 1] * other[:, 0]
    return np.arctan2(cross, np.einsum("ij,ij->i", one, other))
