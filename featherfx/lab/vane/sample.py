"""A rectangular sample of a vane between two clamps: its meshes, and measures of a traction test.

    strain  e = ((1 + d/H)^2 - 1) / 2,      stress  s = H / (W b (H + d)) f

d displacement of the upper clamp, f force on it, both along y; W, H, b width, height and thickness
of the sample. They are the Green-Lagrange strain and the second Piola-Kirchhoff stress of a sample
that deforms uniformly without change of width. Source: Jouve et al. 2024, eq. 1 and 2.

Its triangle meshes are aligned with the barbs, or not. An aligned mesh consists of rows along the
barbs, cut at the borders of the sample. The strip between two rows is filled with triangles, each
of which has an edge on one of the two rows. There is a row through each corner, so the rows' ends
follow the borders exactly.

Where barbs are stiff, the strain along them jumps at the barbs through the corners, which part
what one clamp holds from what is free. At a finite ratio the jump is a layer of thickness
L sqrt(E_vw / E_vv), L the length of the barb; rows may be denser there.

Strain points of triangles with three or six nodes: where a plane membrane's strains are taken.

Six-node triangles have straight sides and three points, which is exact for the energy of small
strains and leaves no motion without energy but the rigid ones.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise
from math import cos, hypot, inf, isclose, isfinite, radians, sin
from typing import Literal

import numpy as np
from scipy.sparse import csc_matrix, csr_matrix, diags, kron, vstack
from scipy.spatial import Delaunay

from featherfx.algebra.types import Array, Indices
from featherfx.errors import Problem
from featherfx.lab.declare import Range, out_of_range, value

Regime = Literal["free", "diagonal", "bridged"]

# how near a corner's barb must pass by the opposite corner to count as joining both
_SAME = 1e-9
_SIZE, _THICKNESS = Range(1e-5, 1.0, unit="m"), Range(1e-7, 0.01, unit="m")
_MODULUS = Range(0.0, above=True, unit="Pa")
FORM = "{value:g} is not allowed. Give {allowed}"


@dataclass(frozen=True)
class Sample:
    """A sample that is held along y = 0 and pulled at y = height; its sides are free."""

    angle: float = value(
        "Degrees from the x axis to the barbs.", allowed=Range(-90.0, 90.0, unit="degrees")
    )
    width: float = value("m.", allowed=_SIZE)
    height: float = value("m, between the clamps.", allowed=_SIZE)
    thickness: float = value("m.", 1.2e-4, _THICKNESS)

    @property
    def barb(self) -> Array:
        """(2,) unit vector along the barbs."""
        return np.array([_cos(self.angle), _sin(self.angle)])

    @property
    def across(self) -> Array:
        """(2,) unit vector across the barbs, a quarter turn from `barb`."""
        return np.array([-_sin(self.angle), _cos(self.angle)])

    @property
    def regime(self) -> Regime:
        """Class of a sample by barbs that join the clamps: none ("free"), the diagonal, "bridged".

        A barb climbs the height H within the width W where tan(angle) exceeds H / W.
        """
        climb = self.width * abs(_sin(self.angle))
        need = self.height * _cos(self.angle)
        if isclose(climb, need, abs_tol=_SAME * hypot(self.width, self.height)):
            return "diagonal"
        return "bridged" if climb > need else "free"


@dataclass(frozen=True)
class Moduli:
    """Moduli of the vane membrane, Pa: along the barbs, across them, and in shear (stress over
    engineering shear)."""

    along: float = value("Pa.", allowed=_MODULUS)
    across: float = value("Pa.", allowed=_MODULUS)
    shear: float = value("Pa.", allowed=_MODULUS)

    def as_array(self) -> Array:
        """(3,) along, across, shear."""
        return np.array([self.along, self.across, self.shear])


def isotropic(modulus: float) -> Moduli:
    """Moduli of a material of this Young's modulus (Pa) without Poisson effect."""
    return Moduli(modulus, modulus, 0.5 * modulus)


def displacement(strain: float, height: float) -> float:
    """Displacement of the clamp, m, at a strain above -1/2."""
    return height * (float(np.sqrt(1.0 + 2.0 * strain)) - 1.0)


def stress(force: float, moved: float, sample: Sample) -> float:
    """Stress, Pa, of a force (N) on the clamp that has moved by `moved` (m)."""
    area = sample.width * sample.thickness
    return force * sample.height / (area * (sample.height + moved))


def slope(strain: Array, stresses: Array) -> float:
    """Least-squares slope through the origin, Pa, of stresses (n,) over strains (n,)."""
    return float(strain @ stresses / (strain @ strain))


def strains(largest: float, steps: int) -> Array:
    """(steps,) equal steps of strain up to the largest, without zero."""
    return largest * np.arange(1, steps + 1) / steps


def sample_problems(sample: Sample, source: str = "") -> list[Problem]:
    """Every value of the sample that is out of its range."""
    found = out_of_range(sample, source, FORM)
    return [
        replace(each, message=each.message + _hint(each.key, getattr(sample, each.key)))
        for each in found
    ]


def strain_problems(strain: float, steps: int) -> list[Problem]:
    """A largest strain or a number of steps that no sample can take."""
    problems = []
    if not (-0.5 < strain <= 2.0) or strain == 0.0:
        allowed = "above -0.5 (height zero: every element inverts) to 2, not 0"
        problems.append(Problem("", "strain", FORM.format(value=strain, allowed=allowed)))
    if not 1 <= steps <= 1000:
        problems.append(Problem("", "steps", FORM.format(value=steps, allowed="1 to 1000")))
    return problems


def _hint(name: str, found: float) -> str:
    high = {"thickness": _THICKNESS.high, "angle": inf}.get(name, _SIZE.high)
    if not (isfinite(found) and found > high):
        return ""
    unit = "micrometres" if name == "thickness" and found >= 5.0 else "millimetres"
    return f". Is this in {unit}?"


def _cos(degrees: float) -> float:
    return 0.0 if abs(degrees) == 90.0 else cos(radians(degrees))


def _sin(degrees: float) -> float:
    return sin(radians(degrees))


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


# relative to the sample's size: rows shorter than this are points
_TINY = 1e-9
# relative to the barbs' length: no layer is resolved that is thinner
_THINNEST = 1e-4
# of random steps of the unaligned mesh's nodes, as a share of a cell
_JITTER = 0.3
# rows near the corners' barbs: the spacing starts with a share _FINEST of the layer's thickness and
# widens by _GROWTH per distance; a share _EVEN / (1 + _EVEN) of all rows is spread evenly
_FINEST, _GROWTH, _EVEN = 0.04, 0.5, 0.2


@dataclass(frozen=True)
class Mesh:
    """Nodes and triangles of a sample.

    points: (N, 2) m. triangles: (M, 3), counter-clockwise. strip: (M,) the strip of each triangle,
    counted across the barbs; -1 in unaligned meshes. chains: (S, 2) segments of rows, the edges
    along barbs; (0, 2) in unaligned meshes.
    """

    points: Array
    triangles: Indices
    strip: Indices
    chains: Indices


def corner_rows(sample: Sample) -> Array:
    """(4,) m, distance across the barbs, from the origin, of the barb through each corner."""
    w, h = sample.width, sample.height
    return np.sort(np.array([[0.0, 0.0], [w, 0.0], [0.0, h], [w, h]]) @ sample.across)


def cut_row(sample: Sample, place: float) -> tuple[float, float]:
    """Ends of the barb at `place` (m across the barbs), m along it from the origin's normal."""
    low, high = -np.inf, np.inf
    tiny = _TINY * max(sample.width, sample.height)
    for axis, size in enumerate((sample.width, sample.height)):
        offset, rate = place * sample.across[axis], sample.barb[axis]
        if abs(rate) < 1e-12:
            continue
        ends = sorted(((-offset) / rate, (size - offset) / rate))
        low, high = max(low, ends[0]), min(high, ends[1])
    middle = 0.5 * (low + high)
    return (low, high) if high - low > tiny else (middle, middle)


def graded_rows(sample: Sample, count: int, layer: float) -> Array:
    """About `count` strips' rows, denser near the corners' barbs.

    layer: thickness of the layers as a share of the barbs' length. Returns (R,) m across the barbs.
    """
    corners = corner_rows(sample)
    span = corners[-1] - corners[0]
    inner = corners[np.concatenate([[True], np.diff(corners) > _TINY * span])]
    inner[-1] = corners[-1]
    thick = _FINEST * max(layer, _THINNEST) * _longest(sample)
    fine = np.concatenate([_bunched(a, b, 400) for a, b in pairwise(inner)])
    fine = np.unique(fine)
    middle = 0.5 * (fine[1:] + fine[:-1])
    near = np.min(np.abs(middle[:, None] - inner), axis=1)
    density = 1.0 / (thick + _GROWTH * near)
    # blended with an even spacing, so that coarse meshes do not spend all rows on the layers
    weight = density / (density @ np.diff(fine)) + _EVEN / span
    total = np.concatenate([[0.0], np.cumsum(weight * np.diff(fine))])
    rows = []
    for a, b in pairwise(inner):
        start, end = np.interp([a, b], fine, total)
        strips = max(2, round(count * (end - start) / total[-1]))
        rows.append(np.interp(np.linspace(start, end, strips + 1), total, fine)[:-1])
    return np.concatenate([*rows, inner[-1:]])


def aligned_mesh(sample: Sample, rows: Array, spacing: float) -> Mesh:
    """Mesh with the given rows, (R,) m across the barbs, ascending, first and last through corners.

    spacing: m between nodes along a barb.
    """
    points: list[Array] = []
    triangles: list[Indices] = []
    strip: list[Indices] = []
    chains: list[Indices] = []
    before: tuple[Indices, Array] | None = None
    start = 0
    for number, place in enumerate(rows):
        low, high = cut_row(sample, float(place))
        count = 0 if high == low else max(1, round((high - low) / spacing))
        places = np.linspace(0.0, 1.0, count + 1)
        along = low + (high - low) * places
        points.append(along[:, None] * sample.barb + place * sample.across)
        index = np.arange(start, start + count + 1)
        chains.append(np.column_stack([index[:-1], index[1:]]))
        if before is not None:
            made = _strip(before[0], before[1], index, places)
            triangles.append(made)
            strip.append(np.full(len(made), number - 1))
        before, start = (index, places), start + count + 1
    found = np.concatenate(points)
    snap = _TINY * max(sample.width, sample.height)
    for axis, size in enumerate((sample.width, sample.height)):
        found[np.abs(found[:, axis]) < snap, axis] = 0.0
        found[np.abs(found[:, axis] - size) < snap, axis] = size
    return Mesh(
        found,
        np.concatenate(triangles).astype(np.int64),
        np.concatenate(strip).astype(np.int64),
        np.concatenate(chains).astype(np.int64),
    )


def aligned_of_size(sample: Sample, elements: int, layer: float) -> Mesh:
    """Aligned mesh of about that many triangles; layer: as in graded_rows."""
    area = sample.width * sample.height
    span = np.ptp(corner_rows(sample))
    size = np.sqrt(2.0 * area / elements)
    rows = max(2, round(span / size))
    mesh = aligned_mesh(sample, graded_rows(sample, rows, layer), size)
    for _ in range(4):
        size *= np.sqrt(len(mesh.triangles) / elements)
        rows = max(2, round(span / size))
        mesh = aligned_mesh(sample, graded_rows(sample, rows, layer), size)
    return mesh


def unaligned_of_size(sample: Sample, elements: int) -> Mesh:
    """Delaunay mesh of a grid whose nodes moved at random, always by the same numbers."""
    size = np.sqrt(2.0 * sample.width * sample.height / elements)
    nx, ny = max(1, round(sample.width / size)), max(2, round(sample.height / size))
    grid = np.stack(np.meshgrid(np.arange(nx + 1.0), np.arange(ny + 1.0), indexing="ij"), axis=-1)
    move = np.random.default_rng(7).uniform(-_JITTER, _JITTER, grid.shape)
    move[[0, -1], :, 0] = 0.0
    move[:, [0, -1], 1] = 0.0
    move[[0, -1], :, 1] = 0.0
    move[:, [0, -1], 0] = 0.0
    grid += move
    triangles = Delaunay(grid.reshape(-1, 2)).simplices.astype(np.int64)
    points = grid.reshape(-1, 2) * [sample.width / nx, sample.height / ny]
    doubled = _doubled_area(points, triangles)
    triangles[doubled < 0.0] = triangles[doubled < 0.0][:, [0, 2, 1]]
    triangles = triangles[np.abs(doubled) > _TINY * size * size]
    return Mesh(
        points, triangles, np.full(len(triangles), -1, np.int64), np.zeros((0, 2), np.int64)
    )


def quadratic(mesh: Mesh) -> tuple[Array, Indices]:
    """The mesh with nodes in the middle of its edges.

    Returns points (N, 2) m and elements (M, 6): corners, then the middles of edges 01, 12, 20.
    """
    edges = mesh.triangles[:, [[0, 1], [1, 2], [2, 0]]]
    pairs, inverse = np.unique(np.sort(edges.reshape(-1, 2), axis=1), axis=0, return_inverse=True)
    middles = mesh.points[pairs].mean(axis=1)
    elements = np.hstack([mesh.triangles, len(mesh.points) + inverse.reshape(-1, 3)])
    return np.vstack([mesh.points, middles]), elements


def _longest(sample: Sample) -> float:
    return max(np.subtract(*cut_row(sample, float(place))[::-1]) for place in corner_rows(sample))


def _bunched(a: float, b: float, count: int) -> Array:
    """Fine samples of [a, b], bunched at both ends."""
    return a + (b - a) * 0.5 * (1.0 - np.cos(np.linspace(0.0, np.pi, count)))


def _strip(below: Indices, below_places: Array, above: Indices, above_places: Array) -> Indices:
    """Triangles (m, 3) between two rows; places: (n,) along the rows, 0 to 1, of their nodes."""
    low, high = (0.5 * (each[1:] + each[:-1]) for each in (below_places, above_places))
    i, j = np.arange(len(low)), np.arange(len(high))
    partner = np.searchsorted(high, low, side="left")
    other = np.searchsorted(low, high, side="right")
    return np.concatenate(
        [
            np.column_stack([below[i], below[i + 1], above[partner]]),
            np.column_stack([above[j + 1], above[j], below[other]]),
        ]
    )


def _doubled_area(points: Array, triangles: Indices) -> Array:
    a, b, c = (points[triangles[:, k]] for k in range(3))
    u, v = b - a, c - a
    return u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]


def areas(mesh: Mesh) -> Array:
    """(M,) m^2, of the triangles."""
    return 0.5 * _doubled_area(mesh.points, mesh.triangles)
