"""Cameras of images: framed so that all frames fit, on a turntable, or from USD.

All in the world: metres, z up.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from featherfx.algebra.types import Array, Indices
from featherfx.algebra.vectors import from_rotation_vector
from featherfx.render.light_kernels import Lens
from featherfx.shot.sources import View

_ANGLE = math.radians(24)
_FOCAL_LENGTH = 0.056  # m: sees this angle over the height of a frame of 24 mm
_MARGIN = 1.13  # a picture over what is in it, so that 6 % are left on either side
_TILE, _LEAST, _MOST = 480 * 320, 0.5, 2.0  # pixels of a tile, and its width over its height
# by eye: vanes with less of their area along one axis are around a body (birds with folded wings
# have 0.48 to 0.66, wings 0.89 to 0.93), which is seen from so far aside of its broad side and so
# high; unless they look the same way on the whole, as raised wings do (at 35 degrees 0.82)
_ROUND, _ONE_WAY = 0.78, 0.7
_ASIDE, _RAISED = math.radians(25), math.radians(12)
# (right, up) of the fixed views of a creature that looks to +x: top, from -y, and from +x.
_FIXED = {
    "top": ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0)),
    "side": ((1.0, 0.0, 0.0), (0.0, 0.0, 1.0)),
    "front": ((0.0, 1.0, 0.0), (0.0, 0.0, 1.0)),
}


@dataclass(frozen=True)
class Eye:
    """A camera of pictures. view: where it is and what it sees. size: (width, height) in pixels.

    radius: m, of its lens; 0: all is sharp. focus: m, depth that is sharp.
    """

    view: View
    size: tuple[int, int]
    radius: float = 0.0
    focus: float = 1.0

    @property
    def right(self) -> Array:
        return self.view.right

    @property
    def up(self) -> Array:
        return self.view.up

    @property
    def back(self) -> Array:
        return self.view.back

    def lens(self, origin: Array) -> Lens:
        """As kernels take it, with positions from an origin (3,)."""
        view = self.view
        return Lens(
            view.eye - origin,
            np.array(view.right),
            np.array(view.up),
            np.array(view.back),
            float(view.width),
            float(view.height),
            float(view.shift[0]),
            float(view.shift[1]),
            bool(view.orthographic),
            float(self.radius),
            float(self.focus),
            self.size[0],
            self.size[1],
        )

    def pixels_per_metre(self, points: Array) -> Array:
        """(N,) at points (N, 3); at most as near as a tenth of the depth of the farthest."""
        view, rows = self.view, self.size[1]
        if view.orthographic:
            return np.full(len(points), rows / view.height)
        depth = (view.eye - points) @ view.back
        return rows / (view.height * np.maximum(depth, max(0.1 * float(depth.max()), 1e-9)))

    def places(self, points: Array) -> Array:
        """(N, 2) columns and rows of points (N, 3) in the picture, pixels."""
        view = self.view
        local = (points - view.eye) @ np.stack([view.right, view.up, view.back], axis=1)
        over = 1.0 if view.orthographic else -local[:, 2]
        x = (local[:, 0] / over - view.shift[0]) / view.width + 0.5
        y = 0.5 - (local[:, 1] / over - view.shift[1]) / view.height
        return np.stack([x * self.size[0], y * self.size[1]], axis=1)

    def focused(self, f_stop: float, on: Array) -> Eye:
        """With the blur of a lens at an f-stop, sharp at the depth of a point (3,)."""
        focus = float((self.view.eye - on) @ self.view.back)
        return replace(self, radius=0.5 * _FOCAL_LENGTH / f_stop, focus=max(focus, 1e-6))


def axes_of(
    view: str, points: Array, triangles: Indices, stands: bool = False, heading: float = 0.0
) -> tuple[Array, Array]:
    """Return (right, up) of one of VIEWS.

    "auto" sees triangles (T, 3) of points (V, 3) from their broad side, or upright what stands.
    heading: deg, of the creature's forward from x about z, by which the others go.
    """
    if view == "auto":
        return _upright(points) if stands else _three_quarter(points, triangles)
    turn = from_rotation_vector(np.array([0.0, 0.0, np.radians(heading)]))
    right, up = (turn @ axis for axis in _FIXED[view])
    return right, up


def _three_quarter(points: Array, triangles: Indices) -> tuple[Array, Array]:
    """(right, up) of a view that sees the vanes from their broad side, a little from aside; of
    vanes around a body, one of it upright."""
    world_up = np.array([0.0, 0.0, 1.0])
    a, b, c = (points[triangles[:, k]] for k in range(3))
    normals = 0.5 * np.cross(b - a, c - a)
    size = np.maximum(np.linalg.norm(normals, axis=1), 1e-300)
    areas, axes = np.linalg.eigh(np.einsum("tk,tl,t->kl", normals, normals, 1 / size))
    one_way = np.linalg.norm(normals.sum(axis=0)) > _ONE_WAY * areas.sum()
    if areas[-1] < _ROUND * areas.sum() and not one_way:
        return _upright(points)
    broad = axes[:, -1]
    toward = broad @ world_up
    if abs(toward) < 0.3:
        toward = broad @ normals.sum(axis=0)
    broad = broad if toward >= 0 else -broad
    flat = (points - points.mean(axis=0)) @ (np.eye(3) - np.outer(broad, broad))
    # The greatest spread lies along the picture's width, pointing to the positive axis.
    long = np.linalg.eigh(flat.T @ flat)[1][:, -1]
    long = long if long[np.argmax(np.abs(long))] > 0 else -long
    up = np.cross(broad, long)
    if up @ world_up < -0.1:
        long, up = -long, -up
    raised = world_up if abs(broad @ world_up) < 0.7 else -up
    back = broad + 0.35 * raised - 0.2 * long
    right = np.cross(up, back)
    right /= np.linalg.norm(right)
    across = np.cross(back, right)
    return right, across / np.linalg.norm(across)


def _upright(points: Array) -> tuple[Array, Array]:
    """(right, up) of a view that sees a body from the side, raised, and from a little ahead of its
    positive end, or behind where that is its tail."""
    flat = points[:, :2] - points[:, :2].mean(axis=0)
    long = np.linalg.eigh(flat.T @ flat)[1][:, -1]
    long = long if long[np.argmax(np.abs(long))] > 0 else -long
    turn, rise = _ASIDE, _RAISED
    side = np.array([long[1], -long[0]])
    level = math.cos(turn) * side + math.sin(turn) * long
    right = np.array([-level[1], level[0], 0.0])
    back = np.array([*(math.cos(rise) * level), math.sin(rise)])
    return right, np.cross(back, right)


def framing(right: Array, up: Array, points: Array, size: tuple[int, int]) -> Eye:
    """The nearest camera of given axes that has all points (N, 3) in the picture, and in its
    middle."""
    back = np.cross(right, up)
    tangent, aspect = math.tan(_ANGLE / 2), size[0] / size[1]
    local = points @ np.stack([right, up, back], axis=1)
    centre = 0.5 * (local.min(axis=0) + local.max(axis=0))
    for _ in range(4):
        x, y, z = (local - centre).T
        needed = np.maximum(np.abs(y) / tangent, np.abs(x) / (tangent * aspect))
        distance = max(float((z + _MARGIN * needed).max()), 1e-9)
        seen = np.stack([x, y]) / (distance - z)
        centre[:2] += 0.5 * distance * (seen.min(axis=1) + seen.max(axis=1))
    x, y, z = (local - centre).T
    needed = np.maximum(np.abs(y) / tangent, np.abs(x) / (tangent * aspect))
    distance = max(float((z + _MARGIN * needed).max()), 1e-9)
    eye = centre[0] * right + centre[1] * up + (centre[2] + distance) * back
    height = 2 * tangent
    return Eye(View(eye, right, up, back, height * aspect, height, (0.0, 0.0), False), size)


def tile_size(right: Array, up: Array, points: Array) -> tuple[int, int]:
    """(width, height) pixels of a tile that points (N, 3) fill as cameras of these axes see
    them."""
    width, height = (max(float(np.ptp(points @ axis)), 1e-9) for axis in (right, up))
    aspect = min(max(width / height, _LEAST), _MOST)
    return 2 * round(0.5 * math.sqrt(_TILE * aspect)), 2 * round(0.5 * math.sqrt(_TILE / aspect))


@dataclass(frozen=True)
class CameraPath:
    """The smooth way of what is drawn: polynomials of time codes, (4, 3) m, the constants last.

    first, span: codes from which and over which they count from -1 to 1.
    """

    coefficients: Array
    first: float
    span: float

    def __call__(self, time: float | None) -> Array:
        """(3,) m."""
        fraction = 2.0 * ((time or 0.0) - self.first) / self.span - 1.0
        return np.vander([fraction], len(self.coefficients))[0] @ self.coefficients


def fit_camera_path(reach: Sequence[tuple[float, Array]]) -> CameraPath:
    """Fit a path to the middles of hulls at time codes, by least squares, so that it does not beat
    with a wing."""
    codes = np.array([code for code, _ in reach])
    middles = np.array([0.5 * (hull.min(axis=0) + hull.max(axis=0)) for _, hull in reach])
    first, span = float(codes.min()), max(float(np.ptp(codes)), 1e-9)
    degree = min(3, len(np.unique(codes)) - 1)
    fractions = 2.0 * (codes - first) / span - 1.0
    return CameraPath(np.polyfit(fractions, middles, degree).reshape(degree + 1, 3), first, span)


def still_path() -> CameraPath:
    """The way of a camera that stays where it is."""
    return CameraPath(np.zeros((1, 3)), 0.0, 1.0)


def travels(way: CameraPath, reach: Sequence[tuple[float, Array]]) -> bool:
    """Check that the subject moves farther than its own size."""
    places = np.array([way(code) for code, _ in reach])
    sizes = [float(np.linalg.norm(np.ptp(hull, axis=0))) for _, hull in reach]
    return float(np.linalg.norm(np.ptp(places, axis=0))) > max(sizes)


def carried(eye: Eye, shift: Array) -> Eye:
    """A camera moved by a shift (3,) m."""
    return replace(eye, view=replace(eye.view, eye=eye.view.eye + shift))


def whole(view: View, size: tuple[int, int]) -> Eye:
    """A camera with all of its picture in one of another shape."""
    aspect = size[0] / size[1]
    width = max(view.width, view.height * aspect)
    return Eye(replace(view, width=width, height=width / aspect), size)


def turned(points: Array, middle: Array, angle: float) -> Array:
    """Points (..., 3) turned by an angle (rad) about the upright axis through a point (3,)."""
    cosine, sine = math.cos(angle), math.sin(angle)
    turn = np.array([[cosine, sine, 0.0], [-sine, cosine, 0.0], [0.0, 0.0, 1.0]])
    return np.asarray((points - middle) @ turn + middle)


def turned_eye(eye: Eye, middle: Array, angle: float) -> Eye:
    """A camera carried by an angle (rad) about the upright axis through a point (3,)."""
    view, origin = eye.view, np.zeros(3)
    right, up, back = (turned(axis, origin, angle) for axis in (view.right, view.up, view.back))
    at = turned(view.eye, middle, angle)
    return replace(eye, view=replace(view, eye=at, right=right, up=up, back=back))


def turntable(
    right: Array, up: Array, points: Array, size: tuple[int, int], angles: Sequence[float]
) -> list[Eye]:
    """Cameras around all points at angles (rad), all of one distance."""
    middle = 0.5 * (points.min(axis=0) + points.max(axis=0))
    around = np.concatenate([turned(points, middle, -angle) for angle in angles])
    eye = framing(right, up, around, size)
    return [turned_eye(eye, middle, angle) for angle in angles]
