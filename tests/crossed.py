"""Feathers that pass through each other, as they are placed."""

import numpy as np

from featherfx.feather.crossings import find_intersections, make_patches
from featherfx.feather.placed_feathers import build_feathers
from featherfx.feather.types import RACHIS_PART


def crossed(feathers, rows=41, columns=10):
    """Ids of pairs whose vanes pass through each other."""
    parts, points = [], []
    for number, (place, built) in enumerate(
        zip(feathers, build_feathers(feathers, rows, columns), strict=True)
    ):
        surface = built.surface
        faces = surface.triangles[surface.part != RACHIS_PART]
        at = place.position + surface.points(built.rest) @ np.asarray(place.rotation).T
        parts.append((at, faces, np.zeros(len(faces), bool), number))
        points.append(at)
    found = find_intersections(np.concatenate(points), make_patches(parts))
    return [tuple(feathers[k].id for k in pair) for pair in found.owners.tolist()]
