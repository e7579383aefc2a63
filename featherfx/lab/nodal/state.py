"""Changing data of a batch in the nodal kinematics, and its scratch memory."""

from __future__ import annotations

from copy import deepcopy
from typing import NamedTuple

import numpy as np

from featherfx.algebra.rotation import along_rows, frames_to_quats, quats_to_frames
from featherfx.algebra.types import Array, Indices
from featherfx.feather.types import RowPoints, both, turned
from featherfx.lab.nodal.model import NodalModel
from featherfx.mechanics.batch import row_frames
from featherfx.mechanics.model import Model
from featherfx.solver.scratch import LinearSystem, make_points, make_system


class NodalState(NamedTuple):
    """Positions and rates of F feathers at one time (see Model for F, n, m).

    rotation: (F, n, 4) row frames as quaternions. points: (F, ...) nodes, the coordinates
    themselves, and directors; velocity, acceleration, smoothed: as in State. spin: (F, n, 3) rad/s.
    strains: (F, 2, S) after the last step and the one before. multiplier: (F, 2, n, m) N m, of
    inextensible barb segments. step, proposal, time: (F,) s, as in State.
    """

    rotation: Array
    points: RowPoints
    velocity: RowPoints
    acceleration: RowPoints
    smoothed: RowPoints
    spin: Array
    strains: Array
    multiplier: Array
    step: Array
    proposal: Array
    time: Array

    def copy(self) -> NodalState:
        return deepcopy(self)


class NodalPose(NamedTuple):
    """One feather's pose: rotation (n, 4), points; halfway (n-1, 3, 3) and rachis
    (n-1, 6) of the rachis elements; strains (S,), measured from rest."""

    rotation: Array
    points: RowPoints
    halfway: Array
    rachis: Array
    strains: Array


class StencilSums(NamedTuple):
    """Sums of one energy's stencil, of K points at most.

    lines: (8, 3 K) gradients, weight: (8,) theirs. slots: (K,), nodes: (6, 2) int. membrane:
    (4, 3, 3), turns: (2, 3, 3), hinge: (4, 3), frame: (3, 3), matrix: (12, 12),
    beam: (6, 12), stress: (6,).
    """

    lines: Array
    weight: Array
    slots: Indices
    nodes: Indices
    membrane: Array
    turns: Array
    hinge: Array
    frame: Array
    matrix: Array
    beam: Array
    stress: Array


class NodalSurroundings(NamedTuple):
    """As StepEnvironment of solver/scratch.py; reference: (S,)."""

    target: RowPoints
    past: RowPoints
    reference: Array
    wind: Array
    area: Array
    speed: Array
    carried: Array
    slip: Array


class NodalWork(NamedTuple):
    """Scratch of one thread. now, trial: poses. before: (S,) strains of the last iterate.
    multiplier: (2, n, m). around: NodalSurroundings. system: band (N, B + 1) and right (N,). force
    (n, 1 + 2 m, 3), stiff (n, 1 + 2 m, 6): of the nodes."""

    now: NodalPose
    trial: NodalPose
    before: Array
    multiplier: Array
    around: NodalSurroundings
    system: LinearSystem
    element: StencilSums
    force: Array
    stiff: Array


def nodal_strain_count(model: Model) -> int:
    """Length S of a strain vector: rachis, stretch, turns, membrane, hinges."""
    n, m = model.rows, model.columns
    return 6 * (n - 1) + 2 * n * m + 4 * n * m + 8 * (n - 1) * m + 6 * n * m


def nodal_rest_state(
    model: Model, nodal: NodalModel, positions: Array, rotations: Array
) -> NodalState:
    """Feathers at rest in their rest shape, roots at positions (F, 3) m, rotations (F, 3, 3)."""
    turns = np.swapaxes(np.asarray(rotations, float), 1, 2)[:, None]
    directors = quats_to_frames(nodal.rest_rotation).swapaxes(2, 3)[:, :, 1:]
    points = turned(turns, RowPoints(nodal.rest_nodes, directors))
    return nodal_state(model, points.shifted(np.asarray(positions, float)))


def nodal_state(model: Model, points: RowPoints) -> NodalState:
    """F feathers at rest (without velocity) with given points.

    So a pose of the barb-curvature kinematics (State.points) is carried over as it is; the other
    way, NodalState.points are there to compare with it or to draw.
    """
    points = both(np.array, points)
    count, n, m = len(points.nodes), model.rows, model.columns
    return NodalState(
        rotation=along_rows(frames_to_quats(row_frames(points.directors))),
        points=points,
        velocity=make_points(n, m, count),
        acceleration=make_points(n, m, count),
        smoothed=make_points(n, m, count),
        spin=np.zeros((count, n, 3)),
        strains=np.zeros((count, 2, nodal_strain_count(model))),
        multiplier=np.zeros((count, 2, n, m)),
        step=np.zeros(count),
        proposal=np.zeros(count),
        time=np.zeros(count),
    )


def _make_pose(model: Model) -> NodalPose:
    n = model.rows
    return NodalPose(
        rotation=np.zeros((n, 4)),
        points=make_points(n, model.columns),
        halfway=np.zeros((n - 1, 3, 3)),
        rachis=np.zeros((n - 1, 6)),
        strains=np.zeros(nodal_strain_count(model)),
    )


def make_nodal_work(model: Model, nodal: NodalModel) -> NodalWork:
    """Scratch for one thread working on feathers of this batch."""
    n, m = model.rows, model.columns
    size = 1 + 2 * m
    unknowns, nodes = int(nodal.size.max()), (n, size, 3)
    count = nodal_strain_count(model)
    # of a stencil: a triangle and its neighbours, or a whole barb with its row
    points = max(6, model.columns + 2)
    return NodalWork(
        now=_make_pose(model),
        trial=_make_pose(model),
        before=np.zeros(count),
        multiplier=np.zeros((2, n, m)),
        around=NodalSurroundings(
            target=make_points(n, m),
            past=make_points(n, m),
            reference=np.zeros(count),
            wind=np.zeros(nodes),
            area=np.zeros(nodes),
            speed=np.zeros((n, size)),
            carried=np.zeros((n, size)),
            slip=np.zeros((n, size)),
        ),
        system=make_system(unknowns, nodal.band + 1),
        element=StencilSums(
            lines=np.zeros((8, 3 * points)),
            weight=np.zeros(8),
            slots=np.zeros(points, np.int64),
            nodes=np.zeros((6, 2), np.int64),
            membrane=np.zeros((4, 3, 3)),
            turns=np.zeros((2, 3, 3)),
            hinge=np.zeros((4, 3)),
            frame=np.zeros((3, 3)),
            matrix=np.zeros((12, 12)),
            beam=np.zeros((6, 12)),
            stress=np.zeros(6),
        ),
        force=np.zeros(nodes),
        stiff=np.zeros((n, size, 6)),
    )
