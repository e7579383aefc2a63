"""A cache as a page takes it: what never changes, and frames of whole numbers, in bytes.

A frame is the corner and the size of its box (6 float32, metres), then 3 uint16 a point, places in
that box. A value that changes (strain, hooks) is a byte a point, the place in its range; who
colours by it asks for it.
"""

from __future__ import annotations

import json
import re
from collections.abc import Collection, Mapping
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from featherfx.algebra.types import Array, Indices
from featherfx.errors import InputError, Problem
from featherfx.files.atomic_write import Standing, standing
from featherfx.render.geometry import DrawnPose, DrawnScene, load_points, load_scene
from featherfx.render.subject import (
    CROSSED,
    DIVERGING,
    HOOKS,
    PLAIN_RACHIS_COLOUR,
    SEQUENTIAL,
    barb_angle,
    linear,
    look_colours,
    ramp_colours,
    scenery_colours,
    scenery_of_shot,
    strain_across_barbs,
    value_limits,
)
from featherfx.usd.check.measures import CrossedPoints
from featherfx.usd.convert.levels import ThinnedMesh, make_levels, thin_feathers
from featherfx.usd.read.cache import Cache

Bytes = NDArray[np.uint8]

_PLACES = 65535


def packed_points(points: Array) -> bytes:
    """Points (V, 3): corner and size of their box (6 float32), then places in it (3 uint16)."""
    # column by column, which numpy does much faster
    low, high = (np.array([end(each) for each in points.T]) for end in (np.min, np.max))
    size = np.maximum(high - low, 1e-9)
    places = (points - low) * (_PLACES / size) + 0.5
    return np.concatenate([low, size]).astype("<f4").tobytes() + places.astype("<u2").tobytes()


def packed_colours(colours: Array) -> bytes:
    """Colours, or other values, from 0 to 1, a byte each."""
    rounded: Bytes = np.round(255.0 * np.clip(colours, 0.0, 1.0)).astype(np.uint8)
    return rounded.tobytes()


class SceneryMeshes:
    """The meshes that a cache at a path names, as pictures have them; a warning tells what is not
    there. points: of all of them, 0 where there are none."""

    def __init__(self, cache: Cache, path: Path) -> None:
        # what the camera is to see of it comes first
        self._meshes = sorted(scenery_of_shot(cache, path), key=lambda each: not each.is_framed)
        self._counts = [len(each.surface.rest) for each in self._meshes]

    @property
    def points(self) -> int:
        return sum(self._counts)

    def header(self) -> dict[str, Any] | None:
        """Describe the meshes for the viewer; None where there are none. framed: number of points,
        the first, that the camera is to see."""
        if not self._meshes:
            return None
        pairs = zip(self._meshes, self._counts, strict=True)
        return {
            "points": self.points,
            "triangles": sum(len(each.surface.triangles) for each in self._meshes),
            "levels": [],
            "framed": sum(count for each, count in pairs if each.is_framed),
        }

    def constant(self) -> bytes:
        """Corners (3 uint32 a triangle) and a colour a point (3 bytes)."""
        starts = np.cumsum([0, *self._counts])
        pairs = zip(self._meshes, starts[:-1], strict=True)
        corners = np.concatenate([each.surface.triangles + start for each, start in pairs])
        colours = np.concatenate([scenery_colours(each) for each in self._meshes])
        return corners.astype("<u4").tobytes() + packed_colours(colours)

    def frame(self, code: float | None) -> bytes:
        """Its points at a time code of the cache; None: at rest."""
        return packed_points(np.concatenate([each.points(code) for each in self._meshes]))


# what, at which level, in which frame
_FRAME = re.compile(r"([a-z]+)(\d?)-(\d{1,7})")
# greatest strain that a colour tells apart, that of a vane whose barbs are a quarter farther apart;
# the least that colours range to, above what single precision makes of points that do not move
_STRAIN, _MIN_STRAIN = 0.25, 0.005
# degrees, round the upright axis and above the ground, of views that are compared
_TURNS = (-55.0, -125.0, 55.0, 125.0, -90.0, 0.0, 180.0, 90.0)
_RISES = (25.0, 50.0, 75.0)


class Value(NamedTuple):
    """A value of points that changes. name: in the page. title: of its key. low, high: its range,
    and ends: that range in words. ramp: colours from low to high, as displays show them."""

    name: str
    title: str
    low: float
    high: float
    ends: str
    ramp: list[list[float]]


def strain_value(most: float) -> Value:
    """Strain whose colours range to so much."""
    told = f"{-100 * most:.2g} % to {100 * most:.2g} %"
    return Value("strain", "strain across barbs", -most, most, told, DIVERGING.tolist())


STRAIN = strain_value(_STRAIN)
_HOOKED = Value("hooked", "hooks", 0.0, 1.0, "open to holding", HOOKS.tolist())
_PENETRATION = Value(
    "penetration", "vanes that pass through others or the body", 0.0, 1.0, "no to yes",
    CROSSED.tolist(),
)  # fmt: skip
VALUE_NAMES = (STRAIN.name, _HOOKED.name, _PENETRATION.name)


class Played:
    """One cache that is played. points: of all feathers, at most `most` are kept (levels.py).
    bare: without the body. chosen: names of values that frames may have, None: all that it has.

    codes: its frames; None for a cache without time. Raises InputError as Cache does.
    """

    def __init__(
        self,
        path: Path,
        most: int,
        most_frames: int = 100_000,
        bare: bool = False,
        chosen: Collection[str] | None = None,
    ) -> None:
        self.path, self.bare, self.chosen = path, bare, chosen
        self._before: Standing = standing(path)
        self._cache = Cache(path)
        codes: list[float | None] = [*self._cache.whole_frames()] if self._cache.has_frames else []
        every = -(-len(codes) // most_frames) if codes else 1
        self.codes: list[float | None] = codes[::every] or [None]
        self._every = every
        self._scene: DrawnScene = load_scene(self._cache)
        self._kept: ThinnedMesh = thin_feathers(self._scene.feathers, self._scene.starts, most)

    @cached_property
    def rest(self) -> DrawnPose:
        """Rest geometry of strain and barb angles; may be set to another one."""
        return self._scene.rest

    @cached_property
    def values(self) -> list[Value]:
        """Those that frames have."""
        names = [name for name in VALUE_NAMES if self._has(name) and name not in self.left_values]
        constant = {each.name: each for each in (_HOOKED, _PENETRATION)}
        return [constant.get(name) or strain_value(self._most_strain()) for name in names]

    @cached_property
    def left_values(self) -> list[str]:
        """Names of values that it has and frames do not."""
        if self.chosen is None:
            return []
        return [name for name in VALUE_NAMES if name not in self.chosen and self._has(name)]

    def _has(self, name: str) -> bool:
        if name == _PENETRATION.name:
            return len(self._scene.feathers) > 1 or bool(self.body)
        return self._has_hooks if name == _HOOKED.name else bool(self.rest.barbs.any())

    def _most_strain(self) -> float:
        """Return a bound of nearly all strains of a few frames, to two digits."""
        few = np.unique(np.linspace(0, len(self.codes) - 1, 4).astype(int))
        vanes = ~self._scene.rachis
        found = [self._strain(self._points(k))[vanes] for k in few.tolist()]
        _, most = value_limits(np.concatenate(found), symmetric=True)
        return float(f"{min(max(most, _MIN_STRAIN), _STRAIN):.1e}")

    @cached_property
    def body(self) -> SceneryMeshes | None:
        """Meshes beside the feathers."""
        found = None if self.bare else SceneryMeshes(self._cache, self.path)
        return found if found and found.points else None

    @cached_property
    def _crossed(self) -> CrossedPoints:
        return CrossedPoints(self._cache, self.path)

    @cached_property
    def _has_hooks(self) -> bool:
        return any(
            self._cache.pose(k, self.codes[-1]).hooked is not None for k in self._some_of_each()
        )

    def _some_of_each(self) -> list[int]:
        """A feather of each kind."""
        first = {each.kind: k for k, each in reversed([*enumerate(self._scene.feathers)])}
        return sorted(first.values())

    @property
    def frames_per_second(self) -> float:
        """Rate of the frames that are kept."""
        return self._cache.frames_per_second / self._every

    @property
    def points(self) -> int:
        """Points that are kept."""
        return len(self._kept.points)

    @property
    def point_bytes(self) -> int:
        """Bytes of a point in a frame, with its values."""
        return 6 + len(self.values)

    @property
    def body_bytes(self) -> int:
        """Bytes of the body in a frame."""
        return 24 + 6 * self.body.points if self.body else 0

    @property
    def frame_bytes(self) -> int:
        """Bytes of a frame with its values, about."""
        return 24 + self.point_bytes * self.points + self.body_bytes

    @property
    def constant_shape(self) -> tuple[tuple[str, ...], bytes]:
        """Ids of its feathers, and the triangles of kept points."""
        return tuple(each.id for each in self._scene.feathers), self._kept.triangles.tobytes()

    def header(self) -> dict[str, Any]:
        """All that is not numbers of points, for JSON."""
        scene, kept = self._scene, self._kept
        return {
            "name": self.path.name,
            "frames": [None if code is None else float(code) for code in self.codes],
            "framesPerSecond": self.frames_per_second,
            "points": len(kept.points),
            "triangles": len(kept.triangles),
            "levels": [[len(points), len(triangles)] for points, triangles in self._levels],
            "told": "; ".join(self.told()),
            "values": [value._asdict() for value in self.values],
            "ramp": SEQUENTIAL.tolist(),
            "angles": self._angle_range,
            "regions": sorted(set(scene.regions)),
            "from": self._best_view(),
            "body": self.body and self.body.header(),
            "feathers": [
                {
                    "id": each.id,
                    "kind": each.kind,
                    "region": each.region,
                    "first": int(kept.starts[k]),
                    "points": int(scene.starts[k + 1] - scene.starts[k]),
                    "root": [round(float(x), 5) for x in scene.rest.points[scene.starts[k]]],
                    "length": round(self._length(k), 5),
                }
                for k, each in enumerate(scene.feathers)
            ],
        }

    def _best_view(self) -> list[float]:
        """Unit direction, from slightly to far above, from which most of the vanes is seen at
        first; of equal ones that from the front left."""
        points = load_points(self._cache, self._scene, self.codes[0])
        corners = points[self._scene.triangles]
        edges = corners[:, 1:] - corners[:, :1]
        areas = np.cross(edges[:, 0], edges[:, 1])
        turn, rise = np.meshgrid(np.radians(_TURNS), np.radians(_RISES), indexing="ij")
        ways = np.stack(
            [np.cos(turn) * np.cos(rise), np.sin(turn) * np.cos(rise), np.sin(rise)], axis=-1
        ).reshape(-1, 3)
        seen = np.abs(areas @ ways.T).sum(axis=0)
        best = ways[np.flatnonzero(seen >= 0.98 * seen.max())[0]]
        return [round(float(each), 4) for each in best]

    def told(self) -> list[str]:
        """List messages about omitted points and frames."""
        whole = len(self._scene.rest.points)
        told = []
        if self._kept.told:
            told.append(f"drawn {self._kept.told}: {len(self._kept.points)} of {whole} points")
        if self.bare:
            told.append("without the body")
        if self.left_values:
            told.append(f"without {', '.join(self.left_values)}: add them by --value")
        if self._every > 1:
            told.append(f"every {self._every}th frame")
        return told

    def _length(self, index: int) -> float:
        own = self._scene.rest.points[slice(*self._scene.starts[index : index + 2])]
        return float(np.linalg.norm(np.ptp(own, axis=0)))

    @cached_property
    def _levels(self) -> list[tuple[Indices, Indices]]:
        return make_levels(self._scene.feathers, self._scene.starts, self._kept)

    def constant(self) -> bytes:
        """Corners (3 uint32 a triangle), points (uint32) and their corners of each level
        (levels.py), then three colours a point (3 bytes each): pattern, region and barb angle."""
        whole = [self._kept.triangles, *(each for level in self._levels for each in level)]
        colours = [self._pattern(), self._regions(), self._barbs()]
        return b"".join(
            [*(w.astype("<u4").tobytes() for w in whole), *map(packed_colours, colours)]
        )

    @property
    def levels(self) -> int:
        """Number of levels with fewer points."""
        return len(self._levels)

    def names(self) -> tuple[list[str], list[list[str]]]:
        """Names of all that content gives, but for frames at levels: of what is constant, and of
        each frame."""
        own, body = ["frame"] + [each.name for each in self.values], bool(self.body)
        own += ["body"] * body
        frames = [[f"{what}-{number}" for what in own] for number in range(len(self.codes))]
        return ["constant"] + ["bodyconstant"] * body, frames

    def content(self, name: str) -> bytes | None:
        """Return the content of a name for the viewer; None where there is none."""
        if name == "constant":
            return self.constant()
        if name == "bodyconstant" and self.body:
            return self.body.constant()
        found = _FRAME.fullmatch(name)
        if found is None or int(found[3]) >= len(self.codes):
            return None
        what, level, number = found[1], int(found[2] or 0), int(found[3])
        if what == "frame" and level <= self.levels:
            return self.frame(number, level)
        if what == "body" and level == 0 and self.body:
            return self.body.frame(self._code(number))
        if level == 0 and what in [each.name for each in self.values]:
            return self.value(what, number)
        return None

    def frame(self, number: int, level: int = 0) -> bytes:
        """A frame by its place among `codes`, with the points of a level, 0 for all. Raises
        InputError where the cache has changed since it was opened, or cannot be read."""
        kept = self._kept.points
        if level:
            kept = kept[self._levels[level - 1][0]]
        return packed_points(self._points(number, kept))

    def value(self, name: str, number: int) -> bytes:
        """A value of all points in a frame, as `frame`."""
        if name == _PENETRATION.name:
            crossed = self._crossed.at(self._code(number))[self._kept.points]
            return packed_colours(crossed.astype(float))
        hooked = None
        if name == _HOOKED.name:
            hooked = self._cache.hooked_of(self._scene.chosen.tolist(), self._code(number))
        return self.valued(name, self._points(number), hooked)

    def _code(self, number: int) -> float | None:
        if standing(self.path) != self._before:
            raise InputError(Problem(str(self.path), "", "has changed. Open it again"))
        return self.codes[number]

    def _points(self, number: int, among: Indices | None = None) -> Array:
        if among is not None and len(among) == len(self._scene.rest.points):
            among = None
        return load_points(self._cache, self._scene, self._code(number), among)

    def packed(self, points: Array) -> bytes:
        """A frame of all points (V, 3)."""
        return packed_points(points[self._kept.points])

    def valued(self, name: str, points: Array, hooked: Array | None = None) -> bytes:
        """A value of all points (V, 3). hooked: as of DrawnPose, where that is asked for."""
        value = next(each for each in self.values if each.name == name)
        faces = self._strain(points) if hooked is None else hooked
        return self._scaled(self._of_points(faces), value).tobytes()

    def _strain(self, points: Array) -> Array:
        rest = self.rest
        found = strain_across_barbs(rest.points, points, self._scene.triangles, rest.barbs)
        return np.where(self._scene.rachis, 0.0, found)

    def _scaled(self, values: Array, value: Value) -> Bytes:
        fraction = (values - value.low) / (value.high - value.low)
        return np.round(255.0 * np.clip(fraction, 0.0, 1.0)).astype(np.uint8)

    def _of_points(self, faces: Array) -> Array:
        """(P,) means of the faces around kept points."""
        corners, total = self._scene.triangles, len(self._scene.rest.points)
        sums = np.bincount(corners.ravel(), np.repeat(faces, 3), total)
        return (sums / np.maximum(np.bincount(corners.ravel(), minlength=total), 1))[
            self._kept.points
        ]

    def _pattern(self) -> Array:
        base, _ = look_colours(self._scene, "shaded")
        found = np.repeat(base, np.diff(self._scene.starts), axis=0)
        found[self._scene.triangles[self._scene.rachis]] = PLAIN_RACHIS_COLOUR
        for k, each in enumerate(self._scene.feathers):
            if each.colour is not None:
                found[slice(*self._scene.starts[k : k + 2])] = each.colour
        return found[self._kept.points]

    def _regions(self) -> Array:
        base, _ = look_colours(self._scene, "region")
        return np.repeat(base, np.diff(self._scene.starts), axis=0)[self._kept.points]

    @cached_property
    def _angles(self) -> Array:
        """(T,) barb angles at rest, degrees."""
        return barb_angle(self._scene, self.rest)

    @property
    def _angle_range(self) -> tuple[float, float] | None:
        """Range of barb angles for colours; None where there are no barbs."""
        if not self.rest.barbs.any():
            return None
        low, high = value_limits(self._angles[~self._scene.rachis], symmetric=False)
        return float(low), float(high)

    def _barbs(self) -> Array:
        """Colours of barb angles at rest; grey where there are none."""
        if self._angle_range is None:
            return np.full((len(self._kept.points), 3), 0.2)
        low, high = self._angle_range
        fraction = (self._of_points(self._angles) - low) / (high - low)
        return linear(ramp_colours(SEQUENTIAL, np.clip(fraction, 0.0, 1.0)))


def packed(header: Mapping[str, Any]) -> str:
    """JSON that may stand within a script of a page."""
    return json.dumps(header, separators=(",", ":")).replace("<", "\\u003c")
