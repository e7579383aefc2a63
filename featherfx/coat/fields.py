"""Fields of a coat over its skin, each by one sparse solve.

Means of what the feathers have at their follicles, with r a share of their length:

    u = S^-1 P' data / S^-1 P' 1,   S = M + int r(x)^2 grad u . grad v

P interpolates at the follicles; S^-1 P' 1 is their density n. So come the flow f (unit, tangent),
the length l and the pace. The stacking coordinate phi grows along the flow, least squares that
weigh what lies across it most:

    int w (grad phi - f) . (1 - (1 - e) f f') (grad phi - f) = min,   w = |mean of headings|^2

Where headings around disagree, |mean| < 0.7, feathers turn towards the mean: flows that meet run
along their ridge. The pace is the growth of phi along f, so that phi gains q = l pace over a
feather.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from featherfx.algebra.triangulation import (
    TriangleElements,
    factorise,
    make_elements,
    make_smoother,
    make_stiffness,
)
from featherfx.algebra.types import Array, Indices
from featherfx.algebra.vectors import dots, unit
from featherfx.coat.carrier import Carrier, CoatMesh, make_mesh

# of the length of the feathers: reach of means over the skin, and of the smoothing of the carrier
_MEAN_REACH, _CARRIER_REACH = 1.0, 0.2
# agreement of headings below which feathers turn towards their mean, wholly at half of it
_MIN_AGREEMENT = 0.7
# weight of growth along the flow against what lies across it
_ALONG = 0.15
# least share of the weight where there is no flow, and relative hold of phi at 0
_MIN_WEIGHT, _HOLD = 1e-3, 1e-9
# of its length, that a tip rises by its tilt and lies as the coat's thickness has it
_USUAL_RISE = 0.26
# least growth of phi along the flow of feathers
MIN_PACE = 0.2
# of its length, the least gap, of which shares can be told
_MIN_GAP = 1e-6
# of its length, an edge of a drawn vane, whose sagitta neighbours make room for
_EDGE = 0.1
# of a coat's thickness, that gaps of the feathers over a place may fill
_FILLED = 0.35
# of the thickness that is asked for, that of the thinnest coat and of the thickest
_THINNEST, _THICKEST = 0.75, 1.2
# of the greatest, density far from all places
_FAR_DENSITY = 1e-9


class CoatSpacing(NamedTuple):
    """Thickness of a coat, and gap between its leaves, over the length of the feathers."""

    thickness: float = 0.08
    gap: float = 0.0025


class SkinPlaces(NamedTuple):
    """Places on a skin. triangle: (N,) and place: (N, 3) barycentric."""

    triangle: Indices
    place: Array


class Follicles(NamedTuple):
    """F follicles on a skin.

    triangle: (F,) and place: (F, 3) barycentric, on the skin. position: (F, 3) m. heading: (F, 3)
    and lateral: (F, 3) of the frame of the root. length, width: (F,) m, of the feather. depth: (F,)
    m, of the follicle under the skin.
    """

    triangle: Indices
    place: Array
    position: Array
    heading: Array
    lateral: Array
    length: Array
    width: Array
    depth: Array

    def corners(self, mesh: CoatMesh, values: Array) -> Array:
        """Interpolate values (V, ...) at the follicles."""
        own = values[mesh.faces[self.triangle]]
        return np.asarray(np.einsum("fk,fk...->f...", self.place, own))


class Fields(NamedTuple):
    """Fields at the V vertices of a skin.

    phi, gain, thickness, lift, rise, length: m. gap: (T,) m, between leaves. strength: (T,) 0 to 1,
    how well headings around agree. growth: (F,) of phi along the heading at each follicle.
    """

    phi: Array
    gain: Array
    thickness: Array
    lift: Array
    rise: Array
    gap: Array
    length: Array
    strength: Array
    growth: Array


def make_coat_mesh(points: Array, faces: Indices, follicles: Follicles) -> CoatMesh:
    """Prepare a skin for its coat: creases shorter than its feathers are smoothed."""
    mean = average_follicles(make_elements(points, faces), faces, follicles)
    length = mean(follicles.length)[faces].mean(axis=1)
    return make_mesh(points, faces, _CARRIER_REACH * length)


class SkinMeans:
    """Means over a skin of what N places on it have. density: (V,) 1/m^2, of their weights.

    reach: m. places: triangle (N,) and place (N, 3). weights: (N,), default 1.
    """

    def __init__(
        self,
        elements: TriangleElements,
        faces: Indices,
        reach: float,
        places: SkinPlaces | Follicles,
        weights: Array | float = 1.0,
    ) -> None:
        from scipy.sparse import csr_array

        self.elements = elements
        self._solve: Callable[[Array], Array] = make_smoother(elements, faces, reach)
        count = len(places.triangle)
        rows = np.repeat(np.arange(count), 3), faces[places.triangle].ravel()
        shape = count, len(elements.masses)
        self._weights = np.broadcast_to(weights, count)
        values = self._weights[:, None] * places.place
        self._spread = csr_array((values.ravel(), rows), shape=shape).T
        own = self._solve(self._spread @ np.ones(count))
        self._least = _FAR_DENSITY * own.max()
        self.density = np.maximum(own, 0.0) + self._least

    def __call__(self, data: Array) -> Array:
        """Means (V, ...) of data (N, ...); far from all places that of all."""
        whole = np.average(data, axis=0, weights=self._weights)
        found = self._solve(self._spread @ data) + self._least * whole
        return np.asarray((found.T / self.density).T)

    def smooth(self, values: Array) -> Array:
        """Means (V, K) of values (V, K) around, by the skin's area alone."""
        return self._solve(self.elements.masses[:, None] * values)


def find_tilts(follicles: Follicles, normals: Array) -> Array:
    """Return (F, 2) m and rad, rise of tips over the smoothed skin, of normals (F, 3), by the tilts
    of their roots, and rolls."""
    rise, side = (dots(each, normals) for each in (follicles.heading, follicles.lateral))
    return np.stack([follicles.length * rise, np.arcsin(np.clip(side, -1.0, 1.0))], axis=1)


def find_headings(mesh: CoatMesh, follicles: Follicles, normals: Array, mean: SkinMeans) -> Array:
    """Return (F, 3) unit headings in the planes of normals (F, 3), which agree."""
    own = _flattened(follicles.heading, normals)
    common = follicles.corners(mesh, mean(own))
    agreement = np.linalg.norm(common, axis=1, keepdims=True)
    turned = np.clip(2.0 - 2.0 * agreement / _MIN_AGREEMENT, 0.0, 1.0)
    return _flattened((1.0 - turned) * own + turned * unit(common), normals)


def _flattened(ways: Array, normals: Array) -> Array:
    """Return (F, 3) unit, ways in the planes of unit normals."""
    return np.asarray(unit(ways - dots(ways, normals)[:, None] * normals))


def average_follicles(
    elements: TriangleElements, faces: Indices, follicles: Follicles
) -> SkinMeans:
    """Means over a skin of what follicles have, over the lengths of their feathers."""
    return SkinMeans(elements, faces, _MEAN_REACH * float(np.median(follicles.length)), follicles)


def make_fields(
    carrier: Carrier,
    faces: Indices,
    follicles: Follicles,
    mean: SkinMeans,
    rise: Array,
    spacing: CoatSpacing,
) -> Fields:
    """Solve for the fields of a coat on its carrier at rest. follicles: with headings that agree.
    rise: (F,) m, of tips by the tilts of roots."""
    elements = carrier.elements
    length, rise = mean(np.stack([follicles.length, rise], axis=1)).T
    heading = follicles.heading
    flow = mean(heading)[faces].mean(axis=1)
    flow = flow - dots(flow, elements.normals)[:, None] * elements.normals
    strength = np.minimum(np.linalg.norm(flow, axis=1), 1.0)
    flow = unit(flow)
    phi = _solve_coordinate(elements, faces, flow, strength)
    slope = np.einsum("tki,tk->ti", elements.gradients, phi[faces])[follicles.triangle]
    growth = dots(slope, heading)
    pace = np.maximum(mean(dots(slope, flow[follicles.triangle])), MIN_PACE)
    size = length[faces].mean(axis=1)
    gap = (
        max(spacing.gap, _MIN_GAP) * size + _find_bends(carrier, faces) * (_EDGE * size) ** 2 / 8.0
    )
    layers = mean.density * length * mean(follicles.width)
    wanted = layers * _spread(gap, faces, mean) / (_FILLED * spacing.thickness * length)
    return Fields(
        phi=phi,
        gain=length * pace,
        thickness=spacing.thickness * length * np.clip(wanted, _THINNEST, _THICKEST),
        lift=np.maximum(rise - _USUAL_RISE * length, 0.0),
        rise=rise,
        gap=gap,
        length=length,
        strength=strength,
        growth=growth,
    )


def _solve_coordinate(
    elements: TriangleElements, faces: Indices, flow: Array, strength: Array
) -> Array:
    """Return phi (V,) m. flow: (T, 3) unit. strength: (T,)."""
    from scipy.sparse import diags_array

    weight = strength**2 + _MIN_WEIGHT
    across = np.eye(3) - (1.0 - _ALONG) * flow[:, :, None] * flow[:, None, :]
    matrix = make_stiffness(elements, faces, weight[:, None, None] * across)
    pull = (elements.areas * weight * _ALONG)[:, None] * flow
    right = np.einsum("tki,ti->tk", elements.gradients, pull)
    hold = _HOLD * matrix.diagonal().mean() * elements.masses / elements.masses.mean()
    solve = factorise(matrix + diags_array(hold))
    return solve(np.bincount(faces.ravel(), right.ravel(), len(elements.masses)).astype(float))


def _find_bends(carrier: Carrier, faces: Indices) -> Array:
    """Return (T,) 1/m, the greatest curvature of a carrier."""
    normals = carrier.normals[faces, :3]
    shape = np.einsum("tki,tkj->tij", carrier.elements.gradients, normals)
    return np.asarray(np.linalg.norm(shape, axis=(1, 2), ord=2))


def _spread(values: Array, faces: Indices, mean: SkinMeans) -> Array:
    """Means (V,) around of values (T,) of triangles."""
    thirds = np.repeat(values * mean.elements.areas / 3.0, 3)
    own = np.bincount(faces.ravel(), thirds, len(mean.density)) / mean.elements.masses
    return mean.smooth(own[:, None])[:, 0]
