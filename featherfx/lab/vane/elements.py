"""Strain points of triangles with three or six nodes: where a plane membrane's strains are taken.

Six-node triangles have straight sides and three points, which is exact for the energy of small
strains and leaves no motion without energy but the rigid ones.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from featherfx.lab.vane.mesh import Mesh, areas, quadratic
from featherfx.lab.vane.sample import Sample

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
Order = Literal[1, 2]

# area coordinates of the three points of a six-node triangle, each of a third of the weight
POINTS = np.full((3, 3), 1.0 / 6.0) + 0.5 * np.eye(3)


@dataclass(frozen=True)
class Membrane:
    """Constant data of a discretised sample: N nodes, M elements of K nodes and Q strain points.

    points: (N, 2) m, at rest. nodes: (M, K). along, across: (M, Q, K) 1/m, derivatives of the
    nodes' functions along and across the barbs. volume: (M, Q) m^3. moduli: (M, 3) Pa, along the
    barbs, across them, shear. chains: (S, 2) segments along barbs whose length is kept exactly;
    none unless the barbs are inextensible.
    """

    points: Array
    nodes: Indices
    along: Array
    across: Array
    volume: Array
    moduli: Array
    chains: Indices


def membrane(
    sample: Sample, mesh: Mesh, moduli: Array, order: Order = 1, *, inextensible: bool = False
) -> Membrane:
    """Discretise a sample. moduli: (3,) or (M, 3) Pa.

    inextensible: keep all segments along barbs at their length instead of giving them a stiffness;
    aligned meshes of order 1 only.
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
    )


def _slopes(mesh: Mesh) -> Array:
    """(M, 3, 2) 1/m, gradients of the area coordinates."""
    corner = mesh.points[mesh.triangles]
    opposite = np.roll(corner, -2, axis=1) - np.roll(corner, -1, axis=1)
    turned = np.stack([-opposite[..., 1], opposite[..., 0]], axis=-1)
    return turned / (2.0 * areas(mesh))[:, None, None]


def _quadratic_slopes(slopes: Array) -> Array:
    """(M, 3, 6, 2) 1/m, gradients of the six functions at the three points."""
    corner = (4.0 * POINTS - 1.0)[None, :, :, None] * slopes[:, None]
    after = np.roll(np.arange(3), -1)
    sides = 4.0 * (
        POINTS[None, :, :, None] * slopes[:, None, after]
        + POINTS[:, after][None, :, :, None] * slopes[:, None]
    )
    return np.concatenate([corner, sides], axis=2)
