"""The same feather for the other wing."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from featherfx.feather.types import Array, Feather, Surface

_REFLECTION = np.array([1.0, -1.0, 1.0])


def mirror_feather(feather: Feather) -> Feather:
    """The mirror image in the plane y = 0: leading vane at -y, dorsal still +z.

    A reflection would make the frames left-handed, so d2 is turned round: it still starts as +y,
    which is then the trailing side.
    """
    points = feather.points * _REFLECTION
    points[:, 1] = -points[:, 1]
    return replace(
        feather, points=_positive_zeros(points), surface=_mirror_surface(feather.surface)
    )


def _mirror_surface(surface: Surface) -> Surface:
    weights = surface.weights.copy()
    weights[:, 1] = -weights[:, 1]
    return replace(
        surface,
        weights=_positive_zeros(weights),
        triangles=np.ascontiguousarray(surface.triangles[:, [0, 2, 1]]),
        barb_direction=_positive_zeros(surface.barb_direction * _REFLECTION),
    )


def _positive_zeros(values: Array) -> Array:
    """Zeros without a sign, so that files do not show -0."""
    return values + 0.0
