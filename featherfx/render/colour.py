"""Colours of an image by value or region, and the key to them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from featherfx.algebra.types import Array, Flags, Indices
from featherfx.groom.materials import VANE_COLOUR, linear
from featherfx.render.geometry import DrawnPose, DrawnScene

# linear: of shafts, and of other meshes without a colour of their own
PLAIN_RACHIS_COLOUR, SKIN_COLOUR = (0.47, 0.36, 0.22), (0.31, 0.25, 0.22)
COLLIDER_COLOUR = (0.24, 0.26, 0.29)
_MUTED = (0.45, 0.45, 0.45)
# Anchors of perceptually even ramps: viridis, and a blue-white-red diverging one.
SEQUENTIAL = np.array(
    [[68, 1, 84], [59, 82, 139], [33, 145, 140], [94, 201, 98], [253, 231, 37]]
) / 255  # fmt: skip
DIVERGING = np.array(
    [[33, 102, 172], [146, 197, 222], [245, 245, 245], [244, 165, 130], [178, 24, 43]]
) / 255  # fmt: skip
# open, weak, whole
HOOKS = np.array([[178, 24, 43], [244, 165, 130], [203, 194, 176]]) / 255
# free, passing through another
CROSSED = np.array([[203, 194, 176], [214, 39, 40]]) / 255
_CATEGORIES = np.array(
    [[68, 119, 170], [238, 102, 119], [34, 136, 51], [204, 187, 68], [102, 204, 238],
     [170, 51, 119], [187, 187, 187], [238, 153, 51]]
) / 255  # fmt: skip


@dataclass(frozen=True)
class Bar:
    """A colour bar: title with unit, least and greatest value, (K, 3) colours from low to high."""

    title: str
    low: float
    high: float
    ramp: Array


@dataclass(frozen=True)
class Legend:
    """Named colours."""

    entries: tuple[tuple[str, tuple[float, ...]], ...]


def look_colours(scene: DrawnScene, mode: str) -> tuple[Array, Legend | None]:
    """Linear colours (N, 3) of feathers in a look ("shaded" or "region"), and the key to them."""
    if mode != "region":
        return np.tile(VANE_COLOUR, (len(scene.feathers), 1)), None
    names = sorted(set(scene.regions))
    palette = [tuple(_CATEGORIES[k % len(_CATEGORIES)]) for k in range(len(names))]
    labels = tuple((name or "(none)", c) for name, c in zip(names, palette, strict=True))
    found = np.array([palette[names.index(region)] for region in scene.regions])
    return linear(found), Legend(labels)


def value_colours(
    scene: DrawnScene, poses: Sequence[DrawnPose], mode: str
) -> tuple[list[Array], Bar]:
    """Colours (T, 3) of each pose by values ("barb", "strain" or "hooked"), 0 to 1, and the key."""
    if mode == "hooked":
        fractions = [pose.hooked for pose in poses]
        return _coloured(scene, fractions, Bar("hooks that hold", 0.0, 1.0, HOOKS))
    if mode == "barb":
        values = [barb_angle(scene, pose) for pose in poses]
        return _by_value(scene, values, "barb angle (deg)", SEQUENTIAL, symmetric=False)
    rest = scene.rest
    values = [
        100 * strain_across_barbs(rest.points, pose.points, scene.triangles, rest.barbs)
        for pose in poses
    ]
    title = "Green-Lagrange strain across barbs (%)"
    return _by_value(scene, values, title, DIVERGING, symmetric=True)


def ramp_colours(ramp: Array, fraction: Array) -> Array:
    """Colours (N, 3) at fractions 0..1 of a ramp."""
    steps = np.linspace(0, 1, len(ramp))
    return np.stack([np.interp(fraction, steps, ramp[:, k]) for k in range(3)], axis=-1)


def _by_value(
    scene: DrawnScene, values: list[Array], title: str, ramp: Array, symmetric: bool
) -> tuple[list[Array], Bar]:
    shown = _shown(scene)
    low, high = value_limits(np.concatenate([v[shown] for v in values]), symmetric)
    return _coloured(scene, values, Bar(title, low, high, ramp))


def _coloured(scene: DrawnScene, values: list[Array], bar: Bar) -> tuple[list[Array], Bar]:
    shown, colours = _shown(scene), []
    for value in values:
        fraction = np.clip((value - bar.low) / (bar.high - bar.low), 0, 1)
        colours.append(np.where(shown[:, None], ramp_colours(bar.ramp, fraction), _MUTED))
    return colours, bar


def _shown(scene: DrawnScene) -> Flags:
    """(T,) triangles that have values."""
    return ~scene.rachis & np.asarray(scene.rest.barbs.any(axis=1))


def value_limits(values: Array, symmetric: bool) -> tuple[float, float]:
    """The range of a bar: 99 % of the values, so that one odd triangle does not grey the rest."""
    if len(values) == 0:
        return 0.0, 1.0
    if symmetric:
        reach = max(float(np.percentile(np.abs(values), 99)), 1e-4)
        return -reach, reach
    low, high = (float(v) for v in np.percentile(values, [0.5, 99.5]))
    return (low, high) if high - low > 0.1 else (low - 1.0, high + 1.0)


def barb_angle(scene: DrawnScene, pose: DrawnPose) -> Array:
    """(T,) deg, between the barb and the shaft at the same height of the feather."""
    angle = np.zeros(len(scene.triangles))
    ends = np.searchsorted(scene.owner, np.arange(len(scene.regions) + 1))
    for mine in (slice(*own) for own in pairwise(ends)):
        shaft = scene.rachis[mine]
        if not shaft.any():
            continue
        heights, place = np.unique(scene.along_feather[mine][shaft], return_inverse=True)
        tangent = np.zeros((len(heights), 3))
        np.add.at(tangent, place, pose.barbs[mine][shaft])
        at = scene.along_feather[mine]
        here = np.stack([np.interp(at, heights, tangent[:, k]) for k in range(3)], axis=1)
        here /= np.maximum(np.linalg.norm(here, axis=1, keepdims=True), 1e-300)
        cosine = np.clip((here * pose.barbs[mine]).sum(axis=1), -1, 1)
        angle[mine] = np.degrees(np.arccos(cosine))
    return angle


def strain_across_barbs(rest: Array, points: Array, triangles: Indices, along: Array) -> Array:
    """(T,) Green-Lagrange strain across the barb, no unit: half of (stretch squared - 1).

    rest, points: (V, 3) of any one unit. triangles: (T, 3). along: (T, 3) rest direction of the
    barb. Triangles without area have strain 0.
    """
    rest_edges = rest[triangles[:, 1:]] - rest[triangles[:, :1]]
    edges = points[triangles[:, 1:]] - points[triangles[:, :1]]
    normal = np.cross(rest_edges[:, 0], rest_edges[:, 1])
    area = np.linalg.norm(normal, axis=1)
    valid = area > 0
    across = np.cross(normal / np.where(valid, area, 1)[:, None], along)
    size = np.linalg.norm(across, axis=1)
    valid &= size > 0
    across /= np.where(size > 0, size, 1)[:, None]
    # The material direction "across" in terms of the two edges: solved in the triangle's plane.
    gram = np.einsum("tik,tjk->tij", rest_edges, rest_edges)
    gram[~valid] = np.eye(2)
    parts = np.linalg.solve(gram, np.einsum("tik,tk->ti", rest_edges, across)[..., None])
    stretched = np.einsum("ti,tik->tk", parts[..., 0], edges)
    strain = 0.5 * ((stretched**2).sum(axis=1) - 1)
    return np.where(valid, strain, 0.0)
