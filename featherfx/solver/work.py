"""Scratch memory of one thread: everything that a feather's step needs, allocated once."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from featherfx.mechanics.model import Model

Array = NDArray[np.float64]


class Work(NamedTuple):
    """n rows, m columns, C coefficients, P material points a row, N unknowns, w = 6 + 2 C.

    band (N, 3 (6 + 4 C)), right (N,): linear system. target, past, wind, area (n, P, 3),
    speed (n, P): of the step (node_kernels). reference (S,): strains that damping pulls towards; strains (S,): of the present pose.
    force (n, P, 3), stiff (n, P, 6): of the nodes. jacobian (n, 2, m, 3, 2 C): of the barbs.
    halfway (n-1, 3, 3), rachis (n-1, 6): rachis frames and strains. local (3 w, 3 w),
    local_right (3 w,), lines (4, 3 w): of one row and side. membrane to stretch: of one stencil.
    turn (n, 4), centre (n, 3), coefficient (2, n, 2 C), points (n, P, 3),
    trial_halfway, trial_rachis, trial_strains: the trial pose. saved_*: the pose before the step.
    """

    band: Array
    right: Array
    target: Array
    past: Array
    wind: Array
    area: Array
    speed: Array
    reference: Array
    strains: Array
    force: Array
    stiff: Array
    jacobian: Array
    halfway: Array
    rachis: Array
    local: Array
    local_right: Array
    lines: Array
    membrane: Array
    weight: Array
    hinge: Array
    beam: Array
    beam_matrix: Array
    frame: Array
    spin: Array
    stretch: Array
    turn: Array
    centre: Array
    coefficient: Array
    points: Array
    trial_halfway: Array
    trial_rachis: Array
    trial_strains: Array
    saved_turn: Array
    saved_centre: Array
    saved_coefficient: Array
    saved_points: Array


def strain_count(model: Model) -> int:
    """Length S of a feather's strain vector: rachis, barbs, membrane, hinges."""
    n, m, c = model.rows, model.columns, model.coefficients
    return (n - 1) * 6 + 2 * n * 2 * c + 2 * (n - 1) * m * 4 + 2 * n * m


def make_work(model: Model) -> Work:
    """Scratch for one thread working on feathers of this batch."""
    n, m, c = model.rows, model.columns, model.coefficients
    size, wide = 3 + 2 * m, 3 * (6 + 2 * c)
    return Work(
        band=np.zeros((model.unknowns, 3 * (6 + 4 * c))),
        right=np.zeros(model.unknowns),
        target=np.zeros((n, size, 3)),
        past=np.zeros((n, size, 3)),
        wind=np.zeros((n, size, 3)),
        area=np.zeros((n, size, 3)),
        speed=np.zeros((n, size)),
        reference=np.zeros(strain_count(model)),
        strains=np.zeros(strain_count(model)),
        force=np.zeros((n, size, 3)),
        stiff=np.zeros((n, size, 6)),
        jacobian=np.zeros((n, 2, m, 3, 2 * c)),
        halfway=np.zeros((n - 1, 3, 3)),
        rachis=np.zeros((n - 1, 6)),
        local=np.zeros((wide, wide)),
        local_right=np.zeros(wide),
        lines=np.zeros((4, wide)),
        membrane=np.zeros((4, 3, 3)),
        weight=np.zeros(4),
        hinge=np.zeros((4, 3)),
        beam=np.zeros((6, 12)),
        beam_matrix=np.zeros((12, 12)),
        frame=np.zeros((3, 3)),
        spin=np.zeros((3, 2 * c)),
        stretch=np.zeros(3),
        turn=np.zeros((n, 4)),
        centre=np.zeros((n, 3)),
        coefficient=np.zeros((2, n, 2 * c)),
        points=np.zeros((n, size, 3)),
        trial_halfway=np.zeros((n - 1, 3, 3)),
        trial_rachis=np.zeros((n - 1, 6)),
        trial_strains=np.zeros(strain_count(model)),
        saved_turn=np.zeros((n, 4)),
        saved_centre=np.zeros((n, 3)),
        saved_coefficient=np.zeros((2, n, 2 * c)),
        saved_points=np.zeros((n, size, 3)),
    )
