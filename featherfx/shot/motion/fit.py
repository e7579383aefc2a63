"""Fit of a motion that was set on a pigeon to another groom: how fast and how far it goes.

Wings beat as often as Pennycuick's formula tells (1996, Journal of Experimental Biology 199:
1613-1618), of body mass m, span b and area S of the wings, with gravity and air the same:

    f ~ m^(3/8) b^(-23/24) S^(-1/3)

Of birds in proportion that is f ~ length^(-1/2), the rate at which bodies of all sizes fall and
swing alike. Masses go as the volume of the skin; where there is none, a bird is in proportion to
its wings, and wings that a groom lacks are to its body. A skin that is open is none.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from featherfx.algebra.types import Array
from featherfx.algebra.vectors import dots
from featherfx.groom.keys.preset import Clock
from featherfx.groom.types import Groom
from featherfx.shot.motion.flap import folding
from featherfx.shot.motion.joints import joint_roots, skeleton_of
from featherfx.shot.motion.limbs import of_wings


class Build(NamedTuple):
    """volume: m^3, of the body's skin. span: m, from tip to tip of open wings. area: m^2, of their
    outline from above, with the body between them. 0 where a groom does not tell."""

    volume: float
    span: float
    area: float


# of a surface's area, seen from anywhere, that may be a hole of what encloses a body
_OPEN = 0.05
# of samples/first_bird, on which motions were set, as its preset was then
PIGEON = Build(1.53e-3, 0.847, 0.1006)


def fitted(clock: Clock, groom: Groom) -> Clock:
    """A clock whose tempo and size are as its fit asks for a groom."""
    if clock.fit == "none":
        return clock
    build = build_of(groom)
    size, beat = size_of(build), beat_of(build)
    tempo = beat if clock.fit == "beat" else size**-0.5
    return replace(clock, tempo=clock.tempo * tempo, size=clock.size * size, fit="none")


def size_of(build: Build) -> float:
    """Return how many times as long as a pigeon a body is."""
    if build.volume > 0.0:
        return float(np.cbrt(build.volume / PIGEON.volume))
    return build.span / PIGEON.span if build.span > 0.0 else 1.0


def beat_of(build: Build) -> float:
    """Return how many times as often as a pigeon's wings beat."""
    size = size_of(build)
    if build.span == 0.0:
        return size**-0.5
    mass, span, area = size**3, build.span / PIGEON.span, build.area / PIGEON.area
    return float(mass ** (3 / 8) * span ** (-23 / 24) * area ** (-1 / 3))


def build_of(groom: Groom) -> Build:
    """Measure a groom's skin, and its wings, opened."""
    volume = 0.0 if groom.skin is None else _volume(groom.skin)
    wings = _opened(groom)
    if wings is None:
        return Build(volume, 0.0, 0.0)
    from scipy.spatial import ConvexHull  # heavy, and only for this

    # in the plane a hull's volume is its area
    return Build(volume, float(np.ptp(wings[:, 1])), float(ConvexHull(wings).volume))


def _volume(corners: Array) -> float:
    """m^3 within triangles (T, 3, 3); 0 where they do not close, but for holes."""
    first, second, third = np.moveaxis(corners - corners.mean(axis=(0, 1)), 1, 0)
    normals = np.cross(second - first, third - first)
    whole = float(np.linalg.norm(normals, axis=1).sum())
    if float(np.linalg.norm(normals.sum(axis=0))) > _OPEN * whole:
        return 0.0
    return abs(float(dots(first, np.cross(second, third)).sum())) / 6.0


def _opened(groom: Groom) -> Array | None:
    """(P, 2) m, from above: ends of the feathers of both wings, opened; of one wing, and its mirror
    image. None where there are none that open."""
    own = of_wings(groom)
    folds = {joint.name for joint in groom.joints if joint.hinge is not None and joint.side}
    if not own.any() or not folds:
        return None
    open_ = {"joints": "*", "folds": [{"time": 0.0, "fold": 0.0}]}
    poses = folding(groom, open_, str(groom.source))
    roots = joint_roots(groom, skeleton_of(groom), poses).frames(0.0)
    lengths = np.array([each.kind.length for each in groom.feathers])[:, None]
    tips = roots.positions + lengths * roots.rotations[:, :, 0]
    ends = np.vstack([roots.positions[own], tips[own]])[:, :2]
    return np.vstack([ends, ends * (1.0, -1.0)])
