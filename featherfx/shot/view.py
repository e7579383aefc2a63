"""Sizes of feathers in the image of a camera."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from featherfx.algebra.types import Array
from featherfx.shot.clock import StageClock
from featherfx.shot.sources import OfScene


@dataclass(frozen=True)
class View:
    """A camera at one time. eye: (3,) m. right, up, back: (3,) unit, it looks along -back.

    width, height: of the picture, over the depth (perspective) or m (orthographic).
    shift: (2,) of the picture's middle to the right and up, in the same measure.
    """

    eye: Array
    right: Array
    up: Array
    back: Array
    width: float
    height: float
    shift: tuple[float, float]
    orthographic: bool


class Camera(OfScene, Protocol):
    """A camera of a scene."""

    def view(self, code: float) -> View:
        """Return where it is and what it sees at a time code."""


@dataclass(frozen=True)
class TimedCamera:
    """A scene's camera over the shot's time."""

    source: Camera
    clock: StageClock

    def view(self, time: float) -> View:
        """At a time in s since the first frame."""
        return self.source.view(self.clock.held(time))


def relative_sizes(view: View, roots: Array, lengths: Array, margin: float) -> Array:
    """(F,) lengths of feathers in the picture over its height; 0 where they are outside.

    roots: (F, 3) m, lengths: (F,) m. A feather counts as a ball of its length around its root, so
    that it is outside only where no pose of it can be seen. margin: by which the picture is widened
    on every side, over its size.
    """
    right, up, depth = np.stack([view.right, view.up, -view.back]) @ (roots - view.eye).T
    sizes = np.array([view.width, view.height])
    if view.orthographic:
        scale = near = np.ones_like(depth)
        slant = np.ones(2)
    else:
        scale, near = np.maximum(depth, 0.0), np.maximum(depth, lengths)
        # distance of a plane through the eye from a point beside it
        slant = np.hypot(1.0, 0.5 * sizes)
    inside = depth > -lengths
    for k, offset in enumerate((right, up)):
        reach = (0.5 + margin) * sizes[k] * scale + slant[k] * lengths
        inside &= np.abs(offset - view.shift[k] * scale) <= reach
    return np.where(inside, lengths / (near * view.height), 0.0)
