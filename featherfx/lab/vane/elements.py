"""Strain points of triangles with three or six nodes: where a plane membrane's strains are taken.

Six-node triangles have straight sides and three points, which is exact for the energy of small
strains and leaves no motion without energy but the rigid ones.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.sparse import csc_matrix, csr_matrix, diags, kron, vstack

from featherfx.algebra.types import Array, Indices
from featherfx.lab.vane.mesh import Mesh, areas, quadratic
from featherfx.lab.vane.sample import Sample

Order = Literal[1, 2]

# area coordinates of the three points of a six-node triangle, each of a third of the weight
_POINTS = np.full((3, 3), 1.0 / 6.0) + 0.5 * np.eye(3)


@dataclass(frozen=True)
class Membrane:
    """Constant data of a discretised sample: N nodes, M elements of K nodes and Q strain points.

    points: (N, 2) m, at rest. nodes: (M, K). along, across: (M, Q, K) 1/m, derivatives of the
    nodes' functions along and across the barbs. volume: (M, Q) m^3. moduli: (M, 3) Pa, along the
    barbs, across them, shear. chains: (S, 2) segments along barbs whose length is kept exactly;
    none unless the barbs are inextensible. bending: (2 N, 2 N) N/m, form of the displacements that
    is twice the energy of barbs bent within the plane, or None. guard: Pa, modulus of the
    compression guard.
    """

    points: Array
    nodes: Indices
    along: Array
    across: Array
    volume: Array
    moduli: Array
    chains: Indices
    bending: csc_matrix | None = None
    guard: float = 0.0


def membrane(
    sample: Sample,
    mesh: Mesh,
    moduli: Array,
    order: Order = 1,
    *,
    inextensible: bool = False,
    barb_bending: float = 0.0,
    guard: float = 0.0,
) -> Membrane:
    """Discretise a sample. moduli: (3,) or (M, 3) Pa.

    inextensible: keep all segments along barbs at their length instead of giving them a stiffness.
    barb_bending: Pa m^2, S of the energy density S |d2x / dv2|^2 / 2 along the barbs, the gradient
    of strain that barbs of some width resist. Both for aligned meshes of order 1 only. guard: Pa,
    modulus of the compression guard.
    """
    slopes = _slopes(mesh)
    points, nodes = (mesh.points, mesh.triangles) if order == 1 else quadratic(mesh)
    derivatives = slopes[:, None] if order == 1 else _quadratic_slopes(slopes)
    stiff = np.array(np.broadcast_to(moduli, (len(nodes), 3)), dtype=float)
    chains = np.zeros((0, 2), np.int64)
    if inextensible:
        stiff[:, 0] = 0.0
        chains = mesh.chains
    count = derivatives.shape[1]
    volume = np.repeat((areas(mesh) * sample.thickness / count)[:, None], count, axis=1)
    return Membrane(
        points=points,
        nodes=np.ascontiguousarray(nodes),
        along=np.ascontiguousarray(derivatives @ sample.barb),
        across=np.ascontiguousarray(derivatives @ sample.across),
        volume=volume,
        moduli=stiff,
        chains=chains,
        bending=_bending(sample, mesh, barb_bending) if barb_bending else None,
        guard=guard,
    )


def _bending(sample: Sample, mesh: Mesh, stiffness: float) -> csc_matrix:
    """Bend triplets along the rows, each with the width of its row; clamps keep the direction."""
    chains, points = mesh.chains, mesh.points
    length = np.linalg.norm(points[chains[:, 1]] - points[chains[:, 0]], axis=1)
    place = np.round(points[chains[:, 0]] @ sample.across / sample.height, 9)
    rows, row = np.unique(place, return_inverse=True)
    width = sample.height * np.diff(rows, prepend=rows[0], append=rows[-1])
    width = 0.5 * (width[1:] + width[:-1])[row]
    count, each = len(points), np.arange(len(chains))
    turn = csr_matrix((1.0 / length, (each, chains[:, 1])), (len(chains), count))
    turn -= csr_matrix((1.0 / length, (each, chains[:, 0])), (len(chains), count))
    joint = np.flatnonzero(chains[:-1, 1] == chains[1:, 0])
    lines = [turn[joint + 1] - turn[joint]]
    weights = [width[joint] / (length[joint] + length[joint + 1])]
    height = points[:, 1]
    held = (height <= 0.0) | (height >= sample.height)
    for end in range(2):
        clamp = np.flatnonzero(held[chains[:, end]] & ~held[chains[:, 1 - end]])
        lines.append(turn[clamp])
        weights.append((width / length)[clamp])
    every = vstack(lines)
    weight = 2.0 * stiffness * sample.thickness * np.concatenate(weights)
    return csc_matrix(kron(every.T @ diags(weight) @ every, np.eye(2)))


def _slopes(mesh: Mesh) -> Array:
    """(M, 3, 2) 1/m, gradients of the area coordinates."""
    corner = mesh.points[mesh.triangles]
    opposite = np.roll(corner, -2, axis=1) - np.roll(corner, -1, axis=1)
    turned = np.stack([-opposite[..., 1], opposite[..., 0]], axis=-1)
    return turned / (2.0 * areas(mesh))[:, None, None]


def _quadratic_slopes(slopes: Array) -> Array:
    """(M, 3, 6, 2) 1/m, gradients of the six functions at the three points."""
    corner = (4.0 * _POINTS - 1.0)[None, :, :, None] * slopes[:, None]
    after = np.roll(np.arange(3), -1)
    sides = 4.0 * (
        _POINTS[None, :, :, None] * slopes[:, None, after]
        + _POINTS[:, after][None, :, :, None] * slopes[:, None]
    )
    return np.concatenate([corner, sides], axis=2)
