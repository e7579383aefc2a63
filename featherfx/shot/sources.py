"""Surfaces, wind and cameras from scenes of other programs, as the frame loop sees them.

The reader of scenes stands downstream of the shot; it comes in as SceneReaders, and what it reads
answers to the protocols here.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple, Protocol

import numpy as np

from featherfx.algebra.interpolation import Knots
from featherfx.algebra.types import Array, Flags, Indices
from featherfx.algebra.vectors import cross_columns
from featherfx.phases import LeftOut
from featherfx.shot.frames import StageClock
from featherfx.shot.roots import NO_RUN_UP, STILL, RunUp


class OfScene(Protocol):
    """Something that stands in a scene. path: of its prim. sampled: first and last time code of
    its samples, None where it does not change. left: prims that were not taken beside it."""

    path: str
    sampled: tuple[float, float] | None
    left: tuple[LeftOut, ...]

    @property
    def file(self) -> Path:
        """Return the file that the scene was opened from."""

    def describe_motion(self, codes: Sequence[float]) -> str:
        """Return how it changes over the time codes of a shot, in words."""

    @property
    def time_codes_per_second(self) -> float:
        """Time codes per second of the scene."""

    @property
    def has_rate(self) -> bool:
        """Return whether the scene gives them itself."""

    @property
    def origin(self) -> tuple[Any, ...]:
        """Path in the scene, every file that the scene is made of, and how it is read."""


class JointTree(NamedTuple):
    """J joints of a skeleton, each behind its parent.

    skeleton: its path. names: paths of the joints in it. parents: (J,), -1 where there is none.
    """

    skeleton: str
    names: tuple[str, ...]
    parents: Indices

    def find(self, name: str) -> list[int]:
        """List the joints that a path, or the end of one, names."""
        if name in self.names:
            return [self.names.index(name)]
        return [k for k, each in enumerate(self.names) if each.endswith(f"/{name}")]


class MovingSurface(OfScene, Protocol):
    """A triangle mesh that moves; metres, z up.

    triangles: (T, 3) point indices, seen from outside. closed: (T,) whether they bound a volume;
    others are sheets. face: (T,) the scene's faces. rest: (V, 3) m. st: (T, 3, 2) texture
    coordinates, or None. bones: (T,) m, length of each triangle's bone, where it is a ribbon along
    those of a skeleton; else None. subdivision: whether it is the subdivided surface of its cage,
    where it has one.
    """

    triangles: Indices
    closed: Flags
    face: Indices
    rest: Array
    st: Array | None
    knots: Knots | None
    bones: Array | None
    subdivision: bool

    @property
    def space(self) -> tuple[float, str]:
        """Metres per unit and up axis ("Y" or "Z") of the scene itself."""

    @property
    def variant_sets(self) -> Mapping[str, str]:
        """Variants that are chosen in it by the names of their sets."""

    @property
    def joint_tree(self) -> JointTree | None:
        """Joints that move it; None where none do."""

    def joint_matrices(self, code: float | None) -> Array:
        """(J + 1, 4, 4) from joints, and at last from their skeleton, to the world at a time code,
        row vectors; None: at rest."""

    def posed_points(self, code: float, joints: Array) -> Array:
        """(V, 3) m, all points at a time code with joints (J + 1, 4, 4) that stand so instead."""

    def corners(self, code: float, triangles: Indices) -> Array:
        """(F, 3, 3) m, corners of triangles (F, 3) of points at a time code."""

    def points(self, code: float) -> Array:
        """(V, 3) m, all points at a time code."""

    def locate(self, triangle: Indices, barycentric: Array) -> tuple[Indices, Indices, Array]:
        """(R,) faces of the prim, (R, 3) its points and (R, 3) their weights, of places (R,) on
        triangles."""

    def is_mirrored(self, code: float) -> bool:
        """Return whether it is mirrored at a time code against rest."""

    def turn(self, first: float, last: float) -> float:
        """Return the angle (rad) by which transforms turn it between time codes, by way of their
        middle."""

    def masked(self, chosen: Flags) -> MovingSurface:
        """The same with some of its triangles (T,) alone."""

    def smoothed(self, knots: Knots | None) -> MovingSurface:
        """The same, moving smoothly between the poses that it has at knots (time codes); None: as
        the scene has it."""


class WindSource(OfScene, Protocol):
    """A wind that a scene gives."""

    def velocity(self, points: Array, code: float) -> Array:
        """(N, 3) m/s at points (N, 3) m, at a time code."""


@dataclass(frozen=True)
class TimedSurface:
    """A scene's mesh over the shot's time. run_up: how its motion is brought up from rest."""

    surface: MovingSurface
    clock: StageClock
    run_up: RunUp = NO_RUN_UP

    def points(self, time: float) -> Array:
        """(V, 3) m, all points at a time in s since the first frame."""
        points = self.surface.points(self.clock.code(self.run_up.own(time)))
        return points + self.run_up.shift(time) if time < 0.0 else points

    def after(self, time: float) -> Array:
        """(V, 3) m, the same; at a cut, after it."""
        return self.points(self.clock.after(time))

    def volume(self, points: Array) -> float:
        """m^3, within its closed parts if its points are at points (V, 3) m; below 0 inside out."""
        a, b, c = points.T[:, self.surface.triangles[self.surface.closed]].transpose(2, 0, 1)
        return float(np.einsum("ct,ct->", a, cross_columns(b, c))) / 6.0

    def brought_up(self, run_up: RunUp, tolerance: float) -> TimedSurface:
        """The same, led by a run-up; the ground that moves by less than a small part of a tolerance
        (m) stays where it is."""
        way = np.abs(self.points(run_up.back) - self.points(run_up.end)).max(initial=0.0)
        own = run_up if way > STILL * tolerance else run_up._replace(velocity=(0.0, 0.0, 0.0))
        return replace(self, run_up=own)


@dataclass(frozen=True)
class TimedWind:
    """A scene's wind over the shot's time. scale: factor."""

    source: WindSource
    clock: StageClock
    scale: float

    def velocity(self, points: Array, time: float) -> Array:
        """(N, 3) m/s at points (N, 3) m, at a time in s since the first frame."""
        return self.scale * self.source.velocity(points, self.clock.held(time))


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
