"""The skin beneath the feathers as layers see it: how high each node is to stay above it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from featherfx.shot.contact.beneath import NEAR, SkinBeneath, surfaces_under
from featherfx.shot.layers.types import Array, Ground, Indices, Vanes
from featherfx.shot.motion.skin import BoundSkin


class GroundBeneath(NamedTuple):
    """A surface of a skin, and what nodes keep of it."""

    skin: SkinBeneath
    ground: Ground


def skins_beneath(skin: BoundSkin, some: Indices, vanes: Vanes, rest: Array) -> list[GroundBeneath]:
    """The surfaces of a skin. some: numbers of the feathers that vanes and rest are of, ascending;
    rest: (F, n, 2 m + 1, 3) m, nodes at rest."""
    found = []
    for surface, members in surfaces_under(skin, some):
        own = np.zeros(vanes.present.shape, dtype=bool)
        own[members] = vanes.present[members] != 0
        beneath, feather = SkinBeneath(surface, rest[own]), np.nonzero(own)[0]
        triangle, clear = np.full(own.shape, -1), np.zeros(own.shape)
        over = np.abs(beneath.height) < NEAR * vanes.row.sum(axis=1)[feather]
        clear[own] = np.minimum(beneath.height, vanes.half[feather])
        triangle[own] = np.where(over, beneath.triangle, -1)
        found.append(GroundBeneath(beneath, Ground(triangle, clear, *beneath.mesh)))
    return found
